//! Errors of thruster allocation and controllers.

/// Invalid thrusters, gains, models or array shapes.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ControlError {
    /// Limits that exclude zero thrust, which saturation by uniform scaling needs.
    #[error("thruster \"{name}\": limits [{lower}, {upper}] N must be finite, with lower <= 0 <= upper")]
    ThrusterLimits { name: String, lower: f64, upper: f64 },
    /// Invalid position or axis.
    #[error("thruster \"{name}\": position {position:?} and axis {axis:?} must be finite, and the axis not zero")]
    ThrusterGeometry { name: String, position: [f64; 3], axis: [f64; 3] },
    /// Too many thrusters.
    #[error("{count} thrusters: at most {maximum} are supported")]
    TooManyThrusters { count: usize, maximum: usize },
    /// Scene without a control model.
    #[error("{0}")]
    Model(String),
    /// Gain that is not finite or destabilises.
    #[error("gain {name}[{index}] = {value}: must be finite and not negative")]
    Gain { name: String, index: usize, value: f64 },
    /// Name of no gain.
    #[error("unknown gain '{name}'; known: {known}")]
    UnknownGain { name: String, known: String },
    /// Gain of another length or type.
    #[error("gain {name} is {value}, but must be {expected}")]
    GainShape { name: String, value: String, expected: String },
    /// Bound that is not a fraction of an actuator's limit.
    #[error("{name} is {value}, but must be in [0, 1]")]
    Limit { name: &'static str, value: f64 },
    /// Weights of a mean.
    #[error("the sum of the weights is {sum}, but must be 1")]
    Weights { sum: f64 },
    /// Errors between which a guard hands over.
    #[error("guard is [{from}, {to}], but must be two pose errors in m, the first at least 0 and below the second")]
    Guard { from: f64, to: f64 },
    /// Guard of a single controller.
    #[error("guard hands over from the first controller to the second, but there is only one")]
    NothingToHandOverTo,
    /// Delay beyond the prediction.
    #[error("delay is {periods} control periods, but at most {most} are supported")]
    Delay { periods: usize, most: usize },
    /// Array of the wrong size.
    #[error("{what} has {got} numbers, but must have {expected}")]
    Shape { what: &'static str, got: usize, expected: usize },
    /// Instance out of range.
    #[error("instance is {instance}, but must be from 0 to below {instances}")]
    Instance { instance: usize, instances: usize },
    /// Controller for observations or actions of another size.
    #[error(
        "the policy reads {got} observation entries and gives {gives} action entries, but the environment has {expected} and {takes}"
    )]
    Widths { got: usize, gives: usize, expected: usize, takes: usize },
}
