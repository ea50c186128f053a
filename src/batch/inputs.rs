//! What a caller applies to all instances, and its check.

use super::step::Switches;
use super::table::InstanceLoads;
use crate::control::{Allocation, THRUSTERS, Thrusts};
use crate::error::SimulatorError;

/// Loads on all instances over one call, row-major by instance; an absent one is zero.
#[derive(Debug, Clone, Copy, Default)]
pub struct Inputs<'a> {
    /// Thrust, (N, thrusters), N; saturates at each thruster's limits.
    pub thrust: Option<&'a [f64]>,
    /// Wrench on the vehicle, (N, 6), body frame at its origin, N and N m; on top of the thrust.
    pub wrench: Option<&'a [f64]>,
    /// Actuator torques, (N, n), N m or N; with the servo's, saturate at each joint's effort.
    pub joint_torque: Option<&'a [f64]>,
    /// Servo targets, (N, n, k) with k <= 4: polynomials in the time since the call, constant term first, rad or m.
    /// Servos are on where targets are given.
    pub joint_target: Option<&'a [f64]>,
    /// External wrenches, (N, n + 1, 6), vehicle first, each in its body's frame at its origin, N and N m.
    pub external: Option<&'a [f64]>,
    /// Station for the vehicle's servo, (N, 12): position, then rotation by rows. The servo is on where it is given.
    pub station: Option<&'a [f64]>,
}

/// Checked inputs, one instance at a time.
pub(super) struct Applied<'a> {
    inputs: Inputs<'a>,
    allocation: &'a Allocation,
    joints: usize,
    terms: usize,
}

impl<'a> Applied<'a> {
    /// Checks lengths and that all numbers are finite.
    pub fn new(
        inputs: &Inputs<'a>,
        allocation: &'a Allocation,
        instances: usize,
        joints: usize,
    ) -> Result<Self, SimulatorError> {
        let thrusters = allocation.count();
        let terms = inputs.joint_target.map_or(0, |t| t.len() / (instances * joints).max(1));
        let expected = [
            ("thrust", inputs.thrust, thrusters),
            ("wrench", inputs.wrench, 6),
            ("joint_torque", inputs.joint_torque, joints),
            ("joint_target", inputs.joint_target, joints * terms.clamp(1, 4)),
            ("external", inputs.external, 6 * (joints + 1)),
            ("station", inputs.station, 12),
        ];
        for (name, values, width) in expected {
            let Some(values) = values else { continue };
            if values.len() != instances * width {
                return Err(SimulatorError::Length { name, expected: instances * width, got: values.len() });
            }
            if let Some(at) = values.iter().position(|x| !x.is_finite()) {
                return Err(SimulatorError::NotFinite {
                    name,
                    instance: at / width,
                    entry: at % width,
                    value: values[at],
                });
            }
        }
        Ok(Self { inputs: *inputs, allocation, joints, terms })
    }

    /// Which loads are on.
    pub fn switches(&self) -> Switches {
        Switches {
            servo: self.inputs.joint_target.is_some(),
            on_links: self.inputs.external.is_some(),
            station: self.inputs.station.is_some(),
        }
    }

    /// Thrust of instance `i` within limits.
    pub fn thrust(&self, i: usize) -> Thrusts {
        let m = self.allocation.count();
        let mut thrusts = [0.0; THRUSTERS];
        if let Some(given) = self.inputs.thrust {
            for k in 0..m {
                let [low, high] = self.allocation.limits(k);
                thrusts[k] = given[i * m + k].clamp(low, high);
            }
        }
        thrusts
    }

    /// Loads of instance `i`.
    pub fn fill(&self, i: usize, loads: &mut InstanceLoads) {
        let (n, inputs) = (self.joints, &self.inputs);
        let row = |values: Option<&'a [f64]>, width: usize| values.map(|v| &v[i * width..(i + 1) * width]);
        loads.wrench = if inputs.thrust.is_some() { self.allocation.wrench(&self.thrust(i)).into() } else { [0.0; 6] };
        let external = row(inputs.external, 6 * (n + 1));
        for extra in [row(inputs.wrench, 6), external.map(|e| &e[..6])].into_iter().flatten() {
            for k in 0..6 {
                loads.wrench[k] += extra[k];
            }
        }
        for k in 0..n {
            loads.torque[k] = row(inputs.joint_torque, n).map_or(0.0, |t| t[k]);
            if let Some(target) = row(inputs.joint_target, n * self.terms) {
                loads.target[k] = [0.0; 4];
                loads.target[k][..self.terms].copy_from_slice(&target[k * self.terms..(k + 1) * self.terms]);
            }
            if let Some(external) = external {
                loads.links[k].copy_from_slice(&external[6 * (k + 1)..6 * (k + 2)]);
            }
        }
        if let Some(station) = row(inputs.station, 12) {
            loads.station.1 = nalgebra::Vector3::from_column_slice(&station[..3]);
            loads.station.0 = nalgebra::Matrix3::from_row_slice(&station[3..]);
        }
    }
}
