//! Many instances at a time: blocks of lanes, threads.

mod blocks;
mod dynamics;
mod inputs;
mod layout;
mod simulator;
mod step;
mod threads;

pub use inputs::Inputs;
pub use simulator::{Precision, Simulator, SimulatorOptions};
