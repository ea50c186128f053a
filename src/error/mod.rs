//! Errors, one enum per boundary. The text of each error says what its fields are.

#![allow(missing_docs)]

mod control;
mod dynamics;
mod memory;
mod planning;
mod policy;
mod render;
mod scene;
mod sensors;
mod simulator;
mod task;

pub use control::ControlError;
pub use dynamics::DynamicsError;
pub use memory::OutOfMemory;
pub use planning::PlanningError;
pub use policy::PolicyError;
pub use render::RenderError;
pub use scene::{DescriptionError, Numbers, Problem};
pub use sensors::SensorError;
pub use simulator::SimulatorError;
pub use task::TaskError;
