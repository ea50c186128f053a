//! The principle of dynamical balance.

mod articulated;
mod passive;

pub use articulated::{Accelerations, Loads, Scratch, accelerations};
