//! PD station keeping.

use nalgebra as na;

use super::ActionMap;
use super::controller::{Controller, Widths};
use super::gains::{self, GainMap};
use super::indices::ObservationIndices;
use crate::description::VehicleServo;
use crate::error::ControlError;
use crate::lane::Lane;
use crate::lie::Vector6;

/// PD on the vehicle, `F = -kp e - kd V` `[HC sec. 5.2]`, with the attitude error "log" of the observations: the rotation
/// vector `log(R_d^T R)`. The vehicle's servo within the stages, which a pose target turns on, uses "vee":
/// `vee(R_d^T R - R^T R_d) / 2`. Joints have PD servos of their own, which belong to the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Pd {
    indices: ObservationIndices,
    gains: VehicleServo,
    actions: ActionMap,
}

impl Pd {
    /// A PD that reads observations at `indices` and gives actions of `actions`.
    ///
    /// # Errors
    /// `ControlError::Gain` for a gain that is not finite or is negative.
    pub fn new(indices: ObservationIndices, gains: VehicleServo, actions: ActionMap) -> Result<Self, ControlError> {
        gains::check(&gains)?;
        Ok(Self { indices, gains, actions })
    }

    /// Indices of the entries that it reads.
    pub fn indices(&self) -> &ObservationIndices {
        &self.indices
    }

    /// Meaning of its actions.
    pub(super) fn actions(&self) -> &ActionMap {
        &self.actions
    }

    /// Pose error (m, rad) at one row of observations.
    #[inline(always)]
    pub(super) fn error(&self, observation: &[f32]) -> [f64; 6] {
        let mut error = [0.0; 6];
        for k in 0..6 {
            error[k] = read(observation, self.indices.error[k]);
        }
        error
    }

    /// `-kp e - kd V` in lanes.
    #[inline(always)]
    pub(super) fn feedback<L: Lane<Real = f64>>(&self, error: &Vector6<L>, twist: &Vector6<L>) -> Vector6<L> {
        feedback(&self.gains.kp, &self.gains.kd, error, twist)
    }

    /// Body wrench `-kp e - kd V` (N, N m) at one row of observations.
    #[inline(always)]
    pub fn wrench(&self, observation: &[f32]) -> na::Vector6<f64> {
        let (kp, kd) = (&self.gains.kp, &self.gains.kd);
        let mut wrench = self.error(observation);
        for k in 0..6 {
            wrench[k] = -kp[k] * wrench[k] - kd[k] * read(observation, self.indices.twist[k]);
        }
        wrench.into()
    }
}

/// `-kp e - kd V` in lanes.
#[inline(always)]
pub(super) fn feedback<L: Lane<Real = f64>>(
    kp: &[f64; 6],
    kd: &[f64; 6],
    error: &Vector6<L>,
    twist: &Vector6<L>,
) -> Vector6<L> {
    let (error, twist, mut wrench) = (error.to_array(), twist.to_array(), [L::zero(); 6]);
    for k in 0..6 {
        let damped = L::c(kd[k]) * twist[k];
        wrench[k] = -L::c(kp[k]).mul_add(error[k], damped);
    }
    Vector6::from_array(wrench)
}

impl Controller for Pd {
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

#[inline(always)]
fn read(observation: &[f32], (offset, scale): (usize, f64)) -> f64 {
    f64::from(observation[offset]) * scale
}
