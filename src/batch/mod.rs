//! Batches of instances: memory in blocks of lanes, stepping on threads, monitoring of steps, episodes.
//!
//! `docs/batch.md` draws block, row, lane, column, group, chunk and portion, and follows one step through them.
//!
//! Rooms, each above those before it: `storage` (memory and loads), `stepping` (kernels and threads), `monitoring` (quality
//! of the steps), `episodes` (tasks around the physics).

mod episodes;
mod monitoring;
mod options;
mod simulator;
pub mod stepping;
pub mod storage;

pub use episodes::{
    Autoreset, Beginning, Final, Outputs, Recorder, Recording, Rollout, RolloutStats, Saved, StepResult, TaskBatch,
    Teacher, Trace, Transition,
};
pub use monitoring::error_estimate::ErrorEstimate;
pub use monitoring::modal_analysis::{ModalAnalysis, Mode, UnstableStep, stabilities};
pub use monitoring::step_monitor::InaccurateStep;
pub use monitoring::step_quality::{ACCUMULATED_LIMIT, Cause, ERROR_LIMIT, StepQuality, StepViolation};
pub use options::{Precision, SimulatorOptions};
pub use simulator::Simulator;
pub use simulator::applied_loads::AppliedLoads;
pub use simulator::coordinates::Argument;
pub use simulator::derivatives::{StepJacobians, parameter};
pub use simulator::states::States;
pub use storage::inputs::Inputs;
