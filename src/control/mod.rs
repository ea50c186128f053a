//! Control of one vehicle: thruster allocation, what an action means, the paper's PD.

mod action;
mod actuation;
mod allocation;
mod pd;

#[cfg(test)]
mod tests;

pub use action::{ActionKind, ActionMap, ActionRange};
pub use actuation::{ACTIONS, Actuated, Actuation};
pub use allocation::{AXES, Allocation, THRUSTERS, Thrusts};
pub use pd::{Pd, Reading};
