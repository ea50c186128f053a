//! Control of one vehicle: thruster allocation, what an action means, and policies that choose one from observations
//! alone: the paper's PD, PID, feedback on the nominal model, resolved motion, neural networks, and such that correct one of
//! the others.

mod action;
mod actuation;
mod allocation;
mod controller;
mod mlp;
mod model;
mod pd;
mod pid;
mod residual;
mod resolved_motion;

#[cfg(test)]
mod tests;

pub use action::{ActionKind, ActionMap, ActionRange};
pub use actuation::{ACTIONS, Actuated, Actuation};
pub use allocation::{AXES, Allocation, THRUSTERS, Thrusts};
pub use controller::{Controller, NoControl, Widths};
pub use mlp::{Activation, Layer, Mlp, Network, Normalisation, Output, PolicySpec};
pub use model::{
    Arm, Law, ModelControl, ModelGains, ModelIndices, Motion, Mpc, MpcGains, Observing, PdRestoring, Plant, Push,
};
pub use pd::{ObservationIndices, Pd};
pub use pid::Pid;
pub use residual::{BASE_ACTION, Residual};
pub use resolved_motion::{BlockIndices, MOST_DELAY, ResolvedGains, ResolvedMotion, TrackingIndices};
