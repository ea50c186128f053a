//! Chunks of blocks: the unit of work of a thread.

use super::companion::{ChunkCompanions, CompanionScene, Leaders};
use super::parameters::{Parameters, StepSettings};
use crate::batch::monitoring::step_quality::Violations;
use crate::batch::storage::own_numbers::OwnLayout;
use crate::batch::storage::table::Table;
use crate::lane::{Isa, Real};
use crate::system::{Compiled, Factors, State};

/// Instances of a chunk, in whole blocks: the unit of work of a thread. Few enough that threads finish together, and so many
/// that fetching each chunk does not show.
pub const CHUNK: usize = 128;

/// A chunk of blocks, which one thread steps.
pub struct PhysicsChunk<'a, T> {
    pub(super) scene: &'a Parameters<T>,
    pub(super) settings: &'a StepSettings,
    /// Number of its instances; further columns fill the last block.
    pub count: usize,
    /// Number of its first instance among all.
    pub first: usize,
    /// Access to single instances, counted from 0 in the chunk.
    pub table: &'a Table,
    /// Instruction set of the kernels.
    pub isa: Isa,
    /// Numbers that instances have of their own.
    pub(super) own: Option<(&'a OwnLayout, &'a mut [T])>,
    /// The blocks.
    pub rows: &'a mut [T],
    /// [`Table::scaled`] of the chunk; none once factors have been set.
    pub(super) scaled: &'a mut Option<[bool; 2]>,
    /// Companions of some instances.
    pub(super) companions: Option<(&'a CompanionScene, &'a mut ChunkCompanions)>,
    /// Violations of the settings' limits.
    pub(super) violations: Violations,
}

impl<T: Real> PhysicsChunk<'_, T> {
    /// Sets the state of instance `k` of the chunk.
    pub fn set_state(&mut self, k: usize, state: &State) {
        self.table.set_state(self.rows, k, state);
        if let Some((scene, companions)) = &mut self.companions {
            companions.set_state(scene, k, state);
        }
    }

    /// Sets the velocities of instance `k` of the chunk; its companion gains the same change.
    pub fn set_velocities(&mut self, k: usize, state: &State) {
        if let Some((scene, companions)) = &mut self.companions {
            companions.change_velocities(scene, k, &self.table.state(self.rows, k), state);
        }
        self.table.set_velocities(self.rows, k, state);
    }

    /// Sets the numbers that instance `k` of the chunk has of its own, from a scene of the same structure.
    pub fn set_own(&mut self, k: usize, compiled: &Compiled) {
        self.table.set_fins(self.rows, k, &compiled.system.terms.deflections());
        if let Some((layout, rows)) = &mut self.own {
            layout.set(rows, k, compiled);
        }
        if let Some(track) = self.companions.as_mut().and_then(|(_, companions)| companions.track(k)) {
            track.own_stale = true;
        }
    }

    /// Sets the factors on the parameters of instance `k` of the chunk.
    pub fn set_factors(&mut self, k: usize, factors: &Factors<f64>) {
        self.table.set_factors(self.rows, k, factors);
        *self.scaled = None;
    }

    /// Steps all instances, and their companions.
    pub fn step(&mut self) {
        let &StepSettings { h, substeps, before, total, limits, .. } = self.settings;
        let scaled = *self.scaled.get_or_insert_with(|| self.table.scaled(self.rows));
        let mut followed = false;
        if let Some((scene, companions)) = &mut self.companions {
            let own = self.own.as_ref().map(|(layout, rows)| (*layout, &**rows));
            let leaders = Leaders { scene: self.scene, table: self.table, rows: self.rows, own, count: self.count };
            followed = companions.step(scene, &leaders, scaled, self.settings);
        }
        let own = self.own.as_ref().map(|(layout, rows)| layout.columns(rows));
        self.scene.steps(&self.table.layout, own, scaled, self.settings, self.count, self.rows).run(self.isa);
        let mut found = Violations::default();
        if let Some(limits) = limits {
            found = self.table.violations(self.isa, self.rows, self.count, limits, h);
        }
        if let (true, Some((scene, companions))) = (followed, &mut self.companions)
            && (before + substeps == total || !scene.follows_all())
        {
            companions.compare(scene, self.table, self.rows, self.settings, &mut found);
        }
        if !found.is_empty() {
            self.violations.merge(&found, 0);
        }
    }
}
