//! Control of one vehicle: thruster allocation, the meaning of an action, and controllers from observations alone.

mod action;
mod actuation;
mod allocation;
mod computed_torque;
mod controller;
mod dob;
mod gains;
mod indices;
mod kalman;
mod mlp;
mod model_based;
mod mpc;
mod observer;
mod pd;
mod pd_restoring;
mod pid;
mod plant;
mod residual;
mod resolved_motion;
mod rows;

#[cfg(test)]
mod tests;

pub use action::{ActionKind, ActionMap, ActionRange};
pub use actuation::{ACTIONS, Actuated, Actuation};
pub use allocation::{AXES, Allocation, THRUSTERS, Thrusts};
pub use controller::{Controller, NoControl, Widths};
pub use dob::FeedbackGains;
pub use gains::{GainMap, gain_names, gain_value, merge};
pub use indices::{ATTITUDE_LEVER, BlockIndices, ModelIndices, ObservationIndices};
pub use mlp::{Activation, Layer, Mlp, Network, Normalisation, Output, PolicySpec};
pub use model_based::ModelBased;
pub use mpc::MpcGains;
pub use observer::ObserverGains;
pub use pd::Pd;
pub use pd_restoring::PdRestoring;
pub use pid::{Pid, PidGains};
pub use plant::{AppliedWrenches, ArmMotion, Plant, VehicleMotion};
pub use residual::{BASE_ACTION, Residual};
pub use resolved_motion::{MAX_DELAY, ResolvedMotion, ResolvedMotionGains, TrackingIndices};
