//! Trajectory optimisation on the steps of a simulator.

mod cost;
mod plan;
mod tangent;
mod tracking;

pub use cost::{reference_width, residuals};
pub use plan::{Plan, Problems, input_argument, input_width, optimize};
pub use tracking::{Numbers, Trajectory};
