//! Adjoint of steps: cotangents of state, inputs and parameters from cotangents of the stepped state. A name `of_x`, or `of`, is
//! the cotangent of x: the derivative of the scalar by x.
//!
//! The steps of a column group are taken and recorded, then reversed. The record has the start of each sub-interval and the
//! rates of its stages, for one column group at a time; all else is computed again.

use std::mem::ManuallyDrop;
use std::ops::Range;

use super::blocks::Blocks;
use super::derivative::{DerivativeColumn, StartColumn};
use super::parameters::{ScratchPool, StepSettings};
use super::reverse::ReverseMemory;
use super::step::Step;
use crate::batch::storage::inputs::CheckedInputs;
use crate::batch::storage::own_numbers::LoadNumbers;
use crate::error::OutOfMemory;
use crate::lane::{Kernel, Lane, Real, Rows, Tape};
use crate::limits::{interrupt, memory};

/// Columns of a block.
const COLUMNS: usize = f64::BLOCK;
/// Recorded steps between two questions for an interrupt.
const PORTION: usize = 1 << 12;

/// Functions of the steps whose gradients are computed.
pub trait Cotangents: Sync {
    /// Sets the cotangents of the stepped state of instance `i`: of the rotation three, of delta in `R exp([delta])`, in its first
    /// rows.
    fn seed(&self, i: usize, column: &mut DerivativeColumn);
    /// Reads the gradient of instance `i` from the cotangents of state, inputs and factors.
    fn read(&self, i: usize, column: &DerivativeColumn, out: &mut [f64]);
}

impl Blocks<f64> {
    /// Gradients of all instances under these inputs: `width` numbers of each; with respect to factors on the bodies and to
    /// payloads only where `by` says so. The instances are not stepped. Numbers after an interrupt are invalid.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the record of the steps does not fit into memory.
    pub fn pull_back(
        &self,
        settings: &StepSettings,
        inputs: &CheckedInputs,
        cotangents: &impl Cotangents,
        by: [bool; 2],
        width: usize,
    ) -> Result<Vec<f64>, OutOfMemory> {
        self.each_block(settings, inputs, width, |block, start, out| {
            self.pull_back_block(settings, cotangents, by, block, start, out)
        })
    }

    /// Gradients of one block, whose rows have the inputs.
    fn pull_back_block(
        &self,
        settings: &StepSettings,
        cotangents: &impl Cotangents,
        [factors, payload]: [bool; 2],
        block: usize,
        start: &[f64],
        out: &mut [f64],
    ) -> Result<(), OutOfMemory> {
        let (table, scene) = (&self.table, &self.scene);
        let count = COLUMNS.min(self.instances - block * COLUMNS);
        let width = out.len() / count;
        let payload = table.scaled(start)[1] || payload;
        let mut rows = start.to_vec();
        let own = self.own.as_ref().map(|own| own.columns());
        let step = Step {
            scalar_system: None,
            scratch_pool: &scene.adjoint_pools[0],
            system_pool: &scene.adjoint_pools[1],
            ..scene.steps(&table.layout, own, [true, payload], settings, count, &mut rows)
        };
        let mut of = vec![0.0; start.len()];
        let seed = |of: &mut [f64], end: &[f64], columns: Range<usize>| {
            for column in columns {
                let i = block * COLUMNS + column;
                let start = StartColumn { table, rows: start, column };
                cotangents.seed(i, &mut DerivativeColumn { start, values: end, derivatives: of, column });
            }
        };
        let pool = &scene.adjoint_pools[2];
        let records = settings.threads.min(self.instances.div_ceil(COLUMNS));
        let mut kernel = Reverse { step, block, of: &mut of, seed: &seed, factors, pool, records, failure: Ok(()) };
        f64::dispatch_fused(self.isa, &mut kernel);
        kernel.failure?;
        for (column, out) in out.chunks_exact_mut(width).enumerate() {
            let start = StartColumn { table, rows: start, column };
            let found = DerivativeColumn { start, values: &rows, derivatives: &mut of, column };
            cotangents.read(block * COLUMNS + column, &found, out);
        }
        Ok(())
    }
}

