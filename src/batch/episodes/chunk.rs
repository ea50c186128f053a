//! The task around the physics of a few instances, on one thread.

use super::episode_slot::EpisodeSlot;
use super::kernels::{ActKernel, EpisodeBlocks, EvaluateKernel, ObserveKernel};
use super::outputs::{Final, Outputs, Transition};
use crate::batch::stepping::chunk::{CHUNK, PhysicsChunk};
use crate::batch::storage::layout::{Layout, index};
use crate::control::Controller;
use crate::dynamics::ClosedFormModel;
use crate::lane::Real;
use crate::system::{Flow, State};
use crate::task::disturbance::{Column, DisturbanceKernel, PayloadEvent, grasp_impulse};
use crate::task::{Episode, EpisodeKey, EpisodeRows, StartOverride, Task, TaskDefinition, TaskKernel, privileged};

/// Handling of instances whose episode is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Autoreset {
    /// The next step ignores the action and starts the next episode: its first observation, reward 0.
    #[default]
    NextStep,
    /// The same step starts the next episode; the last observation and metrics are in [`Transition::finals`].
    SameStep,
    /// The instance waits for [`TaskBatch::reset`](super::TaskBatch::reset).
    Disabled,
}

/// Rules for the ends of episodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rules {
    pub autoreset: Autoreset,
    pub max_steps: Option<u32>,
}

/// Task, rules and base controller of a batch.
#[derive(Clone, Copy)]
pub(super) struct Context<'a> {
    pub task: &'a Task,
    pub rules: Rules,
    /// Base controller of residual actions.
    pub base: Option<&'a dyn Controller>,
}

/// Instances of one thread: their physics, and the memory of their episodes.
pub(super) struct Chunk<'a, 'p, T: Real, K: TaskDefinition> {
    pub context: Context<'a>,
    pub kernel: &'a TaskKernel<T, K>,
    /// A state that is cheap to step, for instances without an episode.
    pub home: &'a State,
    pub part: &'a mut PhysicsChunk<'p, T>,
    pub slots: &'a mut [EpisodeSlot],
    /// Numbers of the episodes, block by block.
    pub episodes: &'a mut [T],
}

impl<T: Real, K: TaskDefinition> Chunk<'_, '_, T, K> {
    /// One control period under `actions` (n, a); allocates only at the ends of episodes.
    pub fn step(&mut self, actions: &[f32], out: &mut Outputs<'_>, finals: &mut Vec<Final>) {
        for (k, _) in self.slots.iter().enumerate().filter(|(_, slot)| slot.over) {
            // Its last state may be expensive to step.
            self.part.set_state(k, self.home);
        }
        let base = self.base();
        if let Some(disturbance) = self.kernel.disturbance() {
            self.advance_disturbances(disturbance);
        }
        let isa = self.part.isa;
        T::dispatch(
            isa,
            &mut ActKernel { kernel: self.kernel.actions(), blocks: self.blocks(), actions, base: base.as_deref() },
        );
        self.part.step();
        let mut counts = [T::from_f64(1.0); CHUNK];
        for (count, slot) in counts.iter_mut().zip(&*self.slots) {
            *count = T::from_f64(f64::from(slot.step) + 1.0);
        }
        T::dispatch(isa, &mut EvaluateKernel { kernel: self.kernel, blocks: self.blocks(), counts: &counts, out });
        self.end_episodes(out, finals);
    }

    /// Actions of the base controller, (n, a), with residual actions.
    fn base(&mut self) -> Option<Vec<f32>> {
        let controller = self.context.base?;
        let (n, widths) = (self.slots.len(), controller.widths());
        let mut transition = Transition::blank(n, widths.observation, TaskKernel::<T, K>::metrics());
        self.observe(&vec![true; n], &mut transition.outputs());
        let mut actions = vec![0.0; n * widths.action];
        let fits = controller.act(&transition.observations, &mut [], &mut actions);
        fits.expect("the base controller fits its task and has no memory");
        Some(actions)
    }

    /// Draws the disturbances of the coming control period and applies payload events, instance by instance.
    fn advance_disturbances(&mut self, disturbance: &DisturbanceKernel<T>) {
        let size = self.kernel.rows().rows * T::BLOCK;
        for (k, slot) in self.slots.iter().enumerate().filter(|(_, slot)| !slot.over) {
            let block = &mut self.episodes[k / T::BLOCK * size..][..size];
            let mut memory = Column::of_block(block, k % T::BLOCK);
            disturbance.advance(&mut memory, slot.key, slot.step);
            let Some(event) = disturbance.payload_event(&memory, slot.step) else { continue };
            let mut factors = self.part.table.factors(self.part.rows, k);
            match event {
                PayloadEvent::Grasp(mass) => {
                    let task = self.context.task;
                    let own = task.scene_draws().map(|draws| draws.draw(slot.key).0);
                    let scene = own.as_ref().unwrap_or(task.scene());
                    // A scene that composes with its own masses does so with scaled ones.
                    if let Ok(model) = ClosedFormModel::new(&scene.varied(factors.of_bodies())) {
                        let mut state = self.part.table.state(self.part.rows, k);
                        grasp_impulse(&model, &mut state, mass);
                        self.part.set_velocities(k, &state);
                    }
                    factors.payload += mass;
                    disturbance.hold(&mut memory, mass);
                }
                PayloadEvent::Release(mass) => {
                    factors.payload = (factors.payload - mass).max(0.0);
                    disturbance.hold(&mut memory, 0.0);
                }
            }
            self.part.set_factors(k, &factors);
        }
    }

