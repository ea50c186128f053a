//! Nonlinear model-predictive control by real-time iterations.

mod gains;
pub mod real_time;
mod tracking;
pub mod tracking_model;
pub mod vehicle;

pub use gains::NmpcGains;
pub use tracking::TrackingNmpc;
