//! The paper's PD station keeping, from observations alone.

use nalgebra::Vector6;

use super::ActionMap;
use crate::description::VehicleServo;
use crate::error::ControlError;

/// Where a controller finds what it reads in a row of observations: offset, and the scale that undoes the
/// normalisation.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Length of a row.
    pub width: usize,
    /// Pose error `[R^T (r - r_d); log(R_d^T R)]`, m and rad.
    pub error: [(usize, f64); 6],
    /// Body twist, m/s and rad/s.
    pub twist: [(usize, f64); 6],
}

/// PD on the vehicle, `F = -kp e - kd V`, as the paper controls its vehicle `[HC sec. 5.2]`. The joints are held by
/// their own PD servos, which belong to the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Pd {
    reading: Reading,
    gains: VehicleServo,
    actions: ActionMap,
}

impl Pd {
    /// A PD that reads `reading` and answers with actions of `actions`.
    ///
    /// # Errors
    /// `ControlError::Gain` for a gain that is not finite or is negative.
    pub fn new(reading: Reading, gains: VehicleServo, actions: ActionMap) -> Result<Self, ControlError> {
        for (name, values) in [("kp", &gains.kp), ("kd", &gains.kd)] {
            if let Some((index, &value)) = values.iter().enumerate().find(|(_, k)| !(k.is_finite() && **k >= 0.0)) {
                return Err(ControlError::Gain { name, index, value });
            }
        }
        Ok(Self { reading, gains, actions })
    }

    /// Gains in use.
    pub fn gains(&self) -> &VehicleServo {
        &self.gains
    }

    /// Body wrench (N, N m) that the PD asks for at one row of observations.
    pub fn wrench(&self, observation: &[f32]) -> Vector6<f64> {
        let read = |(offset, scale): (usize, f64)| f64::from(observation[offset]) * scale;
        Vector6::from_fn(|k, _| {
            -self.gains.kp[k] * read(self.reading.error[k]) - self.gains.kd[k] * read(self.reading.twist[k])
        })
    }

    /// Actions (n x action length) for observations (n x observation length), both row by row. Rows are independent.
    ///
    /// # Errors
    /// `ControlError::Shape` if the lengths are no whole rows, or not equally many.
    pub fn act(&self, observations: &[f32], actions: &mut [f32]) -> Result<(), ControlError> {
        let rows = observations.len() / self.reading.width;
        for (what, got, width) in
            [("observations", observations.len(), self.reading.width), ("actions", actions.len(), self.actions.len())]
        {
            if got != rows * width {
                return Err(ControlError::Shape { what, got, expected: rows * width });
            }
        }
        let inputs = observations.chunks_exact(self.reading.width);
        for (observation, action) in inputs.zip(actions.chunks_exact_mut(self.actions.len().max(1))) {
            self.actions.normalise(&self.wrench(observation), action);
        }
        Ok(())
    }
}
