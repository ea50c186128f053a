//! Estimates of accumulated errors.

use std::fmt;

use nalgebra as na;

use super::Simulator;
use crate::batch::monitoring::step_quality::KNOWN_LIMIT;
use crate::batch::monitoring::text::digits;
use crate::batch::options::Precision;
use crate::system::{EndEffector, JOINTS, Joints, rotation_vector};

/// Divisor where both motions err by independent rounding: `sqrt(1 + 3/5)`.
const ROUNDING_DIVISOR: f64 = 1.26;
/// Differences in single precision up to which they are rounding, and from which on none of it, m and rad.
const ROUNDING: [f64; 2] = [1e-6, 1e-4];

/// Estimated error that has accumulated in the state of an instance since its state was set: see
/// [`crate::batch::stepping::companion`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorEstimate {
    /// Error of the position, m.
    pub position: f64,
    /// Error of the attitude, rad.
    pub attitude: f64,
    /// Error of each joint, rad or m; 0 past the joint count.
    pub q: Joints,
    /// Error of the position of the end effector, m.
    pub end_effector_position: f64,
    /// Error of the attitude of the end effector, rad.
    pub end_effector_attitude: f64,
    /// The greatest error of pose, joints and velocities relative to the scales of the motion since the state was set.
    pub relative: f64,
}

impl ErrorEstimate {
    /// No error.
    const ZERO: Self = Self {
        position: 0.0,
        attitude: 0.0,
        q: [0.0; JOINTS],
        end_effector_position: 0.0,
        end_effector_attitude: 0.0,
        relative: 0.0,
    };

    /// False where the companion has gone another way: in chaotic motion, or where the step is far too long. The error is then
    /// at least of the size that the estimate gives.
    pub fn known(&self) -> bool {
        self.relative < KNOWN_LIMIT
    }
}

impl fmt::Display for ErrorEstimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let joints = self.q.iter().fold(0.0, |greatest: f64, error| greatest.max(*error));
        write!(f, "position {} m, attitude {} rad, ", digits(self.position), digits(self.attitude))?;
        write!(f, "joints {} rad or m, ", digits(joints))?;
        write!(
            f,
            "end effector {} m and {} rad",
            digits(self.end_effector_position),
            digits(self.end_effector_attitude)
        )
    }
}

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
