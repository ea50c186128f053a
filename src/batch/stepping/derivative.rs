//! Derivatives of steps: the kernel of the steps over dual numbers.
//!
//! A dual block is a block of values followed by a block of slopes, in the same rows. Each of its columns is one instance along
//! one direction: before the steps, slopes of state, loads and factors are the direction; afterwards, slopes of the state are the
//! derivatives of the stepped state. Columns do not influence each other.

use std::convert::Infallible;
use std::mem::ManuallyDrop;
use std::sync::{Mutex, PoisonError};

use super::blocks::Blocks;
use super::parameters::StepSettings;
use super::step::Step;
use super::threads::for_each;
use crate::batch::storage::inputs::CheckedInputs;
use crate::batch::storage::own_numbers::LoadNumbers;
use crate::batch::storage::table::Table;
use crate::lane::{Dual, Kernel, Lane, Real, Rows};
use crate::limits::interrupt;

/// Columns of a block.
const COLUMNS: usize = f64::BLOCK;
/// Steps of a block's columns between two questions for an interrupt: some tens of milliseconds.
const PORTION: usize = 1 << 12;

/// An instance in rows before the steps.
#[derive(Clone, Copy)]
pub struct StartColumn<'a> {
    /// Layout of the rows, and the links' frames.
    pub table: &'a Table,
    /// Rows with the inputs.
    pub rows: &'a [f64],
    /// Column of the instance.
    pub column: usize,
}

impl StartColumn<'_> {
    /// Number in a row.
    pub fn get(&self, row: usize) -> f64 {
        self.rows[row * COLUMNS + self.column]
    }
}

/// An instance in rows of values and of derivatives: slopes along a direction, or cotangents.
pub struct DerivativeColumn<'a> {
    /// The instance before the steps.
    pub start: StartColumn<'a>,
    /// Rows of the values: to read results, after the steps.
    pub values: &'a [f64],
    /// Rows of the derivatives.
    pub derivatives: &'a mut [f64],
    /// Column of the instance in both.
    pub column: usize,
}

impl DerivativeColumn<'_> {
    /// Value in a row.
    pub fn value(&self, row: usize) -> f64 {
        self.values[row * COLUMNS + self.column]
    }

    /// Derivative in a row.
    pub fn derivative(&self, row: usize) -> f64 {
        self.derivatives[row * COLUMNS + self.column]
    }

    /// Adds to the derivative in a row.
    pub fn add(&mut self, row: usize, x: f64) {
        self.derivatives[row * COLUMNS + self.column] += x;
    }

    /// Sets the derivative in a row.
    pub fn set(&mut self, row: usize, x: f64) {
        self.derivatives[row * COLUMNS + self.column] = x;
    }
}

/// Directions along which the steps of all instances are differentiated.
pub trait Directions: Sync {
    /// Directions of each instance, at least 1.
    fn count(&self) -> usize;
    /// Adds the slopes of direction `k` of instance `i`.
    fn seed(&self, i: usize, k: usize, column: &mut DerivativeColumn);
    /// Reads the derivatives of the steps of an instance along its direction `k` into the numbers of the instance.
    fn read(&self, k: usize, column: &DerivativeColumn, out: &mut [f64]);
}

/// Numbers of a dual block: pairs of a number in its first half and one in its second.
pub trait Pairs {
    /// Steps the columns of a block.
    fn step(step: &Step<f64>, rows: &mut [f64]);
}

/// Dual numbers in the lanes of AVX2 or NEON.
pub struct Duals;

impl Pairs for Duals {
    fn step(step: &Step<f64>, rows: &mut [f64]) {
        f64::dispatch_wide(&mut StepDuals { step, rows });
    }
}

impl Blocks<f64> {
    /// Derivatives of the steps of all instances under these inputs, along all directions: `width` numbers of each instance. Some
    /// directions change payloads only if `payload`. The instances are not stepped. Numbers after an interrupt are invalid.
    pub fn differentiate<N: Pairs>(
        &self,
        settings: &StepSettings,
        inputs: &CheckedInputs,
        directions: &impl Directions,
        payload: bool,
        width: usize,
    ) -> Vec<f64> {
        let done = self.each_block(settings, inputs, width, |block, rows, out| {
            self.differentiate_block::<N>(settings, directions, payload, block, rows, out);
            Ok::<_, Infallible>(())
        });
        let Ok(out) = done;
        out
    }

    /// `width` numbers of each instance, which `work` writes, given the number of a block, its rows with the inputs, and memory for
    /// the numbers of its instances. After an interrupt it is not called.
    ///
    /// # Errors
    /// An error of `work`.
    pub(super) fn each_block<E: Send>(
        &self,
        settings: &StepSettings,
        inputs: &CheckedInputs,
        width: usize,
        work: impl Fn(usize, &[f64], &mut [f64]) -> Result<(), E> + Sync,
    ) -> Result<Vec<f64>, E> {
        let size = self.table.layout.rows * COLUMNS;
        let mut out = vec![0.0; self.instances * width];
        let failure = Mutex::new(Ok(()));
        if width > 0 {
            let items = self.rows.chunks_exact(size).zip(out.chunks_mut(COLUMNS * width)).enumerate();
            for_each(items, settings.threads, |(block, (rows, out))| {
                if interrupt::requested() {
                    return;
                }
                let (mut rows, first) = (rows.to_vec(), block * COLUMNS);
                self.table.apply(self.isa, &mut rows, inputs, first, COLUMNS.min(self.instances - first));
                if let Err(error) = work(block, &rows, out) {
                    *failure.lock().unwrap_or_else(PoisonError::into_inner) = Err(error);
                }
            });
        }
        failure.into_inner().unwrap_or_else(PoisonError::into_inner).map(|()| out)
    }

