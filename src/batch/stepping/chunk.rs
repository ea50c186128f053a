//! Chunks of blocks: the unit of work of a thread.

use super::companion::{BeginCompanions, CompanionSteps, CompareCompanions};
use super::scratch_pool::ScratchPool;
use super::step::{Step, StepScaled};
use crate::batch::monitoring::step_quality::{QualityLimits, Violations};
use crate::batch::storage::active_loads::ActiveLoads;
use crate::batch::storage::layout::Layout;
use crate::batch::storage::own_numbers::OwnLayout;
use crate::batch::storage::table::Table;
use crate::integrate::Integrator;
use crate::lane::{Isa, Real, Shared};
use crate::system::{Compiled, Factors, System, UnscaledBodyTerms};

/// Instances of a chunk, in whole blocks: the unit of work of a thread. Few enough that threads finish together, and so many
/// that fetching each chunk does not show.
pub const CHUNK: usize = 128;

/// Settings of a call that steps.
#[derive(Debug, Clone, Copy)]
pub struct StepSettings {
    /// Integrator.
    pub integrator: Integrator,
    /// Step size, s.
    pub h: f64,
    /// Number of steps.
    pub substeps: usize,
    /// Number of steps before these in the call, on the clock of the servo targets.
    pub before: usize,
    /// Number of steps of the whole call.
    pub total: usize,
    /// True where companions take half steps, since longer ones would be unstable.
    pub halves: bool,
    /// Optional loads that are active.
    pub active: ActiveLoads,
    /// Greatest number of threads.
    pub threads: usize,
    /// Limits of the steps' quality; none where they are not monitored.
    pub limits: Option<QualityLimits>,
}

/// Parameters of the scene, and pools of memory for its kernels.
#[derive(Clone)]
pub(super) struct Parameters<T> {
    pub system: System<Shared<T>>,
    /// The same in scalars.
    pub scalar_system: System<T>,
    pub unscaled: Vec<UnscaledBodyTerms<Shared<T>>>,
    /// Attachment point of payloads, m.
    pub payload_attachment: [Shared<T>; 3],
    /// Scratch memory of the steps.
    pub scratch_pool: ScratchPool,
    /// Memory for systems with parameters per instance.
    pub system_pool: ScratchPool,
    /// Both of dual numbers.
    pub dual_scratch_pool: ScratchPool,
    /// See `dual_scratch_pool`.
    pub dual_system_pool: ScratchPool,
    /// Both of the adjoint, and its own memory.
    pub adjoint_pools: [ScratchPool; 3],
    /// The system without added mass, and the filter's weight, where added mass is a lagged force.
    pub rigid: Option<(System<Shared<T>>, f64)>,
}

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
    /// Violations of the settings' limits.
    pub(super) violations: Violations,
}

impl<T: Real> PhysicsChunk<'_, T> {
    /// Sets the numbers that instance `k` of the chunk has of its own: those of a scene of the same structure.
    pub fn set_own(&mut self, k: usize, compiled: &Compiled) {
        self.table.set_fins(self.rows, k, &compiled.system.deflections());
        if let Some((layout, rows)) = &mut self.own {
            layout.set(rows, k, compiled);
        }
    }

    /// Sets the factors on the parameters of instance `k` of the chunk.
    pub fn set_factors(&mut self, k: usize, factors: &Factors<f64>) {
        self.table.set_factors(self.rows, k, factors);
        *self.scaled = None;
    }

    /// Steps all instances, and their companions.
    pub fn step(&mut self) {
        let StepSettings { integrator, h, substeps, before, total, halves, limits, .. } = *self.settings;
        let (isa, table) = (self.isa, self.table);
        let layout = &table.layout;
        if let Some(rows) = layout.companion.as_deref() {
            let steps = CompanionSteps::new::<T>(&integrator, h, [before, substeps, total], halves);
            if before == 0 {
                let divisor = steps.divisor;
                T::dispatch(isa, &mut BeginCompanions { rows, layout, divisor, blocks: self.rows });
            }
            self.advance(&rows.layout, &steps.integrator, steps.h, [steps.before, steps.substeps]);
        }
        self.advance(layout, &integrator, h, [before, substeps]);
        if let (Some(rows), true) = (layout.companion.as_deref(), before + substeps == total) {
            T::dispatch(isa, &mut CompareCompanions { rows, layout, blocks: self.rows });
        }
        if let Some(limits) = limits {
            let found = table.violations(isa, self.rows, self.count, limits, h);
            if !found.is_empty() {
                self.violations.merge(&found, 0);
            }
        }
    }

    /// Steps the states in the rows of a layout: steps `before` to `before + substeps` of a call.
    fn advance(&mut self, layout: &Layout, integrator: &Integrator, h: f64, [before, substeps]: [usize; 2]) {
        let (scene, integrator) = (self.scene, *integrator);
        let [scaled, with_payload] = *self.scaled.get_or_insert_with(|| self.table.scaled(self.rows));
        let scaled = scaled || self.own.is_some();
        let mut step = Step {
            system: scene.rigid.as_ref().map_or(&scene.system, |(rigid, _)| rigid),
            scalar_system: scene.rigid.is_none().then_some(&scene.scalar_system),
            unscaled: &scene.unscaled,
            scaled,
            own: self.own.as_ref().map(|(layout, rows)| layout.columns(rows)),
            payload_attachment: with_payload.then_some(scene.payload_attachment),
            scratch_pool: &scene.scratch_pool,
            system_pool: &scene.system_pool,
            lag_filter: scene.rigid.as_ref().map(|&(_, filter)| filter),
            layout,
            integrator,
            h: T::from_f64(h),
            substeps,
            before,
            active: self.settings.active,
            count: self.count,
            blocks: self.rows,
        };
        if (scaled || integrator.needs_baseline_terms()) && self.isa.is_wide() {
            T::dispatch(self.isa, &mut StepScaled(&mut step));
        } else {
            T::dispatch(self.isa, &mut step);
        }
    }
}
