//! Control of one vehicle: thruster allocation, what an action means, and policies that choose one from observations
//! alone: the paper's PD, PID, feedback on the nominal model, resolved motion, neural networks, and such that correct one of
//! the others.

mod action;
mod actuation;
mod allocation;
mod mlp;
mod model;
mod pd;
mod pid;
mod policy;
mod residual;
mod resolved;

#[cfg(test)]
mod tests;

pub use action::{ActionKind, ActionMap, ActionRange};
pub use actuation::{ACTIONS, Actuated, Actuation};
pub use allocation::{AXES, Allocation, THRUSTERS, Thrusts};
pub use mlp::{Activation, Layer, Mlp, Network, Normalisation, Output, Purpose};
pub use model::{
    Arm, Law, ModelControl, ModelGains, ModelReading, Motion, Mpc, MpcGains, Observing, PdRestoring, Plant, Push,
};
pub use pd::{Pd, Reading};
pub use pid::Pid;
pub use policy::{Policy, Rest, Widths};
pub use residual::{BASE_ACTION, Residual};
pub use resolved::{Entries, MOST_DELAY, ResolvedGains, ResolvedMotion, TrackReading};
