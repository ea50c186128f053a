//! Derivatives of steps: the kernel of the steps over dual numbers.
//!
//! A dual block holds a block of values and behind it a block of slopes, in the same rows. Each of its columns is one instance
//! along one direction: rows of state, loads and factors have the slopes of that direction at first, and those of the state have
//! the derivatives of the stepped state in the end. Columns do not influence each other, as those of the steps.

use std::mem::ManuallyDrop;

use super::blocks::Blocks;
use super::instance_numbers::LoadNumbers;
use super::parameters::StepSettings;
use super::step::Step;
use super::threads::for_each;
use crate::batch::storage::columns::Columns;
use crate::batch::storage::inputs::CheckedInputs;
use crate::batch::storage::table::Table;
use crate::lane::{Dual, Kernel, Lane, Real};
use crate::limits::interrupt;

/// Columns of a block.
const COLUMNS: usize = f64::BLOCK;
/// Steps of a block's columns between two questions for an interrupt: some tens of milliseconds.
const PORTION: usize = 1 << 12;

/// A column of a dual block: an instance along a direction.
pub struct DualColumn<'a> {
    /// Layout of the rows, and the links' frames.
    pub table: &'a Table,
    values: &'a [f64],
    slopes: &'a mut [f64],
    column: usize,
    /// Rows of the instances before the steps, and the instance's column among them.
    start: (&'a [f64], usize),
}

impl DualColumn<'_> {
    /// Value in a row before the steps.
    pub fn start(&self, row: usize) -> f64 {
        self.start.0[row * COLUMNS + self.start.1]
    }

    /// Slope in a row.
    pub fn slope(&self, row: usize) -> f64 {
        self.slopes[row * COLUMNS + self.column]
    }
}

/// Slopes of the rows of an instance.
pub trait Slopes<'a> {
    /// Layout of the rows, and the links' frames.
    fn table(&self) -> &'a Table;
    /// Value in a row.
    fn value(&self, row: usize) -> f64;
    /// Adds to the slope in a row.
    fn add_slope(&mut self, row: usize, slope: f64);
}

impl<'a> Slopes<'a> for DualColumn<'a> {
    fn table(&self) -> &'a Table {
        self.table
    }
    fn value(&self, row: usize) -> f64 {
        self.values[row * COLUMNS + self.column]
    }
    fn add_slope(&mut self, row: usize, slope: f64) {
        self.slopes[row * COLUMNS + self.column] += slope;
    }
}

/// Directions along which the steps of all instances are differentiated.
pub trait Directions: Sync {
    /// Directions of each instance, at least 1.
    fn count(&self) -> usize;
    /// True where one changes payloads.
    fn payload(&self) -> bool;
    /// Adds the slopes of direction `k` of instance `i`.
    fn seed(&self, i: usize, k: usize, column: &mut DualColumn);
    /// Reads the derivatives of the steps of an instance along its direction `k` into the numbers of the instance.
    fn read(&self, k: usize, column: &DualColumn, out: &mut [f64]);
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
    /// Derivatives of the steps of all instances under these inputs, along all directions: `width` numbers of each instance. The
    /// instances are not stepped. Numbers after an interrupt mean nothing.
    pub fn differentiate<N: Pairs>(
        &self,
        settings: &StepSettings,
        inputs: &CheckedInputs,
        directions: &impl Directions,
        width: usize,
    ) -> Vec<f64> {
        let size = self.table.layout.rows * COLUMNS;
        let mut out = vec![0.0; self.instances * width];
        if width > 0 {
            let items = self.rows.chunks_exact(size).zip(out.chunks_mut(COLUMNS * width)).enumerate();
            for_each(items, settings.threads, |(block, (rows, out))| {
                if interrupt::requested() {
                    return;
                }
                let mut rows = rows.to_vec();
                let first = block * COLUMNS;
                self.table.apply(self.isa, &mut rows, inputs, first, COLUMNS.min(self.instances - first));
                self.differentiate_block::<N>(settings, directions, block, &rows, out);
            });
        }
        out
    }

    /// The same of one block, whose rows hold the inputs.
    fn differentiate_block<N: Pairs>(
        &self,
        settings: &StepSettings,
        directions: &impl Directions,
        block: usize,
        rows: &[f64],
        out: &mut [f64],
    ) {
        let (table, scene, count) = (&self.table, &self.scene, directions.count());
        let members = COLUMNS.min(self.instances - block * COLUMNS);
        let width = out.len() / members;
        let [_, with_payload] = table.scaled(rows);
        let payload = with_payload || directions.payload();
        let own_rows = self.own.as_ref().map(|own| (own.layout(), own.columns().block(block)));
        let mut own = own_rows.map_or(Vec::new(), |(_, rows)| vec![0.0; rows.len()]);
        let mut dual = vec![0.0; 2 * rows.len()];
        // Pairs of an instance and a direction, as many at a time as there are columns; the last pair fills up the last ones.
        let pairs = members * count;
        for pair in (0..pairs).step_by(COLUMNS) {
            let filled = COLUMNS.min(pairs - pair);
            let instances: [usize; COLUMNS] = std::array::from_fn(|column| (pair + column).min(pairs - 1) / count);
            let (values, slopes) = dual.split_at_mut(rows.len());
            gather(rows, &instances, values);
            slopes.fill(0.0);
            for column in 0..filled {
                let (i, start) = (block * COLUMNS + instances[column], (rows, instances[column]));
                directions.seed(i, (pair + column) % count, &mut DualColumn { table, values, slopes, column, start });
            }
            if let Some((_, rows)) = own_rows {
                gather(rows, &instances, &mut own);
            }
            let mut step = Step {
                system: &scene.system,
                scalar_system: None,
                unscaled: &scene.unscaled,
                scaled: true,
                own: own_rows.map(|(layout, _)| layout.columns(&own)),
                payload_attachment: payload.then_some(scene.payload_attachment),
                scratch_pool: &scene.dual_scratch_pool,
                system_pool: &scene.dual_system_pool,
                lag_filter: None,
                layout: &table.layout,
                integrator: settings.integrator,
                h: settings.h,
                substeps: settings.substeps,
                before: settings.before,
                active: settings.active,
                count: filled,
                blocks: &mut [],
            };
            // The portions make no difference to the result, as those of the steps.
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
                let (out, start) = (&mut out[instances[column] * width..][..width], (rows, instances[column]));
                let k = (pair + column) % count;
                directions.read(k, &DualColumn { table, values, slopes, column, start }, out);
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
        let mut columns = Columns { rows: &mut *rows, first };
        let factors = columns.factors(step.layout);
        let body_frame_terms = step.integrator.implicit();
        if let Some(own) = &step.own {
            let (run_rows, block, factors) = (own.run_rows, own.block(0), &factors);
            L::call(&mut LoadNumbers { instances, run_rows, block, first, factors, body_frame_terms });
        } else {
            instances.system.apply_factors(step.unscaled, &factors, body_frame_terms);
        }
        step.step_group::<_, _, _, false>(&instances.system, &[], &mut columns, &mut memory, &mut ());
    }
    step.return_memory(memory, ManuallyDrop::into_inner(instances));
}
