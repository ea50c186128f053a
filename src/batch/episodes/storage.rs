//! Episode memory of all instances in one precision, and their steps.

use std::sync::{Mutex, PoisonError};

use super::chunk::{Chunk, ChunkContext, Rules, column, set_column};
use super::episode_slot::EpisodeSlot;
use super::kernels;
use super::outputs::{Final, Outputs};
use super::recording::{Recorder, Recording};
use super::rollout::{Rollout, RolloutChunk, take_before};
use crate::batch::simulator::Simulator;
use crate::batch::stepping::chunk::CHUNK;
use crate::batch::storage::active_loads::ActiveLoads;
use crate::batch::storage::aligned::Aligned;
use crate::control::Controller;
use crate::error::{ControlError, SimulatorError};
use crate::lane::Real;
use crate::system::State;
use crate::task::{Task, TaskDefinition, TaskKernel};

/// Episode memory of all instances, independent of task and precision.
pub(super) trait TaskStorage: Send + Sync {
    /// One control period of all instances; returns the ends of replaced episodes, by instance.
    fn step(
        &mut self,
        simulator: &mut Simulator,
        slots: &mut [EpisodeSlot],
        args: &StepArgs<'_>,
        out: Outputs<'_>,
    ) -> Vec<Final>;
    /// Control periods of all instances under a controller; ended episodes stay as they are.
    fn run(
        &mut self,
        simulator: &mut Simulator,
        slots: &mut [EpisodeSlot],
        args: &RolloutArgs<'_>,
        rollout: &mut Rollout,
    ) -> Result<(), ControlError>;
    /// Control periods of all instances, recorded for training; ended episodes stay as they are.
    fn record(
        &mut self,
        simulator: &mut Simulator,
        slots: &mut [EpisodeSlot],
        args: &RecordArgs<'_>,
    ) -> Result<Recording, ControlError>;
    /// Observations, with perfect sensors if asked for, and metrics of all instances at their current control instant.
    fn observe(&mut self, simulator: &mut Simulator, perfect: bool, out: &mut Outputs<'_>);
    /// Numbers of the episode of instance `i`.
    fn column(&self, i: usize) -> Vec<f64>;
    /// Sets them.
    fn set_column(&mut self, i: usize, numbers: &[f64]);
    /// Bytes per instance.
    fn bytes_per_instance(&self, instances: usize) -> usize;
    /// An independent copy.
    fn boxed_clone(&self) -> Box<dyn TaskStorage>;
}

/// Arguments of a step.
pub(super) struct StepArgs<'a> {
    pub task: &'a Task,
    pub rules: Rules,
    /// Base controller of residual actions.
    pub base: Option<&'a dyn Controller>,
    /// (N, a).
    pub actions: &'a [f32],
}

/// Arguments of a rollout.
pub(super) struct RolloutArgs<'a> {
    pub task: &'a Task,
    pub rules: Rules,
    /// Base controller of residual actions.
    pub base: Option<&'a dyn Controller>,
    pub controller: &'a dyn Controller,
    /// Control periods.
    pub steps: u32,
}

/// Arguments of a recording.
pub(super) struct RecordArgs<'a> {
    pub task: &'a Task,
    pub rules: Rules,
    /// Base controller of residual actions.
    pub base: Option<&'a dyn Controller>,
    pub recorder: Recorder<'a>,
}

/// Episode memory in blocks of lanes.
#[derive(Clone)]
pub(super) struct TaskBlocks<T: Real, K: TaskDefinition> {
    kernel: TaskKernel<T, K>,
    /// Block by block.
    episodes: Aligned<T>,
    /// A state that is cheap to step, for instances without an episode.
    home: State,
}

impl<T: Real, K: TaskDefinition> TaskBlocks<T, K> {
    /// Memory for `instances` episodes of a task; `definition` is that of its options.
    ///
    /// # Errors
    /// [`SimulatorError::Memory`] if they do not fit into memory.
    pub fn new(task: &Task, definition: &K, instances: usize) -> Result<Self, SimulatorError> {
        let kernel = task.in_lanes(definition);
        let numbers = instances.next_multiple_of(T::BLOCK).saturating_mul(kernel.rows().rows);
        let episodes = Aligned::filled(numbers, T::default()).map_err(|_| SimulatorError::Memory { instances })?;
        Ok(Self { kernel, episodes, home: State { q: task.scene().home(), ..State::default() } })
    }

    /// Only the joints' servos are on, and only where joints follow references (cubic ones).
    const LOADS: ActiveLoads =
        ActiveLoads { target_terms: if K::DRIVES_JOINTS { 0 } else { 4 }, link_wrenches: false, station: false };
}

