//! Errors, one enum per boundary.

use thiserror::Error;

use crate::system::JOINTS;

/// What the closed form refuses.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum BalanceError {
    /// A system whose mass matrix does not determine its accelerations.
    #[error("the mass matrix is not positive definite: some motion of the system meets no inertia")]
    NotPositiveDefinite,
    /// An array of the wrong length.
    #[error("{what}: expected {expected} entries, got {got}")]
    Length {
        /// What the array is.
        what: &'static str,
        /// Length that fits the scene.
        expected: usize,
        /// Its length.
        got: usize,
    },
    /// More joints than a state holds.
    #[error("{joints} joints, but a state holds at most {JOINTS}")]
    Joints {
        /// Joints of the scene.
        joints: usize,
    },
}
