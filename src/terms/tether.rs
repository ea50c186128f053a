//! Quasi-static tether. `[HC eq. 21, F_EXT]`

use nalgebra as na;
use serde::{Deserialize, Serialize};

use super::fin::MIN_SPEED_SQUARED;
use super::{DenseInstant, Medium, Term, TermInstant, TermTable, dense_force_at};
use crate::keys::{Fault, check_not_negative, flip, numbers as forms};
use crate::lane::{Lane, Param, get_all, numbers};
use crate::lie::{Vector3, Vector6};

/// A quasi-static tether: the vehicle carries weight in water and drag of one half, which moves with the point of attachment;
/// the other end carries the other half.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tether {
    /// Point of attachment in the vehicle frame, m.
    #[serde(with = "forms::vector3")]
    pub position: na::Vector3<f64>,
    /// Submerged length, m.
    pub length: f64,
    /// Diameter d, m.
    pub diameter: f64,
    /// Mass per length, kg/m.
    #[serde(default)]
    pub mass_per_length: f64,
    /// Drag coefficient C_D in cross flow.
    #[serde(default = "cylinder")]
    pub drag: f64,
}

/// Drag coefficient of a circular cylinder.
fn cylinder() -> f64 {
    1.2
}

impl TermTable for Tether {
    type Term = TetherTerm<f64>;

    fn check(tables: &[Self], key: &str) -> Result<(), Fault> {
        tables.iter().try_for_each(|&Self { length, diameter, mass_per_length, drag, .. }| {
            let numbers =
                [("length", length), ("diameter", diameter), ("mass_per_length", mass_per_length), ("drag", drag)];
            check_not_negative(key, numbers)
        })
    }

    fn flip_axes(&mut self) {
        flip(&mut self.position);
    }

    fn compile(&self, medium: &Medium) -> Option<Self::Term> {
        let half = 0.5 * self.length;
        let section = std::f64::consts::FRAC_PI_4 * self.diameter * self.diameter;
        let has_gravity = if medium.gravity.norm() == 0.0 { 0.0 } else { 1.0 };
        let net_mass = has_gravity * half * (self.mass_per_length - medium.density * section);
        let drag = 0.5 * medium.density * self.drag * self.diameter * half;
        (net_mass != 0.0 || drag != 0.0).then_some(TetherTerm { position: self.position.into(), net_mass, drag })
    }

    fn dense_wrench(&self, _: usize, at: &DenseInstant) -> na::Vector6<f64> {
        let v = at.velocity(&self.position);
        let (half, d) = (self.length / 2.0, self.diameter);
        let displaced = at.density * std::f64::consts::PI * d * d / 4.0;
        let weight = at.gravity * (half * (self.mass_per_length - displaced));
        let drag = v * (-0.5 * at.density * self.drag * d * half * v.norm());
        dense_force_at(weight + drag, &self.position)
    }
}

numbers! {
    /// Compiled tether.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct TetherTerm<P> {
        /// Point of attachment in the vehicle frame, m.
        pub position: [P; 3],
        /// Mass minus displaced mass of the vehicle's half, kg.
        pub net_mass: P,
        /// `rho C_D d l / 2` of that half of length l, N s2/m2.
        pub drag: P,
    }
}

impl<P: Copy> Term<P> for TetherTerm<P> {
    #[inline(always)]
    fn add_wrench<L: Lane>(&self, _: usize, at: &TermInstant<L>, sum: &mut Vector6<L>)
    where
        P: Param<L>,
    {
        let r = Vector3(get_all(&self.position));
        let v = at.twist.angular.cross_add(r, at.twist.linear);
        let speed = (v.dot(v) + L::c(MIN_SPEED_SQUARED)).sqrt();
        let force = v.scale_add(-(self.drag.get() * speed), at.gravity.scale(self.net_mass.get()));
        *sum = *sum + Vector6 { linear: force, angular: r.cross(force) };
    }
}
