//! Wrenches of fins and tether, by angles of attack as the laws are stated.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3, Vector6};

use super::se3::{angular, force_at, linear};
use crate::description::{Fin, Tether, Vehicle, Water};

/// Fins and tether of a vehicle.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Appendages {
    density: f64,
    fins: Vec<Fin>,
    tether: Option<Tether>,
}

impl Appendages {
    /// Fins and tether of `vehicle` in `water`.
    pub fn new(vehicle: &Vehicle, water: &Water) -> Self {
        Self { density: water.density, fins: vehicle.fins.clone(), tether: vehicle.tether.clone() }
    }

    /// Number of fins.
    pub fn fins(&self) -> usize {
        self.fins.len()
    }

    /// Deflections without command, rad.
    pub fn deflections(&self) -> Vec<f64> {
        self.fins.iter().map(|fin| fin.deflection).collect()
    }

    /// Wrench of the fins at `deflections`, rad, and the vehicle's twist relative to the water; vehicle frame, N and N m.
    pub fn fin_wrench(&self, deflections: &[f64], relative: &Vector6<f64>) -> Vector6<f64> {
        self.fins.iter().zip(deflections).map(|(fin, deflection)| self.one_fin(fin, *deflection, relative)).sum()
    }

    fn one_fin(&self, fin: &Fin, deflection: f64, relative: &Vector6<f64>) -> Vector6<f64> {
        let axis = Unit::new_normalize(fin.axis);
        let turned: Matrix3<f64> = Rotation3::from_axis_angle(&axis, deflection).into_inner();
        let (chord, normal) = (turned * fin.chord, turned * fin.normal());
        let v = linear(relative) + angular(relative).cross(&fin.position);
        let (u, w) = (v.dot(&chord), v.dot(&normal));
        let speed = u.hypot(w);
        if speed == 0.0 {
            return Vector6::zeros();
        }
        let alpha = (-w).atan2(u);
        let attached = fin.lift_slope * alpha.sin() * alpha.cos();
        let stalled = fin.stall.map_or(0.0, |stall| {
            let x = (alpha.sin() / stall.sin()).powi(8);
            x / (1.0 + x)
        });
        let lift = (1.0 - stalled) * attached + stalled * fin.plate * alpha.sin() * alpha.cos();
        let drag = fin.drag
            + (1.0 - stalled) * fin.induced_drag * attached * attached
            + stalled * fin.plate * alpha.sin().powi(2);
        let pressure = 0.5 * self.density * speed * speed * fin.area;
        let ahead = (chord * u + normal * w) / speed;
        let across = (normal * u - chord * w) / speed;
        force_at(&((across * lift - ahead * drag) * pressure), &fin.position)
    }

    /// Wrench of the tether at the vehicle's twist relative to the water; `gravity` in vehicle axes, m/s2.
    pub fn tether_wrench(&self, relative: &Vector6<f64>, gravity: &Vector3<f64>) -> Vector6<f64> {
        let Some(tether) = &self.tether else { return Vector6::zeros() };
        let v = linear(relative) + angular(relative).cross(&tether.position);
        let (half, d) = (tether.length / 2.0, tether.diameter);
        let displaced = self.density * std::f64::consts::PI * d * d / 4.0;
        let weight = gravity * (half * (tether.mass_per_length - displaced));
        let drag = v * (-0.5 * self.density * tether.drag * d * half * v.norm());
        force_at(&(weight + drag), &tether.position)
    }
}
