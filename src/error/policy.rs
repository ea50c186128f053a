//! Errors of neural-network policies.

/// Malformed policy, or policy for another environment.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PolicyError {
    /// File that is truncated, not in safetensors format, or without a policy.
    #[error("not a policy of uvms_gym: {0}")]
    File(String),
    /// Network without layers.
    #[error("a policy needs at least one layer")]
    NoLayers,
    /// Layer of the wrong size.
    #[error("layer {layer} has {got} weights, but must have {outputs} x {inputs}, and at least one")]
    Layer { layer: usize, outputs: usize, inputs: usize, got: usize },
    /// Inputs that are not a whole number of observations.
    #[error(
        "the policy has {inputs} inputs, but must have a multiple of {history}, its number of stacked observations"
    )]
    History { history: usize, inputs: usize },
    /// Tensor of the wrong length.
    #[error("{tensor} has {got} numbers, but must have {expected}")]
    Length { tensor: String, got: usize, expected: usize },
    /// NaN or infinite number.
    #[error("{tensor}: number {index} is {value}, but must be finite")]
    NotFinite { tensor: String, index: usize, value: f32 },
    /// Number out of range.
    #[error("{name} is {value}, but must be {rule}")]
    Number { name: &'static str, value: f32, rule: &'static str },
    /// Policy for another environment.
    #[error("the policy does not fit: its {what} is {policy}, the environment's {environment}")]
    Mismatch { what: &'static str, policy: String, environment: String },
    /// Unavailable instruction set.
    #[error(transparent)]
    Lanes(#[from] crate::lane::UnknownIsa),
}
