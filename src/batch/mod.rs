//! Batches of instances: memory in blocks of lanes, stepping on threads, monitoring of steps, episodes.
//!
//! `docs/batch.md` draws block, row, lane, column, group, chunk and portion, and follows one step through them.
//!
//! Modules: `storage` (memory and loads), `stepping` (kernels and threads), `monitoring` (quality of the steps), `simulator`,
//! `episodes` (tasks around the physics).

mod assessment;
mod episodes;
mod monitoring;
mod options;
mod simulator;
pub(crate) mod stepping;
pub(crate) mod storage;

pub use assessment::{Assessment, Authority, JointRates, Recommendation, Trim, assess, recommend};
pub use episodes::{
    Autoreset, Beginning, Final, Outputs, Recorder, Recording, Rollout, RolloutStats, Saved, TaskBatch, Teacher, Trace,
    Transition,
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

/// Insides of the batch for the tests of this repository; no part of the interface.
#[doc(hidden)]
pub mod insides {
    pub use super::stepping::adjoint::Cotangents;
    pub use super::stepping::blocks::{Blocks, Storage};
    pub use super::stepping::derivative::{DerivativeColumn, Directions, Duals, Pairs, step_pairs};
    pub use super::stepping::parameters::StepSettings;
    pub use super::stepping::step::Step;
    pub use super::stepping::threads::for_each;
    pub use super::storage::aligned::{Aligned, LINE};
    pub use super::storage::inputs::CheckedInputs;
    pub use super::storage::layout::Layout;
    pub use super::storage::table::Table;
}
