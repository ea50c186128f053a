//! Errors of sensors and of the navigation filter.

/// Invalid settings of sensors, or readings that do not fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SensorError {
    /// Invalid settings: key and reason.
    #[error("{key}: {reason}")]
    Suite { key: String, reason: String },
    /// Time that runs backward.
    #[error(
        "time of instance {instance} is {time} s, but was {before} s at the last call: reset it after a reset of its motion"
    )]
    Time { instance: usize, time: f64, before: f64 },
    /// Unknown sensor.
    #[error("no sensor named '{name}': one of {}", known.join(", "))]
    Unknown { name: String, known: Vec<&'static str> },
    /// Number of instances other than at construction.
    #[error("{got} instances, but there are {expected}")]
    Instances { expected: usize, got: usize },
    /// Update before the filter has a start.
    #[error("instance {instance} of the filter has no start: call reset() first")]
    NotBegun { instance: usize },
}
