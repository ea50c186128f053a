//! The task around the physics of a few instances, on one thread.

use super::kernels::{Act, Blocks, Judge, Look};
use super::outputs::Outputs;
use super::slot::Slot;
use super::{Autoreset, Final};
use crate::batch::blocks::Part;
use crate::lane::Real;
use crate::scene::{Task, TaskKernel};
use crate::system::{Flow, State};

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
    /// A state that steps harmlessly.
    pub home: &'a State,
}

/// Instances that one thread works on: their physics, and the memory of their episodes.
pub(super) struct Chunk<'a, 'p, T> {
    pub duty: &'a Duty<'a, T>,
    pub part: &'a mut Part<'p, T>,
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
        let isa = self.part.isa;
        T::dispatch(isa, &mut Act { blocks: self.blocks(), actions });
        self.part.step();
        let mut counts = [T::from_f64(1.0); MOST];
        for (count, slot) in counts.iter_mut().zip(&*self.slots) {
            *count = T::from_f64(f64::from(slot.step) + 1.0);
        }
        T::dispatch(isa, &mut Judge { blocks: self.blocks(), counts: &counts, out });
        self.follow_up(out, finals);
    }

    /// Ends episodes and starts those that follow.
    fn follow_up(&mut self, out: &mut Outputs<'_>, finals: &mut Vec<Final>) {
        let Rules { autoreset, max_steps } = self.duty.rules;
        let mut begun = [false; MOST];
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
                    finals.push(Final::of(self.part.first, k, out));
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

    /// Starts the next episode of instance `k`.
    fn begin(&mut self, k: usize) {
        let (episode, state) = self.duty.task.begin(self.slots[k].next);
        self.part.table.set_state(self.part.rows, k, &state);
        self.part.table.set_flow(self.part.rows, k, &Flow::from(episode.current()));
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

/// Most instances of a chunk.
pub(super) const MOST: usize = 8 * 16;

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
