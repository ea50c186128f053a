//! Estimates of accumulated errors.

use nalgebra as na;

use super::Simulator;
use crate::batch::monitoring::error_estimate::ErrorEstimate;
use crate::batch::stepping::track::divisor;
use crate::system::{EndEffector, rotation_vector};

impl Simulator {
    /// Estimated errors of all instances; none where the options do not ask for them.
    pub fn error_estimates(&self) -> Option<Vec<ErrorEstimate>> {
        (0..self.instances()).map(|i| self.error_estimate(i)).collect()
    }

    /// Estimated errors of instance `i`; none where the options do not ask for them.
    pub fn error_estimate(&self, i: usize) -> Option<ErrorEstimate> {
        let asked = self.options.error_estimate == Some(true);
        asked.then(|| self.estimate_of(i).unwrap_or(ErrorEstimate::ZERO))
    }

    /// Estimated errors of instance `i`, where a companion follows it.
    pub(in crate::batch) fn estimate_of(&self, i: usize) -> Option<ErrorEstimate> {
        let (other, relative) = self.storage.companion(i)?;
        let end_effector = EndEffector::new(self.scene_of(i));
        let state = self.state(i);
        let ends = [&state, &other].map(|state| {
            let (rotation, position) = end_effector.pose(&state.q);
            (state.rotation * rotation, state.position + state.rotation * position)
        });
        let error = |difference: f64| difference / divisor(self.integrator.order());
        Some(ErrorEstimate {
            position: error((other.position - state.position).norm()),
            attitude: error(angle(&state.rotation, &other.rotation)),
            q: std::array::from_fn(|k| error((other.q[k] - state.q[k]).abs())),
            end_effector_position: error((ends[1].1 - ends[0].1).norm()),
            end_effector_attitude: error(angle(&ends[0].0, &ends[1].0)),
            relative,
        })
    }
}

/// Angle between two rotations.
fn angle(a: &na::Matrix3<f64>, b: &na::Matrix3<f64>) -> f64 {
    rotation_vector(&a.tr_mul(b)).norm()
}