/// Function of cotangents, stepped states and columns that sets the cotangents of the stepped states in these columns.
type Seed<'s> = dyn Fn(&mut [f64], &[f64], Range<usize>) + 's;

/// Kernel of the adjoint of a block. (Not generic: it takes a minute to compile.)
struct Reverse<'s, 'a> {
    step: Step<'a, f64>,
    block: usize,
    of: &'s mut [f64],
    seed: &'s Seed<'s>,
    factors: bool,
    pool: &'s ScratchPool,
    /// Records at a time.
    records: usize,
    failure: Result<(), OutOfMemory>,
}

impl Kernel<f64> for Reverse<'_, '_> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let step = &mut self.step;
        let rows = std::mem::take(&mut step.blocks);
        let mut memory = step.memory::<L>();
        let mut reverse = self.pool.take().unwrap_or_else(make_memory::<L>);
        let mut instances = ManuallyDrop::new(step.system::<L>(step.unscaled));
        for first in (0..COLUMNS).step_by(L::LANES) {
            if first >= step.count {
                break;
            }
            let instances = &mut **instances;
            let mut columns = Rows::of_block(&mut *rows, first);
            let factors = columns.factors(step.layout);
            if let Some(own) = &step.own {
                let (at, factors) = ([self.block, first], &factors);
                L::call(&mut LoadNumbers { instances, own, at, factors, body_frame_terms: true });
            } else {
                instances.system.apply_factors(step.unscaled, &factors, true);
            }
            reverse.record.tape.clear();
            reverse.record.sub_intervals.clear();
            let (before, substeps) = (step.before, step.substeps);
            let (records, end) = (self.records, before + substeps);
            let mut portions = Portions { next: before, end, records, recorded: 0, largest: 0 };
            self.failure = loop {
                match portions.next(step, &mut reverse.record.tape) {
                    Ok(true) => {}
                    end => break end.map(drop),
                }
                let (system, record) = (&instances.system, &mut Some(&mut reverse.record));
                step.step_group::<_, _, _, true>(system, &[], &mut columns, &mut memory, record);
            };
            (step.before, step.substeps) = (before, substeps);
            if portions.next < end || self.failure.is_err() {
                break;
            }
            (self.seed)(&mut *self.of, &*columns.numbers, first..(first + L::LANES).min(step.count));
            let of = &mut Rows::of_block(&mut *self.of, first);
            step.reverse_group(instances, &columns, of, &mut reverse, self.factors);
        }
        step.return_memory(memory, Some(ManuallyDrop::into_inner(instances)));
        reverse.record.trim();
        self.pool.put(reverse);
    }
}

/// Portions of recorded steps.
struct Portions {
    /// Next step, and the step after the last one.
    next: usize,
    end: usize,
    /// Records at a time.
    records: usize,
    /// Numbers recorded before the last portion, and by a portion at most.
    recorded: usize,
    largest: usize,
}

impl Portions {
    /// Sets the steps to the next portion, for which the record has room; false after the last one, at an interrupt, and where
    /// memory ends. (A call, as the next function: the steps themselves contain none.)
    #[inline(never)]
    fn next(&mut self, step: &mut Step<f64>, tape: &mut Tape<f64>) -> Result<bool, OutOfMemory> {
        if self.next == self.end || interrupt::requested() {
            return Ok(false);
        }
        let last = tape.len() - self.recorded;
        if last > 0 {
            // At first for all portions to come; later for one, as sub-intervals of steps differ.
            let portions = if self.largest == 0 { (self.end - self.next).div_ceil(PORTION) } else { 1 };
            self.largest = self.largest.max(last);
            let count = (self.largest + self.largest / 8).saturating_mul(portions);
            if tape.room() < count {
                let what = "the record of the steps (take fewer substeps)";
                memory::check(what, &[self.records, count, size_of::<f64>()])?;
                tape.reserve_exact(count);
            }
        }
        self.recorded = tape.len();
        (step.before, step.substeps) = (self.next, PORTION.min(self.end - self.next));
        self.next += step.substeps;
        Ok(true)
    }
}

/// Memory of the reverse.
#[inline(never)]
fn make_memory<L: Lane>() -> Box<ReverseMemory<L>> {
    Box::new(ReverseMemory::new())
}
