//! Controllers and thruster allocation.

mod actions;
mod mlp;
mod mpc;
mod resolved_motion;
