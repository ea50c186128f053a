//! Controllers that know the vehicle's nominal model: a PD with restoring compensation, a disturbance observer,
//! computed torque, and model-predictive control.

mod feedback;
mod filter;
mod mpc;
mod observer;
mod plant;
mod restoring;
mod rows;

pub use feedback::{Law, ModelControl, ModelGains};
pub use mpc::{Mpc, MpcGains};
pub use observer::Observing;
pub use plant::{Arm, Motion, Plant, Push};
pub use restoring::PdRestoring;
pub use rows::ModelIndices;
