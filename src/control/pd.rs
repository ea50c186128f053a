//! The paper's PD station keeping, from observations alone.

use nalgebra as na;

use super::ActionMap;
use super::controller::{Controller, Widths};
use crate::description::VehicleServo;
use crate::error::ControlError;
use crate::lane::Lane;
use crate::lie::Vector6;

/// Where a controller finds what it reads in a row of observations: offset, and the scale that undoes the
/// normalisation.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservationIndices {
    /// Length of a row.
    pub width: usize,
    /// Pose error `[R^T (r - r_d); log(R_d^T R)]`, m and rad.
    pub error: [(usize, f64); 6],
    /// Body twist, m/s and rad/s.
    pub twist: [(usize, f64); 6],
}

/// PD on the vehicle, `F = -kp e - kd V` `[HC sec. 5.2]`, with the attitude error "log" of the observations: the rotation
/// vector `log(R_d^T R)`. The vehicle's servo within the stages, which a pose target turns on, uses "vee":
/// `vee(R_d^T R - R^T R_d) / 2`. Joints are held by their own PD servos, which belong to the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Pd {
    reading: ObservationIndices,
    gains: VehicleServo,
    actions: ActionMap,
}

impl Pd {
    /// A PD that reads `reading` and answers with actions of `actions`.
    ///
    /// # Errors
    /// `ControlError::Gain` for a gain that is not finite or is negative.
    pub fn new(reading: ObservationIndices, gains: VehicleServo, actions: ActionMap) -> Result<Self, ControlError> {
        check_gains("kp", &gains.kp)?;
        check_gains("kd", &gains.kd)?;
        Ok(Self { reading, gains, actions })
    }

    /// Gains in use.
    pub fn gains(&self) -> &VehicleServo {
        &self.gains
    }

    /// What it reads.
    pub fn reading(&self) -> &ObservationIndices {
        &self.reading
    }

    /// What its actions mean.
    pub(super) fn actions(&self) -> &ActionMap {
        &self.actions
    }

    /// Pose error (m, rad) at one row of observations.
    pub(super) fn error(&self, observation: &[f32]) -> na::Vector6<f64> {
        na::Vector6::from_fn(|k, _| read(observation, self.reading.error[k]))
    }

    /// `-kp e - kd V` in lanes.
    #[inline(always)]
    pub(super) fn feedback<L: Lane<Real = f64>>(&self, error: &Vector6<L>, twist: &Vector6<L>) -> Vector6<L> {
        let (error, twist, mut wrench) = (error.to_array(), twist.to_array(), [L::zero(); 6]);
        for k in 0..6 {
            let damped = L::c(self.gains.kd[k]) * twist[k];
            wrench[k] = -L::c(self.gains.kp[k]).mul_add(error[k], damped);
        }
        Vector6::from_array(wrench)
    }

    /// Body wrench (N, N m) that the PD asks for at one row of observations.
    #[inline(always)]
    pub fn wrench(&self, observation: &[f32]) -> na::Vector6<f64> {
        let (kp, kd) = (&self.gains.kp, &self.gains.kd);
        let error = self.error(observation);
        na::Vector6::from_fn(|k, _| -kp[k] * error[k] - kd[k] * read(observation, self.reading.twist[k]))
    }
}

impl Controller for Pd {
    fn widths(&self) -> Widths {
        Widths { observation: self.reading.width, memory: 0, action: self.actions.len() }
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().rows(observations, memory, actions)?;
        let rows = observations.chunks_exact(self.reading.width);
        for (observation, action) in rows.zip(actions.chunks_exact_mut(self.actions.len().max(1))) {
            self.actions.normalise(&self.wrench(observation), action);
        }
        Ok(())
    }
}

/// Refuses gains that are not finite, or that push the wrong way.
pub(super) fn check_gains(name: &'static str, gains: &[f64]) -> Result<(), ControlError> {
    match gains.iter().enumerate().find(|(_, k)| !(k.is_finite() && **k >= 0.0)) {
        None => Ok(()),
        Some((index, &value)) => Err(ControlError::Gain { name, index, value }),
    }
}

fn read(observation: &[f32], (offset, scale): (usize, f64)) -> f64 {
    f64::from(observation[offset]) * scale
}
