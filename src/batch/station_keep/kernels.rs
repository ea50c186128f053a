//! What the task does to blocks of instances, in lanes.

use super::outputs::Outputs;
use crate::batch::columns::Columns;
use crate::batch::layout::Layout;
use crate::control::ACTIONS;
use crate::lane::{Kernel, Lane, Real, Rows};
use crate::scene::{Judgement, Keeper};

/// Greatest number of lanes.
const WIDEST: usize = 16;
/// Greatest number of entries of an observation.
const LONGEST: usize = 18 + 4 * crate::system::JOINTS + ACTIONS;

/// Blocks of instances, and their episodes' numbers.
pub(super) struct Blocks<'a, T> {
    pub keeper: &'a Keeper<T>,
    /// Rows of a block.
    pub layout: &'a Layout,
    pub physics: &'a mut [T],
    pub episodes: &'a mut [T],
}

impl<T: Real> Blocks<'_, T> {
    /// Columns of the group that starts with instance `first`.
    #[inline(always)]
    fn group(&mut self, first: usize) -> (Columns<'_, T>, Rows<'_, T>) {
        let (block, lane) = (first / T::BLOCK, first % T::BLOCK);
        let width = self.layout.rows * T::BLOCK;
        let physics = &mut self.physics[block * width..][..width];
        let width = self.keeper.rows().rows * T::BLOCK;
        let episodes = &mut self.episodes[block * width..][..width];
        (Columns { rows: physics, first: lane }, Rows::of_block(episodes, lane))
    }
}

/// Takes the actions: thrusts and servo targets become the loads of the coming steps.
pub(super) struct Act<'a, T> {
    pub blocks: Blocks<'a, T>,
    /// (n, a) for the first n instances of the blocks; the rest does nothing.
    pub actions: &'a [f32],
}

impl<T: Real> Kernel<T> for Act<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let layout = self.blocks.layout;
        let (width, keeper) = (self.blocks.keeper.rows().actions, self.blocks.keeper);
        let count = self.actions.len() / width;
        let mut page = [0.0; ACTIONS * WIDEST];
        for first in (0..count).step_by(L::LANES) {
            let lanes = L::LANES.min(count - first);
            if lanes < L::LANES {
                page.fill(0.0);
            }
            let rows = &self.actions[first * width..];
            for lane in 0..lanes {
                for k in 0..width {
                    page[k * L::LANES + lane] = rows[lane * width + k];
                }
            }
            let mut action = [L::zero(); ACTIONS];
            for k in 0..width {
                action[k] = L::load_single(&page[k * L::LANES..]);
            }
            let (mut columns, mut memory) = self.blocks.group(first);
            let command = keeper.act(&mut memory, &action);
            columns.set_all(layout.wrench, &command.actuated.wrench.to_array(), 6);
            for k in 0..layout.joints {
                columns.set_all(layout.target + 4 * k, &command.joints[k], 4);
            }
        }
    }
}

/// Judges what the steps have come to, and observes.
pub(super) struct Judge<'a, 'b, T> {
    pub blocks: Blocks<'a, T>,
    /// Control periods done, this one included, of each instance of the blocks.
    pub counts: &'a [T],
    /// For the instances of the blocks.
    pub out: &'a mut Outputs<'b>,
}

impl<T: Real> Kernel<T> for Judge<'_, '_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let layout = self.blocks.layout;
        let keeper = self.blocks.keeper;
        let (count, width) = (self.out.len(), keeper.observation_len());
        let mut page = [0.0; LONGEST * WIDEST];
        for first in (0..count).step_by(L::LANES) {
            let (columns, mut memory) = self.blocks.group(first);
            let stance = columns.stance::<L>(layout);
            let error = keeper.error(&memory, &stance);
            let share = L::c(1.0) / L::load(&self.counts[first..]);
            let judgement = keeper.advance(&mut memory, &stance, &error, share);
            keeper.observe(&memory, &stance, &error, &mut page);
            let lanes = L::LANES.min(count - first);
            turn::<L>(&page, lanes, width, &mut self.out.observations[first * width..]);
            note(&judgement, first, lanes, self.out);
        }
    }
}

/// Writes down a judgement for the first `lanes` of its lanes.
#[inline(always)]
fn note<L: Lane>(judgement: &Judgement<L>, first: usize, lanes: usize, out: &mut Outputs<'_>) {
    let sound = L::bits(judgement.sound);
    for lane in 0..lanes {
        out.terminated[first + lane] = sound >> lane & 1 == 0;
    }
    put(judgement.reward, lanes, &mut out.rewards[first..]);
    for (row, x) in out.info.iter_mut().zip(judgement.info) {
        put(x, lanes, &mut row[first..]);
    }
}

/// Writes the first `lanes` lanes.
#[inline(always)]
fn put<L: Lane>(x: L, lanes: usize, to: &mut [f64]) {
    if lanes == L::LANES {
        return x.store_double(to);
    }
    let mut all = [0.0; WIDEST];
    x.store_double(&mut all);
    to[..lanes].copy_from_slice(&all[..lanes]);
}

/// Entries by lanes into rows by entry: one row of `width` entries for each of the first `lanes` lanes.
#[inline(always)]
fn turn<L: Lane>(page: &[f32], lanes: usize, width: usize, to: &mut [f32]) {
    for lane in 0..lanes {
        let row = &mut to[lane * width..(lane + 1) * width];
        for k in 0..width {
            row[k] = page[k * L::LANES + lane];
        }
    }
}

/// Observes and measures instances where they stand.
pub(super) struct Look<'a, 'b, T> {
    pub blocks: Blocks<'a, T>,
    /// Which instances of the blocks.
    pub chosen: &'a [bool],
    /// For the instances of the blocks: observations and measures of those that are chosen.
    pub out: &'a mut Outputs<'b>,
}

impl<T: Real> Kernel<T> for Look<'_, '_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let layout = self.blocks.layout;
        let keeper = self.blocks.keeper;
        let (count, width) = (self.out.len(), keeper.observation_len());
        let mut page = [0.0; LONGEST * WIDEST];
        let mut all = [0.0; WIDEST];
        for first in (0..count).step_by(L::LANES) {
            let lanes = L::LANES.min(count - first);
            let chosen = &self.chosen[first..first + lanes];
            if !chosen.contains(&true) {
                continue;
            }
            let (columns, memory) = self.blocks.group(first);
            let stance = columns.stance::<L>(layout);
            let error = keeper.error(&memory, &stance);
            keeper.observe(&memory, &stance, &error, &mut page);
            let judgement = keeper.survey(&memory, &stance, &error);
            for (row, x) in self.out.info.iter_mut().zip(judgement.info) {
                x.store_double(&mut all);
                for lane in 0..lanes {
                    if chosen[lane] {
                        row[first + lane] = all[lane];
                    }
                }
            }
            for lane in 0..lanes {
                if chosen[lane] {
                    let row = &mut self.out.observations[(first + lane) * width..][..width];
                    for k in 0..width {
                        row[k] = page[k * L::LANES + lane];
                    }
                }
            }
        }
    }
}
