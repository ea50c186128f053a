//! States of all instances, checked completely before any is set.

use nalgebra as na;

use super::Simulator;
use crate::batch::storage::inputs::{check, check_rotation};
use crate::error::SimulatorError;
use crate::system::{Flow, State, rotation};

/// Parts of the states of all instances, row-major by instance; an absent one stays as it is.
#[derive(Debug, Clone, Copy, Default)]
pub struct States<'a> {
    /// Vehicle origin in the world, (N, 3), m.
    pub position: Option<&'a [f64]>,
    /// Body to world rotation by rows, (N, 9).
    pub rotation: Option<&'a [f64]>,
    /// Attitude as quaternions `[w, x, y, z]` of any length but 0, (N, 4).
    pub quaternion: Option<&'a [f64]>,
    /// Absolute body twist, (N, 6), m/s and rad/s.
    pub twist: Option<&'a [f64]>,
    /// Joint coordinates, (N, n), rad or m.
    pub q: Option<&'a [f64]>,
    /// Joint rates, (N, n), rad/s or m/s.
    pub qd: Option<&'a [f64]>,
    /// Thrusts in still water, (N, m), N: of scenes whose thrusters have dynamics.
    pub thrust: Option<&'a [f64]>,
    /// Time, (N), s.
    pub time: Option<&'a [f64]>,
    /// Current in world axes, (N, 3), m/s.
    pub current: Option<&'a [f64]>,
    /// Acceleration of that current, (N, 3), m/s^2.
    pub current_acceleration: Option<&'a [f64]>,
}

impl Simulator {
    /// Puts all instances at the scene's home, at rest at time 0, in the scene's current.
    pub fn reset(&mut self) {
        for i in 0..self.instances() {
            let scene = self.scene_of(i);
            let (state, flow) = (State { q: scene.home(), ..State::default() }, Flow::from(scene.water.current));
            self.set_state(i, &state);
            self.set_flow(i, flow);
        }
    }

    /// Sets parts of the states of all instances.
    ///
    /// # Errors
    /// [`SimulatorError`] where a part has the wrong length, a number that is not finite, a matrix that is no rotation, a
    /// quaternion without direction, motion of a held vehicle, or acceleration of water without gravity; nothing has changed then.
    pub fn set_states(&mut self, states: &States) -> Result<(), SimulatorError> {
        let (joints, thrusters) = (self.joints(), self.allocation().count());
        let widths = [
            ("position", states.position, 3),
            ("rotation", states.rotation, 9),
            ("quaternion", states.quaternion, 4),
            ("twist", states.twist, 6),
            ("q", states.q, joints),
            ("qd", states.qd, joints),
            ("thrust", states.thrust, thrusters),
            ("time", states.time, 1),
            ("current", states.current, 3),
            ("current_acceleration", states.current_acceleration, 3),
        ];
        for (name, values, width) in widths {
            check(name, values, width, self.options())?;
        }
        let scene = self.scene();
        if scene.vehicle.fixed
            && let Some(at) = first_nonzero(states.twist)
        {
            return Err(SimulatorError::FixedVehicle { scene: scene.name.clone(), instance: at / 6 });
        }
        self.check_thrust(states.thrust)?;
        let weightless = |&i: &usize| self.scene_of(i).water.gravity.norm() == 0.0;
        let accelerated = |i: &usize| {
            states.current_acceleration.is_some_and(|rows| rows[3 * i..3 * i + 3].iter().any(|x| *x != 0.0))
        };
        if let Some(instance) = (0..self.instances()).filter(weightless).find(accelerated) {
            return Err(SimulatorError::Weightless { scene: self.scene_of(instance).name.clone(), instance });
        }
        let rotations = self.rotations(states)?;
        let sets_state = widths.iter().any(|(name, values, _)| values.is_some() && !name.starts_with("current"));
        for i in 0..self.instances() {
            let mut flow = self.flow(i);
            set(flow.velocity.as_mut_slice(), states.current, i);
            set(flow.acceleration.as_mut_slice(), states.current_acceleration, i);
            self.set_flow(i, flow);
            if !sets_state {
                continue;
            }
            let mut state = self.state(i);
            let attitude = self.storage.attitude(i);
            set(state.position.as_mut_slice(), states.position, i);
            set(state.twist.as_mut_slice(), states.twist, i);
            set(&mut state.q[..joints], states.q, i);
            set(&mut state.qd[..joints], states.qd, i);
            set(&mut state.thrust[..thrusters], states.thrust, i);
            set(std::slice::from_mut(&mut state.time), states.time, i);
            if let Some(rotations) = &rotations {
                state.rotation = rotations[i];
            }
            self.set_state(i, &state);
            if let (None, Some(attitude)) = (&rotations, attitude) {
                self.storage.set_attitude(i, &attitude);
            }
        }
        Ok(())
    }

    /// Checks that thrusts are states of the scene and within their limits.
    fn check_thrust(&self, thrust: Option<&[f64]>) -> Result<(), SimulatorError> {
        let Some(thrust) = thrust else { return Ok(()) };
        if !self.scene().vehicle.has_thruster_dynamics() {
            return Err(SimulatorError::NoThrusterState { scene: self.scene().name.clone() });
        }
        let count = self.allocation().count().max(1);
        for (at, &value) in thrust.iter().enumerate() {
            let [lower, upper] = self.allocation_of(at / count).limits(at % count);
            if !(lower..=upper).contains(&value) {
                return Err(SimulatorError::Thrust { instance: at / count, thruster: at % count, value, lower, upper });
            }
        }
        Ok(())
    }

    /// The rotations given, orthonormal to rounding.
    fn rotations(&self, states: &States) -> Result<Option<Vec<na::Matrix3<f64>>>, SimulatorError> {
        let rounding = 8.0 * self.options().precision.epsilon();
        match (states.rotation, states.quaternion) {
            (None, None) => Ok(None),
            (Some(_), Some(_)) => Err(SimulatorError::TwoAttitudes),
            (Some(rows), None) => {
                let clean = |(i, row)| {
                    let rotation = na::Matrix3::from_row_slice(row);
                    let exact = check_rotation("rotation", i, &rotation)? <= rounding;
                    Ok(if exact { rotation } else { orthonormalised(&rotation) })
                };
                rows.chunks_exact(9).enumerate().map(clean).collect::<Result<_, _>>().map(Some)
            }
            (None, Some(rows)) => {
                let turn = |(instance, row): (usize, &[f64; 4])| {
                    let length = row.iter().map(|x| x * x).sum::<f64>().sqrt();
                    let unit = row.map(|c| c / length);
                    if length.is_normal() { Ok(rotation(&unit)) } else { Err(SimulatorError::NoAttitude { instance }) }
                };
                rows.as_chunks().0.iter().enumerate().map(turn).collect::<Result<_, _>>().map(Some)
            }
        }
    }
}

/// The nearest rotation, by two of Newton's steps.
pub(super) fn orthonormalised(r: &na::Matrix3<f64>) -> na::Matrix3<f64> {
    let step = |r: &na::Matrix3<f64>| r * (na::Matrix3::identity() * 3.0 - r.tr_mul(r)) * 0.5;
    step(&step(r))
}

/// Index of the first number that is not zero.
fn first_nonzero(numbers: Option<&[f64]>) -> Option<usize> {
    numbers?.iter().position(|x| *x != 0.0)
}

/// Overwrites `to` with row `i`, if rows are given.
fn set(to: &mut [f64], rows: Option<&[f64]>, i: usize) {
    if let Some(rows) = rows {
        to.copy_from_slice(&rows[i * to.len()..(i + 1) * to.len()]);
    }
}
