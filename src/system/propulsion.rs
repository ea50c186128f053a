//! Compilation of thrusters.

use super::model::System;
use crate::description::{ThrustMap, Vehicle};
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
    let compiled = vehicle.thrusters.iter().enumerate().map(|(i, thruster)| {
        let (map, own_band) = match &thruster.map {
            None => (None, [0.0; 2]),
            Some(ThrustMap::Points(points)) => (Some(points_map(points)), [0.0; 2]),
            Some(ThrustMap::T200) => t200_map(thruster.limits),
        };
        let band = thruster.dead_band.unwrap_or(0.0);
        let band = [own_band[0].min(-band), own_band[1].max(band)];
        // Inflow is measured along the axis, without thrust deduction and induced wrench.
        let (axis, moment) = (thruster.axis, thruster.position.cross(&thruster.axis));
        Thruster {
            wrench: thruster.wrench().into(),
            along: [axis.x, axis.y, axis.z, moment.x, moment.y, moment.z],
            limits: thruster.limits,
            lag: positive(Some(vehicle.lag(i))),
            dead_band: (band != [0.0; 2]).then_some(band),
            map,
            ambient_flow: positive(thruster.ambient_flow),
        }
    });
    compiled.collect()
}

/// Branches of a map from its points, which contain `[0, 0]`.
fn points_map(points: &[[f64; 2]]) -> [Branch<f64>; 2] {
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

/// Pulse widths of the T200, us: neutral, edges of the dead band, edges of the range.
const NEUTRAL: f64 = 1500.0;
const DEAD_BAND: [f64; 2] = [1470.0, 1530.0];
const RANGE: [f64; 2] = [1134.0, 1887.0];
/// Pieces of each branch of the map.
const PIECES: usize = 16;

/// Map and dead band of a T200 whose limits correspond to the full pulse widths.
pub fn t200_map(limits: [f64; 2]) -> (Option<[Branch<f64>; 2]>, [f64; 2]) {
    let per_pulse = |side: usize| limits[side].abs() / (RANGE[side] - NEUTRAL).abs();
    let band = [0, 1].map(|side| (DEAD_BAND[side] - NEUTRAL) * per_pulse(side));
    let branch_to = |side: usize| {
        let from = DEAD_BAND[side];
        // A limit of 0 leaves only the dead band, of zero width.
        if limits[side] == 0.0 {
            return Branch { base: 0.0, pieces: Vec::new() };
        }
        let point = |k: usize| {
            let pulse = from + (RANGE[side] - from) * k as f64 / PIECES as f64;
            [(pulse - NEUTRAL).abs() * per_pulse(side), t200_thrust(pulse).abs()]
        };
        branch(&(0..=PIECES).map(point).collect::<Vec<_>>())
    };
    (Some([branch_to(1), branch_to(0)]), band)
}

/// Thrust of a T200 in still water at a pulse width from 1134 to 1887 us, N, without the dead band: inverse of the published
/// `1498 + 12.01 T - 0.04731 T^2 - 0.002098 T^3 + 2.251e-5 T^4`, which increases from -40 to 60 N.
pub fn t200_thrust(pulse: f64) -> f64 {
    let pulse_of = |t: f64| 1498.0 + t * (12.01 + t * (-0.04731 + t * (-0.002098 + t * 2.251e-5)));
    let (mut low, mut high) = (-40.0, 60.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if pulse_of(middle) < pulse { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}
