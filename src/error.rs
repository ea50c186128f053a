//! Errors, one enum per boundary.

use thiserror::Error;

/// A vehicle that cannot be controlled as described, or arguments of the wrong shape.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ControlError {
    /// Saturation by uniform scaling needs zero thrust to be possible.
    #[error("thruster \"{name}\": limits [{lower}, {upper}] N must be finite, with lower <= 0 <= upper")]
    ThrusterLimits { name: String, lower: f64, upper: f64 },
    /// No direction, or no place.
    #[error("thruster \"{name}\": position {position:?} and axis {axis:?} must be finite, and the axis not zero")]
    ThrusterGeometry { name: String, position: [f64; 3], axis: [f64; 3] },
    /// More than the arrays hold.
    #[error("{count} thrusters: at most {greatest} are supported")]
    TooManyThrusters { count: usize, greatest: usize },
    /// A gain that is no number, or that would drive the vehicle away.
    #[error("gain {name}[{index}] = {value}: must be finite and not negative")]
    Gain { name: &'static str, index: usize, value: f64 },
    /// Arrays that do not fit together.
    #[error("{what}: {got} numbers, expected {expected}")]
    Shape { what: &'static str, got: usize, expected: usize },
}

/// A task that cannot be set up, or started, as asked.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TaskError {
    /// Thrusters, gains, shapes.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// The scene lacks what the task needs.
    #[error("scene \"{scene}\" cannot keep station: {reason}")]
    Scene { scene: String, reason: String },
    /// An option out of its range.
    #[error("option {name} = {value}: must be {allowed}")]
    Option { name: &'static str, value: f64, allowed: &'static str },
    /// A start override that is no start.
    #[error("start {name} = {value}: must be {allowed}")]
    Start { name: &'static str, value: f64, allowed: String },
    /// An action that is no number; out of range is clipped instead.
    #[error("action {index} of instance {instance} is {value}: must be finite")]
    Action { instance: usize, index: usize, value: f32 },
    /// Numbers that are not a saved episode.
    #[error("saved episode: {0}")]
    Saved(String),
}
