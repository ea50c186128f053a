//! Fins and tether from their description, and their wrench.

use super::model::System;
use crate::description::{Scene, Water};
use crate::hydro::{FINS, Fin, Surfaces, Tether};
use crate::lane::{Lane, Param};
use crate::lie::{Vector3, Vector6};

/// Fins of a vehicle; none where there is no water.
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

/// The tether, if it pulls at all.
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
    /// Whether there are fins or a tether.
    #[inline(always)]
    pub fn has_appendages(&self) -> bool {
        !self.fins.is_empty() || self.tether.is_some()
    }

    /// Deflections without command.
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

    /// Wrench of fins and tether on the vehicle at its twist through the water, under gravity (that of a world at rest) in
    /// vehicle axes.
    #[inline(always)]
    pub fn appendages<L: Lane>(&self, surfaces: &Surfaces<L>, twist: Vector6<L>, gravity: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let mut wrench = Vector6::zero();
        if !self.fins.is_empty() {
            wrench = surfaces.wrench(&self.fins, twist);
        }
        if let Some(tether) = &self.tether {
            wrench = wrench + tether.wrench(twist, gravity);
        }
        wrench
    }
}