    /// Ends episodes and starts those that follow.
    fn end_episodes(&mut self, out: &mut Outputs<'_>, finals: &mut Vec<Final>) {
        let Rules { autoreset, max_steps } = self.context.rules;
        let mut begun = [false; CHUNK];
        let mut any = false;
        for k in 0..self.slots.len() {
            let slot = &mut self.slots[k];
            if slot.over && autoreset == Autoreset::Disabled {
                continue;
            }
            if slot.over {
                (out.rewards[k], out.terminated[k], out.truncated[k]) = (0.0, false, false);
                begun[k] = true;
            } else {
                slot.step += 1;
                out.truncated[k] = max_steps.is_some_and(|most| slot.step >= most);
                slot.over = out.terminated[k] | out.truncated[k];
                if slot.over && autoreset == Autoreset::SameStep {
                    let truth = self.privileged(k);
                    finals.push(Final::of(self.part.first, k, out, truth));
                    begun[k] = true;
                }
            }
            if begun[k] {
                any = true;
                self.begin(k);
            }
        }
        if any {
            self.observe(&begun, out);
        }
    }

    /// Privileged information of instance `k`.
    fn privileged(&self, k: usize) -> Vec<f64> {
        let (table, rows, task) = (self.part.table, &*self.part.rows, self.context.task);
        let (state, flow, factors) = (table.state(rows, k), table.flow(rows, k), table.factors(rows, k));
        let numbers = column(self.episodes, task.episode_rows().rows, k);
        let episode = Episode::from_parts(EpisodeKey::default(), 0, task.episode_rows(), numbers);
        privileged(task.coordinate_count(), &state, &flow, &factors, &episode.target())
    }

    /// Starts the next episode of instance `k`.
    fn begin(&mut self, k: usize) {
        let (episode, state) = self.context.task.begin(self.slots[k].next());
        self.part.set_state(k, &state);
        self.part.table.set_flow(self.part.rows, k, &Flow::from(episode.current()));
        if let Some(factors) = self.context.task.factors(episode.key(), &StartOverride::default()) {
            self.part.set_factors(k, &factors);
        }
        if let Some(draws) = self.context.task.scene_draws() {
            self.part.set_own(k, &draws.draw(episode.key()).1);
        }
        self.slots[k] = EpisodeSlot::of(episode.key());
        set_column(self.episodes, k, episode.numbers());
    }

    /// Observations and metrics of the chosen instances at their current control instant.
    pub fn observe(&mut self, chosen: &[bool], out: &mut Outputs<'_>) {
        self.observe_as(chosen, false, out);
    }

    /// Kernel of the observations of the chosen instances, of the true state if `perfect`.
    pub fn observe_as(&mut self, chosen: &[bool], perfect: bool, out: &mut Outputs<'_>) {
        let isa = self.part.isa;
        T::dispatch(isa, &mut ObserveKernel { kernel: self.kernel, blocks: self.blocks(), chosen, perfect, out });
    }

    fn blocks(&mut self) -> EpisodeBlocks<'_, T> {
        EpisodeBlocks {
            layout: &self.part.table.layout,
            rows: self.kernel.rows().rows,
            physics: &mut *self.part.rows,
            episodes: &mut *self.episodes,
        }
    }
}

/// States and memories of `count` instances in blocks: see [`super::TaskBatch::frames`].
pub(super) fn frames<T: Real>(
    layout: &Layout,
    physics: &[T],
    rows: &EpisodeRows,
    episodes: &[T],
    count: usize,
) -> [Vec<f32>; 2] {
    let states = [
        (layout.rotation, 9),
        (layout.position, 3),
        (layout.twist, 6),
        (layout.q, layout.joints),
        (layout.qd, layout.joints),
        (layout.current, 3),
        (layout.acceleration, 3),
        (layout.thrust, layout.thrusters),
    ];
    [gather(physics, layout.rows, &states, count), gather(episodes, rows.rows, &[(0, rows.recorded())], count)]
}

/// Numbers of `count` instances, (count, .), in runs of rows (first, count) of blocks of `rows` rows.
fn gather<T: Real>(blocks: &[T], rows: usize, runs: &[(usize, usize)], count: usize) -> Vec<f32> {
    let mut out = Vec::with_capacity(count * runs.iter().map(|(_, count)| count).sum::<usize>());
    for i in 0..count {
        for &(first, count) in runs {
            out.extend((first..first + count).map(|row| blocks[index::<T>(rows, i, row)].to_f64() as f32));
        }
    }
    out
}

/// Numbers of instance `i` in blocks of `rows` rows.
pub(super) fn column<T: Real>(blocks: &[T], rows: usize, i: usize) -> Vec<f64> {
    (0..rows).map(|row| blocks[index::<T>(rows, i, row)].to_f64()).collect()
}

/// Sets the numbers of instance `i` in blocks of as many rows as there are numbers.
pub(super) fn set_column<T: Real>(blocks: &mut [T], i: usize, numbers: &[f64]) {
    for (row, x) in numbers.iter().enumerate() {
        blocks[index::<T>(numbers.len(), i, row)] = T::from_f64(*x);
    }
}
