//! A scene compiled for computation, and its state.

mod attitude;
mod bodies;
mod compile;
mod contact;
mod damping;
mod end_effector;
mod factors;
mod instance_system;
mod joint_frames;
mod model;
pub mod propulsion;
mod state;
mod structure;

pub use crate::hydro::{THRUSTERS, Thrusts};
pub use crate::terms::{FACTORS, Factors};
pub use attitude::{quaternion, roll_pitch_yaw, rotation, rotation_vector};
pub use compile::{Compiled, compile};
pub use end_effector::EndEffector;
pub use factors::UnscaledBodyTerms;
pub use instance_system::InstanceSystem;
pub use model::{
    Actuator, Before, BodyTerms, BreakAway, Detent, Friction, JointKind, JointPlacement, JointScrew, JointTerms,
    Limits, RareTerms, Servo, System, VehicleServo, WORLD,
};
pub use state::{Flow, JOINTS, Joints, State};
pub use structure::structural_difference;
