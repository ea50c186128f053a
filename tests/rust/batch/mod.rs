//! Many instances at once.

mod adjoint;
mod aligned;
mod derivatives;
mod error_estimate;
mod fill;
pub mod inputs;
mod instances;
mod own_scenes;
mod precision;
mod task;
mod task_scenes;
mod threads;
