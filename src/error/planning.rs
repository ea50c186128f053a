//! Errors of trajectory optimisation.

use super::SimulatorError;

/// Invalid problem of trajectory optimisation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanningError {
    /// No knots or substeps.
    #[error("{name} must be at least 1")]
    Count { name: &'static str },
    /// Nothing to choose.
    #[error("inputs is empty: name at least one of {}", known.join(", "))]
    NoInputs { known: Vec<&'static str> },
    /// Input that the scene does not have, or that cannot be chosen.
    #[error("inputs: '{name}' is not an input of scene '{scene}', which has: {}", known.join(", "))]
    UnknownInput { name: String, scene: String, known: Vec<&'static str> },
    /// Array of the wrong length.
    #[error("{name} has {got} numbers, but must have {expected}")]
    Length { name: &'static str, expected: usize, got: usize },
    /// NaN or infinite number.
    #[error("{name} of problem {problem}, knot {knot}, entry {entry}, is {value}, but must be {allowed}")]
    Number { name: &'static str, problem: usize, knot: usize, entry: usize, value: f64, allowed: &'static str },
    /// Bounds without a number between them.
    #[error("bounds of {name} of problem {problem}, knot {knot}, entry {entry}: {lower} is not below {upper}")]
    Bounds { name: &'static str, problem: usize, knot: usize, entry: usize, lower: f64, upper: f64 },
    /// Inputs at the start under which the motion diverges.
    #[error("problem {problem}: the motion under its initial inputs is not finite, or its cost or derivatives are not")]
    Diverged { problem: usize },
    /// Single precision.
    #[error("trajectories are optimised in float64: make the simulator with dtype='float64'")]
    Precision,
    /// Error of the simulator.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
}
