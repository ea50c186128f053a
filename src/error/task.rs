//! Errors of tasks: options, starts and actions.

use super::{ControlError, SimulatorError};

/// Invalid option, start or action of a task.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TaskError {
    /// Error of thrusters, gains or array shapes.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// Scene that does not fit the task.
    #[error("scene \"{scene}\" does not fit this task: {reason}")]
    Scene { scene: String, reason: String },
    /// Unknown option, or option of the wrong type.
    #[error("options: {0}")]
    Options(String),
    /// Option out of range.
    #[error("option {name} = {value}: must be {allowed}")]
    Option { name: &'static str, value: f64, allowed: &'static str },
    /// Invalid start override.
    #[error("start {name} = {value}: must be {allowed}")]
    Start { name: &'static str, value: f64, allowed: String },
    /// Invalid disturbance: key and reason.
    #[error("{key}: {reason}")]
    Disturbance { key: String, reason: String },
    /// Action that is not finite. (Actions out of range are clipped.)
    #[error("action {index} of instance {instance} is {value}: must be finite")]
    Action { instance: usize, index: usize, value: f32 },
    /// Step, or partial reset, before the instance's first reset.
    #[error("instance {instance} was never reset: call reset() first")]
    NotBegun { instance: usize },
    /// Step after the end of an episode, without autoreset.
    #[error("the episode of instance {instance} is over: reset it first")]
    Over { instance: usize },
    /// Error of the simulator.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// Malformed saved episode.
    #[error("saved episode: {0}")]
    Saved(String),
}
