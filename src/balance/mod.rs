//! The principle of dynamical balance.

pub mod articulated;
mod joint_torque;