    /// Derivatives of one block, whose rows have the inputs.
    fn differentiate_block<N: Pairs>(
        &self,
        settings: &StepSettings,
        directions: &impl Directions,
        payload: bool,
        block: usize,
        rows: &[f64],
        out: &mut [f64],
    ) {
        let (table, scene, count) = (&self.table, &self.scene, directions.count());
        let members = COLUMNS.min(self.instances - block * COLUMNS);
        let width = out.len() / members;
        let payload = table.scaled(rows)[1] || payload;
        let own_rows = self.own.as_ref().map(|own| (&own.layout, own.columns().block(block)));
        let mut own = own_rows.map_or(Vec::new(), |(_, rows)| vec![0.0; rows.len()]);
        let mut dual = vec![0.0; 2 * rows.len()];
        // Pairs of an instance and a direction fill the columns; the last pair is repeated in columns that are left.
        let pairs = members * count;
        for pair in (0..pairs).step_by(COLUMNS) {
            let filled = COLUMNS.min(pairs - pair);
            let instances: [usize; COLUMNS] = std::array::from_fn(|column| (pair + column).min(pairs - 1) / count);
            let (values, slopes) = dual.split_at_mut(rows.len());
            gather(rows, &instances, values);
            slopes.fill(0.0);
            for column in 0..filled {
                let (i, k) = (block * COLUMNS + instances[column], (pair + column) % count);
                let start = StartColumn { table, rows, column: instances[column] };
                directions.seed(i, k, &mut DerivativeColumn { start, values, derivatives: slopes, column });
            }
            if let Some((_, rows)) = own_rows {
                gather(rows, &instances, &mut own);
            }
            let own = own_rows.map(|(layout, _)| layout.columns(&own));
            let mut step = Step {
                scalar_system: None,
                scratch_pool: &scene.dual_scratch_pool,
                system_pool: &scene.dual_system_pool,
                ..scene.steps(&table.layout, own, [true, payload], settings, filled, &mut [])
            };
            // The portions make no difference to the result.
            let end = settings.before + settings.substeps;
            while step.before < end {
                step.substeps = PORTION.min(end - step.before);
                N::step(&step, &mut dual);
                step.before += step.substeps;
                if interrupt::requested() {
                    return;
                }
            }
            let (values, slopes) = dual.split_at_mut(rows.len());
            for column in 0..filled {
                let (out, k) = (&mut out[instances[column] * width..][..width], (pair + column) % count);
                let start = StartColumn { table, rows, column: instances[column] };
                directions.read(k, &DerivativeColumn { start, values, derivatives: slopes, column }, out);
            }
        }
    }
}

/// Columns of a block, in this order.
fn gather(rows: &[f64], columns: &[usize; COLUMNS], to: &mut [f64]) {
    for (row, to) in rows.chunks_exact(COLUMNS).zip(to.chunks_exact_mut(COLUMNS)) {
        for (to, column) in to.iter_mut().zip(columns) {
            *to = row[*column];
        }
    }
}

/// Kernel of the steps of a dual block.
struct StepDuals<'s, 'a> {
    step: &'s Step<'a, f64>,
    rows: &'s mut [f64],
}

impl Kernel<f64> for StepDuals<'_, '_> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        step_pairs::<Dual<L>>(self.step, self.rows);
    }
}

/// Steps the columns of a block of pairs, with parameters of single columns.
#[inline(always)]
pub fn step_pairs<L: Lane<Real = f64>>(step: &Step<f64>, rows: &mut [f64]) {
    let (mut memory, instances) = step.memory_and_system::<L>(true);
    // As in `Step`: nothing here panics.
    let mut instances = ManuallyDrop::new(instances);
    for first in (0..COLUMNS).step_by(L::LANES) {
        let (true, Some(instances)) = (first < step.count, &mut *instances) else { break };
        let mut columns = Rows::of_block(&mut *rows, first);
        let factors = columns.factors(step.layout);
        let body_frame_terms = step.integrator.implicit();
        if let Some(own) = &step.own {
            L::call(&mut LoadNumbers { instances, own, at: [0, first], factors: &factors, body_frame_terms });
        } else {
            instances.system.apply_factors(step.unscaled, &factors, body_frame_terms);
        }
        step.step_group::<_, _, _, false>(&instances.system, &[], &mut columns, &mut memory, &mut ());
    }
    step.return_memory(memory, ManuallyDrop::into_inner(instances));
}
