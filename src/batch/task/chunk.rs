//! The task around the physics of a few instances, on one thread.

use super::kernels::{Act, Blocks, Judge, Look};
use super::outputs::{Outputs, Transition};
use super::slot::Slot;
use super::{Autoreset, Final};
use crate::batch::stepping::blocks::{CHUNK, PhysicsChunk};
use crate::control::Controller;
use crate::dynamics::ClosedFormModel;
use crate::lane::Real;
use crate::system::{Flow, State};
use crate::task::disturbance::{Column, Handling, Weather, seize};
use crate::task::{Episode, EpisodeKey, StartOverride, Task, TaskKernel, truth};

/// How episodes end and follow each other.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rules {
    pub autoreset: Autoreset,
    pub max_steps: Option<u32>,
}

/// What all chunks have in common.
pub(super) struct Duty<'a, T> {
    pub task: &'a Task,
    pub kernel: &'a TaskKernel<T>,
    pub rules: Rules,
    /// What actions are corrections to, where they are.
    pub base: Option<&'a dyn Controller>,
    /// A state that steps harmlessly.
    pub home: &'a State,
}

/// Instances that one thread works on: their physics, and the memory of their episodes.
pub(super) struct Chunk<'a, 'p, T> {
    pub duty: &'a Duty<'a, T>,
    pub part: &'a mut PhysicsChunk<'p, T>,
    pub slots: &'a mut [Slot],
    /// Numbers of the episodes, block by block.
    pub episodes: &'a mut [T],
}

impl<T: Real> Chunk<'_, '_, T> {
    /// One control period under `actions` (n, a); allocates nothing but ends of episodes.
    pub fn step(&mut self, actions: &[f32], out: &mut Outputs<'_>, finals: &mut Vec<Final>) {
        for (k, _) in self.slots.iter().enumerate().filter(|(_, slot)| slot.over) {
            // What it was left in may be a state that takes long to step.
            self.part.table.set_state(self.part.rows, k, self.duty.home);
        }
        let base = self.base();
        if let Some(weather) = self.duty.kernel.weather() {
            self.stir(weather);
        }
        let isa = self.part.isa;
        T::dispatch(isa, &mut Act { blocks: self.blocks(), actions, base: base.as_deref() });
        self.part.step();
        let mut counts = [T::from_f64(1.0); CHUNK];
        for (count, slot) in counts.iter_mut().zip(&*self.slots) {
            *count = T::from_f64(f64::from(slot.step) + 1.0);
        }
        T::dispatch(isa, &mut Judge { blocks: self.blocks(), counts: &counts, out });
        self.follow_up(out, finals);
    }

    /// What the classical controller does, (n, a), where actions are corrections to it.
    fn base(&mut self) -> Option<Vec<f32>> {
        let policy = self.duty.base?;
        let (n, widths) = (self.slots.len(), policy.widths());
        let mut seen = Transition::blank(n, widths.observation);
        self.look(&vec![true; n], &mut seen.outputs());
        let mut actions = vec![0.0; n * widths.action];
        let fits = policy.act(&seen.observations, &mut [], &mut actions);
        fits.expect("the controller was made for this task, and remembers nothing");
        Some(actions)
    }

    /// What disturbances do to one instance at a time.
    fn stir(&mut self, weather: &Weather<T>) {
        let size = self.duty.kernel.rows().rows * T::BLOCK;
        for (k, slot) in self.slots.iter().enumerate().filter(|(_, slot)| !slot.over) {
            let block = &mut self.episodes[k / T::BLOCK * size..][..size];
            let mut memory = Column::of_block(block, k % T::BLOCK);
            weather.stir(&mut memory, slot.key, slot.step);
            let Some(handling) = weather.handling(&memory, slot.step) else { continue };
            let (table, rows) = (self.part.table, &mut *self.part.rows);
            let mut factors = table.factors(rows, k);
            match handling {
                Handling::Pick(mass) => {
                    // A scene that composed does so with other masses too.
                    if let Ok(balance) = ClosedFormModel::new(&self.duty.task.scene().varied(factors.of_bodies())) {
                        let mut state = table.state(rows, k);
                        seize(&balance, &mut state, mass);
                        table.set_velocities(rows, k, &state);
                    }
                    factors.payload += mass;
                    weather.hold(&mut memory, mass);
                }
                Handling::Drop(mass) => {
                    factors.payload = (factors.payload - mass).max(0.0);
                    weather.hold(&mut memory, 0.0);
                }
            }
            table.set_factors(rows, k, &factors);
        }
    }

    /// Ends episodes and starts those that follow.
    fn follow_up(&mut self, out: &mut Outputs<'_>, finals: &mut Vec<Final>) {
        let Rules { autoreset, max_steps } = self.duty.rules;
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
                    let truth = self.truth(k);
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
            self.look(&begun, out);
        }
    }

    /// What the observation of instance `k` does not tell.
    fn truth(&self, k: usize) -> Vec<f64> {
        let (table, rows, task) = (self.part.table, &*self.part.rows, self.duty.task);
        let (state, flow, factors) = (table.state(rows, k), table.flow(rows, k), table.factors(rows, k));
        let numbers = column(self.episodes, task.episode_rows().rows, k);
        let episode = Episode::from_parts(EpisodeKey::default(), 0, task.episode_rows(), numbers);
        truth(task.joint_count(), &state, &flow, &factors, &episode.target())
    }

    /// Starts the next episode of instance `k`.
    fn begin(&mut self, k: usize) {
        let (episode, state) = self.duty.task.begin(self.slots[k].next);
        self.part.table.set_state(self.part.rows, k, &state);
        self.part.table.set_flow(self.part.rows, k, &Flow::from(episode.current()));
        if let Some(factors) = self.duty.task.factors(episode.key(), &StartOverride::default()) {
            self.part.table.set_factors(self.part.rows, k, &factors);
        }
        self.slots[k] = Slot::of(episode.key());
        set_column(self.episodes, k, episode.numbers());
    }

    /// Observations and measures of the chosen instances where they stand.
    pub fn look(&mut self, chosen: &[bool], out: &mut Outputs<'_>) {
        let isa = self.part.isa;
        T::dispatch(isa, &mut Look { blocks: self.blocks(), chosen, out });
    }

    fn blocks(&mut self) -> Blocks<'_, T> {
        Blocks {
            kernel: self.duty.kernel,
            layout: &self.part.table.layout,
            physics: &mut *self.part.rows,
            episodes: &mut *self.episodes,
        }
    }
}

/// Numbers of instance `i` in blocks of `rows` rows.
pub(super) fn column<T: Real>(blocks: &[T], rows: usize, i: usize) -> Vec<f64> {
    let (block, lane) = (i / T::BLOCK, i % T::BLOCK);
    (0..rows).map(|row| blocks[(block * rows + row) * T::BLOCK + lane].to_f64()).collect()
}

/// Sets the numbers of instance `i` in blocks of as many rows.
pub(super) fn set_column<T: Real>(blocks: &mut [T], i: usize, numbers: &[f64]) {
    let (block, lane) = (i / T::BLOCK, i % T::BLOCK);
    for (row, x) in numbers.iter().enumerate() {
        blocks[(block * numbers.len() + row) * T::BLOCK + lane] = T::from_f64(*x);
    }
}
