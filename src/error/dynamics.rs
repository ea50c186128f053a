//! Errors of the closed form of the dynamics.

/// Error of the closed form of the dynamics.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DynamicsError {
    /// Singular mass matrix, which does not determine the accelerations.
    #[error("the mass matrix is not positive definite: some motion of the system has no inertia")]
    NotPositiveDefinite,
    /// Array of the wrong length.
    #[error("{what} has {got} entries, but must have {expected}")]
    Length { what: &'static str, expected: usize, got: usize },
    /// Name that is no end effector's.
    #[error("no end effector \"{name}\"; the scene has {known}")]
    EndEffector { name: String, known: String },
    /// More joints than a state holds.
    #[error("{joints} joints, but at most {max} are supported")]
    Joints { joints: usize, max: usize },
}
