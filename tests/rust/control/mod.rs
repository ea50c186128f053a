//! Controllers and thruster allocation.

mod mlp;
