//! Controllers and thruster allocation.

mod actions;
mod equations;
mod mlp;
mod mpc;
mod nmpc;
mod resolved_motion;
