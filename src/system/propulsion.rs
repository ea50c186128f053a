//! Compilation of thrusters.

use super::model::System;
use crate::description::Vehicle;
use crate::hydro::{Branch, Thruster};

impl<P, B> System<P, B> {
    /// True if inflow takes thrust of any thruster.
    #[inline(always)]
    pub fn has_inflow_losses(&self) -> bool {
        let mut any = false;
        for thruster in &self.thrusters {
            any |= thruster.ambient_flow.is_some();
        }
        any
    }
}

/// Compiled thrusters of a vehicle: all of them if any has dynamics, else none.
pub(super) fn thrusters(vehicle: &Vehicle) -> Vec<Thruster<f64>> {
    if !vehicle.has_thruster_dynamics() {
        return Vec::new();
    }
    let positive = |x: Option<f64>| x.filter(|&x| x > 0.0);
    let voltage = vehicle.supply_voltage();
    let compiled = vehicle.thrusters.iter().enumerate().map(|(i, thruster)| {
        let map = thruster.map.as_ref().map(|map| branches(&map.points(thruster.limits, voltage)));
        let band = thruster.dead_band.unwrap_or(0.0);
        // Inflow is measured along the axis, without thrust deduction and induced wrench.
        let (axis, moment) = (thruster.axis, thruster.position.cross(&thruster.axis));
        Thruster {
            wrench: thruster.wrench().into(),
            along: [axis.x, axis.y, axis.z, moment.x, moment.y, moment.z],
            limits: thruster.limits,
            lag: positive(Some(vehicle.lag(i))),
            dead_band: (band != 0.0).then_some([-band, band]),
            map,
            ambient_flow: positive(thruster.ambient_flow),
        }
    });
    compiled.collect()
}

/// Branches of a map from its points, which contain `[0, 0]`.
fn branches(points: &[[f64; 2]]) -> [Branch<f64>; 2] {
    let upward: Vec<_> = points.iter().copied().filter(|[command, _]| *command >= 0.0).collect();
    let downward: Vec<_> = points.iter().rev().filter(|[c, _]| *c <= 0.0).map(|point| point.map(|x| -x)).collect();
    [branch(&upward), branch(&downward)]
}

fn branch(points: &[[f64; 2]]) -> Branch<f64> {
    let piece = |pair: &[[f64; 2]]| {
        let ([c0, t0], [c1, t1]) = (pair[0], pair[1]);
        [c0, c1 - c0, (t1 - t0) / (c1 - c0)]
    };
    Branch { base: points[0][1], pieces: points.windows(2).map(piece).collect() }
}
