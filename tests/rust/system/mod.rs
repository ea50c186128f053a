//! Compiled scenes.

mod chains;
mod end_effectors;
