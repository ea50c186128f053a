//! Nonlinear model-predictive control by real-time iterations.

pub mod arm_model;
mod gains;
pub mod real_time;
mod tracking;
pub mod vehicle;

pub use gains::NmpcGains;
pub use tracking::TrackingNmpc;
