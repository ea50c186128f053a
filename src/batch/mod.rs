//! Many instances at a time: blocks of lanes, threads.

mod aligned;
mod blocks;
mod columns;
mod dynamics;
mod fill;
mod inputs;
mod lagged;
mod layout;
mod loads;
mod monitor;
mod rates;
mod simulator;
mod states;
mod step;
mod table;
mod task;
mod threads;

pub use inputs::Inputs;
pub use loads::AppliedLoads;
pub use monitor::{Sighting, Stray, WRONG, Watched};
pub use rates::{Mode, Survey, Unstable, stabilities};
pub use simulator::{Precision, Simulator, SimulatorOptions};
pub use states::States;
pub use task::{Autoreset, Beginning, Final, Outputs, Rollout, Saved, Tally, TaskBatch, Trace, Transition, Verdict};
