//! Compilation of fins and tether, and their wrench.

use super::model::System;
use crate::description::{Scene, Water};
use crate::hydro::{FINS, Fin, FinAxes, Tether};
use crate::lane::{Lane, Param};
use crate::lie::{Vector3, Vector6};

/// Compiled fins of a vehicle; none in a vacuum.
pub(super) fn fins(scene: &Scene) -> Vec<Fin<f64>> {
    let per_coefficient = |area: f64| 0.5 * scene.water.density * area;
    if scene.water.density == 0.0 {
        return Vec::new();
    }
    let compiled = scene.vehicle.fins.iter().map(|fin| {
        let size = per_coefficient(fin.area);
        let positive = |x: f64| (x > 0.0).then_some(x);
        Fin {
            position: fin.position.into(),
            chord: fin.chord.into(),
            normal: fin.normal().into(),
            deflection: fin.deflection,
            limits: fin.range(),
            lift: size * fin.lift_slope,
            drag: positive(size * fin.drag),
            induced: positive(size * fin.induced_drag * fin.lift_slope * fin.lift_slope),
            stall: fin.stall.map(|angle| [1.0 / angle.sin().powi(2), size * fin.plate]),
        }
    });
    compiled.collect()
}

/// Compiled tether, unless its wrench is always 0.
pub(super) fn tether(scene: &Scene) -> Option<Tether<f64>> {
    let Water { density, gravity, .. } = &scene.water;
    let tether = scene.vehicle.tether.as_ref()?;
    let half = 0.5 * tether.length;
    let section = std::f64::consts::FRAC_PI_4 * tether.diameter * tether.diameter;
    let heavy = if gravity.norm() == 0.0 { 0.0 } else { 1.0 };
    let net_mass = heavy * half * (tether.mass_per_length - density * section);
    let drag = 0.5 * density * tether.drag * tether.diameter * half;
    (net_mass != 0.0 || drag != 0.0).then_some(Tether { position: tether.position.into(), net_mass, drag })
}

impl<P: Copy, B> System<P, B> {
    /// True if the vehicle has fins or a tether.
    #[inline(always)]
    pub fn has_fins_or_tether(&self) -> bool {
        !self.fins.is_empty() || self.tether.is_some()
    }

    /// Deflections without command, rad.
    pub fn deflections<L: Lane>(&self) -> [L; FINS]
    where
        P: Param<L>,
    {
        let mut deflections = [L::zero(); FINS];
        for (deflection, fin) in deflections.iter_mut().zip(&self.fins) {
            *deflection = fin.deflection.get();
        }
        deflections
    }

    /// Wrench of fins and tether on the vehicle, from its twist relative to the water and gravity (of a world at rest) in vehicle
    /// axes.
    #[inline(always)]
    pub fn fin_and_tether_wrench<L: Lane>(
        &self,
        fin_axes: &FinAxes<L>,
        twist: Vector6<L>,
        gravity: Vector3<L>,
    ) -> Vector6<L>
    where
        P: Param<L>,
    {
        let mut wrench = Vector6::zero();
        if !self.fins.is_empty() {
            wrench = fin_axes.wrench(&self.fins, twist);
        }
        if let Some(tether) = &self.tether {
            wrench = wrench + tether.wrench(twist, gravity);
        }
        wrench
    }
}
