//! A scene compiled for computation, and its state.

mod state;

pub use state::{JOINTS, Joints, State};
