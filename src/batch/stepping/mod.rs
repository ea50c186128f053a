//! Stepping: the equations of motion of a stage, the kernels that step blocks, and their distribution over threads.

mod accelerate;
pub mod adjoint;
pub mod blocks;
pub mod chunk;
pub mod companion;
pub mod derivative;
pub mod equations_of_motion;
mod equations_of_motion_adjoint;
mod joint_coordinates;
mod lagged_added_mass;
pub mod parameters;
mod reverse;
#[allow(unsafe_code)]
pub mod step;
pub mod threads;
pub mod track;
