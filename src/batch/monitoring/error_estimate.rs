//! Estimated error of an instance.

use std::fmt;

use super::step_monitor::digits;
use super::step_quality::{KNOWN_LIMIT, maximum};
use crate::system::{JOINTS, Joints};

/// Estimated error that has accumulated in the state of an instance since its state was set: see
/// `stepping::companion`.
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
    /// The maximum error of pose, joints and velocities relative to the scales of the motion since the state was set; in scenes
    /// with contact without the velocities, which jump.
    pub relative: f64,
}

impl ErrorEstimate {
    /// No error.
    pub const ZERO: Self = Self {
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
        let joints = self.q.into_iter().fold(0.0, maximum);
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
