//! The task in one precision: what episodes remember, and steps.

use std::sync::{Mutex, PoisonError};

use super::Final;
use super::chunk::{Chunk, Duty, Rules, column, set_column};
use super::kernels;
use super::outputs::Outputs;
use super::rollout::{Lap, Rollout, take_before};
use super::slot::Slot;
use crate::batch::simulator::Simulator;
use crate::batch::stepping::blocks::CHUNK;
use crate::batch::storage::active_loads::ActiveLoads;
use crate::batch::storage::aligned::Aligned;
use crate::control::Controller;
use crate::error::{ControlError, SimulatorError};
use crate::lane::Real;
use crate::system::State;
use crate::task::{Goal, Task, TaskKernel};

/// The joints' servos are all that is on, where joints follow references (cubic ones); else nothing is.
fn active_loads(task: &Task) -> ActiveLoads {
    let terms = if task.options().task == Goal::StationKeep { 4 } else { 0 };
    ActiveLoads { target_terms: terms, link_wrenches: false, station: false }
}

/// The numbers of all episodes, whatever the precision.
pub(super) trait Crew: Send + Sync {
    /// One control period of all instances under `actions` (N, a); ends of episodes that were replaced, by instance.
    fn step(
        &mut self,
        simulator: &mut Simulator,
        slots: &mut [Slot],
        orders: &Orders<'_>,
        out: Outputs<'_>,
    ) -> Vec<Final>;
    /// So many control periods of all instances under a policy; episodes that are over stay so.
    fn run(
        &mut self,
        simulator: &mut Simulator,
        slots: &mut [Slot],
        course: &Course<'_>,
        rollout: &mut Rollout,
    ) -> Result<(), ControlError>;
    /// Observations and measures of all instances where they stand.
    fn look(&mut self, simulator: &mut Simulator, out: &mut Outputs<'_>);
    /// Numbers of the episode of instance `i`.
    fn column(&self, i: usize) -> Vec<f64>;
    /// Sets them.
    fn set_column(&mut self, i: usize, numbers: &[f64]);
    /// Bytes per instance.
    fn bytes_per_instance(&self, instances: usize) -> usize;
    /// An independent copy.
    fn boxed_clone(&self) -> Box<dyn Crew>;
}

/// What a step is to do.
pub(super) struct Orders<'a> {
    pub task: &'a Task,
    pub rules: Rules,
    pub base: Option<&'a dyn Controller>,
    pub actions: &'a [f32],
}

/// What a run is to do.
pub(super) struct Course<'a> {
    pub task: &'a Task,
    pub rules: Rules,
    pub base: Option<&'a dyn Controller>,
    pub policy: &'a dyn Controller,
    pub steps: u32,
}

/// The numbers of all episodes.
#[derive(Clone)]
pub(super) struct Company<T> {
    kernel: TaskKernel<T>,
    /// Block by block.
    episodes: Aligned<T>,
    /// A state that steps harmlessly.
    home: State,
}

impl<T: Real> Company<T> {
    /// # Errors
    /// [`SimulatorError::Memory`] if they do not fit into memory.
    pub fn new(task: &Task, instances: usize) -> Result<Self, SimulatorError> {
        let kernel = task.in_lanes();
        let numbers = instances.next_multiple_of(T::BLOCK).saturating_mul(kernel.rows().rows);
        let episodes = Aligned::filled(numbers, T::default()).map_err(|_| SimulatorError::Memory { instances })?;
        Ok(Self { kernel, episodes, home: State { q: task.scene().home(), ..State::default() } })
    }
}

impl<T: Real> Crew for Company<T> {
    fn step(
        &mut self,
        simulator: &mut Simulator,
        slots: &mut [Slot],
        orders: &Orders<'_>,
        out: Outputs<'_>,
    ) -> Vec<Final> {
        let &Orders { task, rules, base, actions } = orders;
        let duty = Duty { task, kernel: &self.kernel, rules, base, home: &self.home };
        let finals = Mutex::new(Vec::new());
        let substeps = task.options().substeps as usize;
        let items = slots
            .chunks_mut(CHUNK)
            .zip(self.episodes.chunks_mut(CHUNK * self.kernel.rows().rows))
            .zip(actions.chunks(CHUNK * task.action_len()))
            .zip(out.chunks(CHUNK));
        simulator.for_each_chunk::<T, _>(
            substeps,
            active_loads(task),
            items,
            |part, (((slots, episodes), actions), mut out)| {
                let mut ended = Vec::new();
                Chunk { duty: &duty, part, slots, episodes }.step(actions, &mut out, &mut ended);
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
        slots: &mut [Slot],
        course: &Course<'_>,
        rollout: &mut Rollout,
    ) -> Result<(), ControlError> {
        let &Course { task, rules, base, policy, steps } = course;
        let duty = Duty { task, kernel: &self.kernel, rules, base, home: &self.home };
        let mut traces = &mut rollout.traces[..];
        let mut memory = &mut rollout.memory[..];
        let mut laps = Vec::new();
        for (k, tallies) in rollout.tallies.chunks_mut(CHUNK).enumerate() {
            let remembered = tallies.len() * policy.widths().memory;
            let (memory_of_lap, rest) = std::mem::take(&mut memory).split_at_mut(remembered);
            memory = rest;
            let traces = take_before(&mut traces, (k + 1) * CHUNK);
            laps.push(Lap { policy, steps, memory: memory_of_lap, tallies, traces });
        }
        let failure = Mutex::new(Ok(()));
        let substeps = task.options().substeps as usize;
        let items =
            slots.chunks_mut(CHUNK).zip(self.episodes.chunks_mut(CHUNK * self.kernel.rows().rows)).zip(&mut laps);
        simulator.for_each_chunk::<T, _>(substeps, active_loads(task), items, |part, ((slots, episodes), lap)| {
            if let Err(error) = lap.run(&mut Chunk { duty: &duty, part, slots, episodes }) {
                *failure.lock().unwrap_or_else(PoisonError::into_inner) = Err(error);
            }
        });
        failure.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn look(&mut self, simulator: &mut Simulator, out: &mut Outputs<'_>) {
        let all = vec![true; out.len()];
        let (layout, isa, physics) = simulator.blocks::<T>().parts();
        let blocks = kernels::Blocks { kernel: &self.kernel, layout, physics, episodes: &mut self.episodes };
        T::dispatch(isa, &mut kernels::Look { blocks, chosen: &all, out });
    }

    fn column(&self, i: usize) -> Vec<f64> {
        column(&self.episodes, self.kernel.rows().rows, i)
    }

    fn set_column(&mut self, i: usize, numbers: &[f64]) {
        set_column(&mut self.episodes, i, numbers);
    }

    fn bytes_per_instance(&self, instances: usize) -> usize {
        size_of_val(&self.episodes[..]) / instances + size_of::<Slot>()
    }

    fn boxed_clone(&self) -> Box<dyn Crew> {
        Box::new(self.clone())
    }
}
