//! A scene compiled for computation, and its state.

mod appendages;
mod attitude;
mod chain;
mod compile;
mod end_effector;
mod model;
mod propulsion;
mod state;
mod variation;

pub use crate::hydro::{THRUSTERS, Thrusts};
pub use attitude::{quaternion, roll_pitch_yaw, rotation, rotation_vector};
pub use compile::{Compiled, compile};
pub use end_effector::EndEffector;
pub use model::{Actuator, BodyTerms, Constant, Friction, JointTerms, Limits, Servo, Stand, System, VehicleServo};
pub use state::{Flow, JOINTS, Joints, State};
pub use variation::{FACTORS, Factors, Ingredients, VariedSystem};
