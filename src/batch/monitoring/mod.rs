//! Step monitoring: stable steps from a scene's modes beforehand, stiffness and error of the steps during the simulation.

pub mod error_estimate;
pub mod modal_analysis;
pub mod step_monitor;
pub mod step_quality;