impl<T: Real, K: TaskDefinition> TaskStorage for TaskBlocks<T, K> {
    fn step(
        &mut self,
        simulator: &mut Simulator,
        slots: &mut [EpisodeSlot],
        args: &StepArgs<'_>,
        out: Outputs<'_>,
    ) -> Vec<Final> {
        let &StepArgs { task, rules, base, actions } = args;
        let context = ChunkContext { task, kernel: &self.kernel, rules, base, home: &self.home };
        let finals = Mutex::new(Vec::new());
        let substeps = task.options().substeps as usize;
        let items = slots
            .chunks_mut(CHUNK)
            .zip(self.episodes.chunks_mut(CHUNK * self.kernel.rows().rows))
            .zip(actions.chunks(CHUNK * task.action_len()))
            .zip(out.chunks(CHUNK));
        simulator.for_each_chunk::<T, _>(
            substeps,
            Self::LOADS,
            items,
            |part, (((slots, episodes), actions), mut out)| {
                let mut ended = Vec::new();
                Chunk { context: &context, part, slots, episodes }.step(actions, &mut out, &mut ended);
                if !ended.is_empty() {
                    finals.lock().unwrap_or_else(PoisonError::into_inner).append(&mut ended);
                }
            },
        );
        let mut finals = finals.into_inner().unwrap_or_else(PoisonError::into_inner);
        finals.sort_by_key(|end| end.instance);
        finals
    }

    fn run(
        &mut self,
        simulator: &mut Simulator,
        slots: &mut [EpisodeSlot],
        args: &RolloutArgs<'_>,
        rollout: &mut Rollout,
    ) -> Result<(), ControlError> {
        let &RolloutArgs { task, rules, base, controller, steps } = args;
        let context = ChunkContext { task, kernel: &self.kernel, rules, base, home: &self.home };
        let mut traces = &mut rollout.traces[..];
        let mut memory = &mut rollout.memory[..];
        let mut parts = Vec::new();
        for (k, stats) in rollout.stats.chunks_mut(CHUNK).enumerate() {
            let (own, rest) = std::mem::take(&mut memory).split_at_mut(stats.len() * controller.widths().memory);
            memory = rest;
            let traces = take_before(&mut traces, (k + 1) * CHUNK);
            parts.push(RolloutChunk { controller, steps, memory: own, stats, traces });
        }
        let failure = Mutex::new(Ok(()));
        let substeps = task.options().substeps as usize;
        let items =
            slots.chunks_mut(CHUNK).zip(self.episodes.chunks_mut(CHUNK * self.kernel.rows().rows)).zip(&mut parts);
        simulator.for_each_chunk::<T, _>(substeps, Self::LOADS, items, |part, ((slots, episodes), rollout)| {
            if let Err(error) = rollout.run(&mut Chunk { context: &context, part, slots, episodes }) {
                *failure.lock().unwrap_or_else(PoisonError::into_inner) = Err(error);
            }
        });
        failure.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn record(
        &mut self,
        simulator: &mut Simulator,
        slots: &mut [EpisodeSlot],
        args: &RecordArgs<'_>,
    ) -> Result<Recording, ControlError> {
        let &RecordArgs { task, rules, base, recorder } = args;
        let context = ChunkContext { task, kernel: &self.kernel, rules, base, home: &self.home };
        let (n, substeps) = (slots.len(), task.options().substeps as usize);
        let mut recording = Recording::blank(&recorder, n);
        let mut parts = recording.chunks(recorder, n, CHUNK);
        let failure = Mutex::new(Ok(()));
        let items =
            slots.chunks_mut(CHUNK).zip(self.episodes.chunks_mut(CHUNK * self.kernel.rows().rows)).zip(&mut parts);
        simulator.for_each_chunk::<T, _>(substeps, Self::LOADS, items, |part, ((slots, episodes), recording)| {
            if let Err(error) = recording.run(&mut Chunk { context: &context, part, slots, episodes }) {
                *failure.lock().unwrap_or_else(PoisonError::into_inner) = Err(error);
            }
        });
        failure.into_inner().unwrap_or_else(PoisonError::into_inner)?;
        Ok(recording)
    }

    fn observe(&mut self, simulator: &mut Simulator, perfect: bool, out: &mut Outputs<'_>) {
        let all = vec![true; out.len()];
        let (layout, isa, physics) = simulator.blocks::<T>().parts();
        let blocks = kernels::Blocks { kernel: &self.kernel, layout, physics, episodes: &mut self.episodes };
        T::dispatch(isa, &mut kernels::ObserveKernel { blocks, chosen: &all, perfect, out });
    }

    fn column(&self, i: usize) -> Vec<f64> {
        column(&self.episodes, self.kernel.rows().rows, i)
    }

    fn set_column(&mut self, i: usize, numbers: &[f64]) {
        set_column(&mut self.episodes, i, numbers);
    }

    fn bytes_per_instance(&self, instances: usize) -> usize {
        size_of_val(&self.episodes[..]) / instances + size_of::<EpisodeSlot>()
    }

    fn boxed_clone(&self) -> Box<dyn TaskStorage> {
        Box::new(self.clone())
    }
}
