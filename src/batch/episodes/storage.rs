//! Episode memory of all instances in one precision, and their steps.

use std::sync::{Mutex, PoisonError};

use super::chunk::{Chunk, Context, column, frames, set_column};
use super::closed_loop::{self, LoopPart};
use super::episode_slot::EpisodeSlot;
use super::kernels;
use super::outputs::{Final, Outputs};
use crate::batch::simulator::Simulator;
use crate::batch::stepping::chunk::CHUNK;
use crate::batch::storage::aligned::Aligned;
use crate::batch::storage::inputs::ActiveLoads;
use crate::error::{ControlError, SimulatorError};
use crate::lane::Real;
use crate::system::State;
use crate::task::{Task, TaskDefinition, TaskKernel};

/// All instances of a batch: physics, episodes, and what they have in common.
pub(super) struct Members<'a> {
    pub simulator: &'a mut Simulator,
    pub slots: &'a mut [EpisodeSlot],
    pub context: Context<'a>,
}

/// Episode memory of all instances, independent of task and precision.
pub(super) trait TaskStorage: Send + Sync {
    /// One control period of all instances under `actions` (N, a); returns the ends of replaced episodes, by instance.
    fn step(&mut self, members: Members<'_>, actions: &[f32], out: Outputs<'_>) -> Vec<Final>;
    /// Control periods of all instances in a closed loop, of which each chunk has a part; ended episodes stay as they are.
    fn run(
        &mut self,
        members: Members<'_>,
        steps: usize,
        parts: Vec<Box<dyn LoopPart + '_>>,
    ) -> Result<(), ControlError>;
    /// Observations, with perfect sensors if asked for, and metrics of all instances at their current control instant.
    fn observe(&mut self, simulator: &mut Simulator, perfect: bool, out: &mut Outputs<'_>);
    /// States and memories of all instances: see [`super::TaskBatch::frames`].
    fn frames(&mut self, simulator: &mut Simulator) -> [Vec<f32>; 2];
    /// Numbers of the episode of instance `i`.
    fn column(&self, i: usize) -> Vec<f64>;
    /// Sets them.
    fn set_column(&mut self, i: usize, numbers: &[f64]);
    /// Bytes per instance.
    fn bytes_per_instance(&self, instances: usize) -> usize;
    /// An independent copy.
    fn boxed_clone(&self) -> Box<dyn TaskStorage>;
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
    /// Memory for `instances` episodes of a task; `definition` is the one in its options.
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

    /// Calls `work` on each chunk with its item, on the threads of the simulator.
    fn for_each_chunk<I: Send>(
        &mut self,
        Members { simulator, slots, context }: Members<'_>,
        items: impl ExactSizeIterator<Item = I> + Send,
        work: impl Fn(&mut Chunk<'_, '_, T, K>, I) + Sync,
    ) {
        let Self { kernel, episodes, home } = self;
        let (kernel, home) = (&*kernel, &*home);
        let items = slots.chunks_mut(CHUNK).zip(episodes.chunks_mut(CHUNK * kernel.rows().rows)).zip(items);
        let substeps = context.task.options().substeps as usize;
        simulator.for_each_chunk::<T, _>(substeps, Self::LOADS, items, |part, ((slots, episodes), item)| {
            work(&mut Chunk { context, kernel, home, part, slots, episodes }, item);
        });
    }
}

impl<T: Real, K: TaskDefinition> TaskStorage for TaskBlocks<T, K> {
    fn step(&mut self, members: Members<'_>, actions: &[f32], out: Outputs<'_>) -> Vec<Final> {
        let finals = Mutex::new(Vec::new());
        let items = actions.chunks(CHUNK * members.context.task.action_len()).zip(out.chunks(CHUNK));
        self.for_each_chunk(members, items, |chunk, (actions, mut out)| {
            let mut ended = Vec::new();
            chunk.step(actions, &mut out, &mut ended);
            if !ended.is_empty() {
                finals.lock().unwrap_or_else(PoisonError::into_inner).append(&mut ended);
            }
        });
        let mut finals = finals.into_inner().unwrap_or_else(PoisonError::into_inner);
        finals.sort_by_key(|end| end.instance);
        finals
    }

    fn run(
        &mut self,
        members: Members<'_>,
        steps: usize,
        parts: Vec<Box<dyn LoopPart + '_>>,
    ) -> Result<(), ControlError> {
        let failure = Mutex::new(Ok(()));
        self.for_each_chunk(members, parts.into_iter(), |chunk, mut part| {
            if let Err(error) = closed_loop::run(chunk, &mut *part, steps) {
                *failure.lock().unwrap_or_else(PoisonError::into_inner) = Err(error);
            }
        });
        failure.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn observe(&mut self, simulator: &mut Simulator, perfect: bool, out: &mut Outputs<'_>) {
        let all = vec![true; out.len()];
        let (layout, isa, physics) = simulator.blocks::<T>().parts();
        let blocks =
            kernels::EpisodeBlocks { layout, rows: self.kernel.rows().rows, physics, episodes: &mut self.episodes };
        T::dispatch(isa, &mut kernels::ObserveKernel { kernel: &self.kernel, blocks, chosen: &all, perfect, out });
    }

    fn frames(&mut self, simulator: &mut Simulator) -> [Vec<f32>; 2] {
        let instances = simulator.instances();
        let (layout, _, physics) = simulator.blocks::<T>().parts();
        frames(layout, physics, self.kernel.rows(), &self.episodes, instances)
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
