//! Nonlinear model-predictive control by real-time iterations.

mod arm_model;
mod gains;
mod real_time;
mod tracking;
pub mod vehicle;

pub use gains::NmpcGains;
pub use tracking::TrackingNmpc;

/// Weight on thrusts that cancel each other, over that of the maximum effort.
const CANCELLING: f64 = 1e3;
