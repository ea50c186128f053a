//! Stepping: the equations of motion of a stage, the kernels that step blocks, and their distribution over threads.

mod accelerate;
pub mod blocks;
pub mod equations_of_motion;
mod instance_numbers;
mod lagged_added_mass;
mod scratch_pool;
mod step;
pub mod threads;
