//! Estimates of accumulated errors.

use nalgebra as na;

use super::Simulator;
use crate::batch::monitoring::error_estimate::ErrorEstimate;
use crate::batch::options::Precision;
use crate::system::{EndEffector, rotation_vector};

/// Divisor where both motions err by independent rounding: `sqrt(1 + 3/5)`.
const ROUNDING_DIVISOR: f64 = 1.26;
/// Differences in single precision up to which they are rounding, and from which on none of it, m and rad.
const ROUNDING: [f64; 2] = [1e-6, 1e-4];

impl Simulator {
    /// Estimated errors of all instances; none where the options do not ask for them.
    pub fn error_estimates(&self) -> Option<Vec<ErrorEstimate>> {
        (0..self.instances()).map(|i| self.error_estimate(i)).collect()
    }

    /// Estimated errors of instance `i`; none where the options do not ask for them.
    pub fn error_estimate(&self, i: usize) -> Option<ErrorEstimate> {
        if !self.options.error_estimate {
            return None;
        }
        let Some((other, divisor)) = self.storage.companion(i) else { return Some(ErrorEstimate::ZERO) };
        let end_effector = EndEffector::new(self.scene_of(i));
        let state = self.state(i);
        let ends = [&state, &other].map(|state| {
            let (rotation, position) = end_effector.pose(&state.q);
            (state.rotation * rotation, state.position + state.rotation * position)
        });
        let error = |difference: f64| difference / self.divisor_of(difference, divisor);
        Some(ErrorEstimate {
            position: error((other.position - state.position).norm()),
            attitude: error(angle(&state.rotation, &other.rotation)),
            q: std::array::from_fn(|k| error((other.q[k] - state.q[k]).abs())),
            end_effector_position: error((ends[1].1 - ends[0].1).norm()),
            end_effector_attitude: error(angle(&ends[0].0, &ends[1].0)),
            relative: self.storage.step_quality(i, self.options.dt).accumulated,
        })
    }

    /// Divisor of a difference: in single precision that of rounding where it is small.
    fn divisor_of(&self, difference: f64, divisor: f64) -> f64 {
        if self.options.precision == Precision::Double {
            return divisor;
        }
        let share = (difference / ROUNDING[0]).ln() / (ROUNDING[1] / ROUNDING[0]).ln();
        let least = ROUNDING_DIVISOR.min(divisor);
        least * (divisor / least).powf(share.clamp(0.0, 1.0))
    }
}

/// Angle between two rotations.
fn angle(a: &na::Matrix3<f64>, b: &na::Matrix3<f64>) -> f64 {
    rotation_vector(&a.tr_mul(b)).norm()
}
