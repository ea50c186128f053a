//! A scene compiled for computation, and its state.

mod chain;
mod compile;
mod model;
mod state;

pub use compile::compile;
pub use model::{BodyTerms, Friction, JointTerms, Limits, Servo, Stand, System, VehicleServo};
pub use state::{JOINTS, Joints, State};
