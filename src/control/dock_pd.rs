//! PD docking with a limited approach speed.

use serde::{Deserialize, Serialize};

use super::ActionMap;
use super::controller::{Controller, Widths};
use super::gains::{self, GainMap};
use super::indices::ObservationIndices;
use crate::description::VehicleServo;
use crate::error::ControlError;

/// Gains of [`DockPd`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DockPdGains {
    /// Proportional gains, N/m and N m/rad.
    pub kp: [f64; 6],
    /// Derivative gains, N s/m and N m s/rad.
    pub kd: [f64; 6],
    /// Maximum speed of approach, m/s.
    pub approach_speed: f64,
    /// Maximum angular speed of approach, rad/s.
    pub turn_speed: f64,
}

impl DockPdGains {
    /// Gains of a vehicle's PD with the default speeds of approach.
    pub fn from_pd(VehicleServo { kp, kd }: VehicleServo) -> Self {
        Self { kp, kd, approach_speed: 0.5, turn_speed: 0.3 }
    }
}

impl Default for DockPdGains {
    fn default() -> Self {
        Self::from_pd(VehicleServo::default())
    }
}

/// PD on a clipped error: `F = -kp sat(e) - kd V_r` with the pose error e and the twist V_r relative to the dock, which feeds
/// the dock's velocity forward. `sat` scales the error's linear and angular parts down together where the velocity at
/// which both terms balance, `-kp e / kd`, is above the speed of approach.
#[derive(Debug, Clone, PartialEq)]
pub struct DockPd {
    indices: ObservationIndices,
    gains: DockPdGains,
    actions: ActionMap,
}

impl DockPd {
    /// A controller that reads observations at `indices`, the twist relative to the dock, and gives actions of `actions`.
    ///
    /// # Errors
    /// `ControlError::Gain` for a gain that is not finite or is negative.
    pub fn new(indices: ObservationIndices, gains: DockPdGains, actions: ActionMap) -> Result<Self, ControlError> {
        gains::check(&gains)?;
        Ok(Self { indices, gains, actions })
    }

    /// Body wrench (N, N m) at one row of observations.
    fn wrench(&self, observation: &[f32]) -> nalgebra::Vector6<f64> {
        let DockPdGains { kp, kd, approach_speed, turn_speed } = &self.gains;
        let read = |(offset, scale): (usize, f64)| f64::from(observation[offset]) * scale;
        let (error, twist) = (self.indices.error.map(read), self.indices.twist.map(read));
        let balance = |k: usize| if kd[k] > 0.0 { kp[k] * error[k] / kd[k] } else { 0.0 };
        let clip = |axes: std::ops::Range<usize>, limit: f64| {
            let speed = axes.map(balance).map(|v| v * v).sum::<f64>().sqrt();
            if speed > limit { limit / speed } else { 1.0 }
        };
        let clips = [clip(0..3, *approach_speed), clip(3..6, *turn_speed)];
        nalgebra::Vector6::from_fn(|k, _| -kp[k] * clips[k / 3] * error[k] - kd[k] * twist[k])
    }
}

impl Controller for DockPd {
    fn widths(&self) -> Widths {
        Widths { observation: self.indices.width, memory: 0, action: self.actions.len() }
    }

    fn gains(&self) -> GainMap {
        gains::to_map(&self.gains)
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().each_row(observations, memory, actions, |observation, _, action| {
            self.actions.normalise(&self.wrench(observation), action);
        })
    }
}
