//! Numbers of the system that differ between instances.

use super::aligned::Aligned;
use super::layout::index;
use crate::error::SimulatorError;
use crate::lane::{Lane, Numbers, Real, Routine, RunVisitor};
use crate::limits::interrupt;
use crate::system::{Compiled, Factors, InstanceSystem};

/// First row of each run of numbers ([`InstanceSystem::visit`]); none where all instances share the run.
pub type RunRows = Vec<Option<u32>>;

/// Numbers of the system that differ between instances, in rows of blocks like the states.
#[derive(Debug, Clone)]
pub struct OwnNumbers<T> {
    /// Layout of the rows.
    pub layout: OwnLayout,
    /// Whole blocks.
    pub rows: Aligned<T>,
}

/// Layout of these rows.
#[derive(Debug, Clone)]
pub struct OwnLayout {
    /// First row of each run.
    run_rows: RunRows,
    /// Rows of a block.
    pub width: usize,
    /// Numbers of all runs in the first instance.
    runs: Vec<Vec<f64>>,
}

/// Numbers of several whole blocks, and their layout.
#[derive(Debug, Clone, Copy)]
pub struct OwnColumns<'a, T> {
    layout: &'a OwnLayout,
    rows: &'a [T],
}

impl OwnLayout {
    /// The blocks of these rows.
    pub fn columns<'a, T>(&'a self, rows: &'a [T]) -> OwnColumns<'a, T> {
        OwnColumns { layout: self, rows }
    }

    /// Copies the numbers of instance `i` of such rows to column `column` of others in double precision.
    pub fn copy<T: Real>(&self, rows: &[T], i: usize, to: &mut [f64], column: usize) {
        for row in 0..self.width {
            to[index::<f64>(self.width, column, row)] = rows[index::<T>(self.width, i, row)].to_f64();
        }
    }

    /// Sets the numbers of instance `i` of these rows.
    pub fn set<T: Real>(&self, rows: &mut [T], i: usize, compiled: &Compiled) {
        for ((first, common), run) in self.run_rows.iter().zip(&self.runs).zip(runs_of(compiled)) {
            let Some(first) = first else {
                debug_assert_eq!(run, *common, "a number that all instances share");
                continue;
            };
            for (k, number) in run.into_iter().enumerate() {
                rows[index::<T>(self.width, i, *first as usize + k)] = T::from_f64(number);
            }
        }
    }
}

impl<T: Real> OwnNumbers<T> {
    /// Numbers of `instances` instances: all numbers that differ between the first `samples` scenes that `compiled` compiles, which
    /// have the same structure; `None` if nothing differs. Instances beyond these samples have the numbers of the first.
    ///
    /// # Errors
    /// [`SimulatorError::Memory`] if they do not fit into memory.
    pub fn new(
        instances: usize,
        samples: usize,
        compiled: &dyn Fn(usize) -> Compiled,
    ) -> Result<Option<Self>, SimulatorError> {
        let runs = runs_of(&compiled(0));
        let mut differs = vec![false; runs.len()];
        for i in 1..samples {
            if interrupt::requested() {
                return Err(SimulatorError::Interrupted);
            }
            for ((differs, first), run) in differs.iter_mut().zip(&runs).zip(runs_of(&compiled(i))) {
                *differs |= *first != run;
            }
        }
        let mut width = 0;
        let mut take = |(differs, run): (bool, &Vec<f64>)| {
            let first = width as u32;
            width += if differs { run.len() } else { 0 };
            differs.then_some(first)
        };
        let run_rows: RunRows = differs.into_iter().zip(&runs).map(&mut take).collect();
        if width == 0 {
            return Ok(None);
        }
        let memory = || SimulatorError::Memory { instances };
        let columns = instances.checked_next_multiple_of(T::BLOCK).ok_or_else(memory)?;
        let size = columns.checked_mul(width).ok_or_else(memory)?;
        let rows = Aligned::filled(size, T::from_f64(0.0)).map_err(|_| memory())?;
        let (layout, mut rows, first) = (OwnLayout { run_rows, width, runs }, rows, compiled(0));
        for i in 0..columns {
            if interrupt::requested() {
                return Err(SimulatorError::Interrupted);
            }
            // Columns past the last instance need valid numbers too.
            if i < samples.min(instances) {
                layout.set(&mut rows, i, &compiled(i));
            } else {
                layout.set(&mut rows, i, &first);
            }
        }
        Ok(Some(Self { layout, rows }))
    }

    /// All blocks.
    pub fn columns(&self) -> OwnColumns<'_, T> {
        self.layout.columns(&self.rows)
    }
}

impl<'a, T: Real> OwnColumns<'a, T> {
    /// Block `k`.
    #[inline(always)]
    pub fn block(&self, k: usize) -> &'a [T] {
        let size = self.layout.width * T::BLOCK;
        self.rows.get(k * size..(k + 1) * size).unwrap_or_default()
    }
}

/// Loads the numbers of a column group into the system of its instances.
struct RunLoader<'a, T> {
    run_rows: std::slice::Iter<'a, Option<u32>>,
    block: &'a [T],
    first: usize,
}

impl<L: Lane> RunVisitor<L> for RunLoader<'_, L::Real> {
    #[inline(always)]
    fn visit(&mut self, run: &mut [L]) {
        let Some(Some(row)) = self.run_rows.next() else { return };
        let mut at = *row as usize * L::Real::BLOCK + self.first;
        for number in run {
            if let Some(lanes) = self.block.get(at..at + L::LANES) {
                *number = L::load(lanes);
            }
            at += L::Real::BLOCK;
        }
    }
}

/// Loads numbers that instances have of their own, and makes the terms of the bodies of them. (A routine by itself: it takes no
/// registers in the kernels, and its length does not add to theirs.)
pub struct LoadNumbers<'a, L: Lane> {
    /// The system of the column group.
    pub instances: &'a mut InstanceSystem<L>,
    /// Their own numbers.
    pub own: &'a OwnColumns<'a, L::Real>,
    /// Number of the block, and the first column in it.
    pub at: [usize; 2],
    /// Factors on the bodies' terms.
    pub factors: &'a Factors<L>,
    /// As for [`crate::system::System::apply_factors`].
    pub body_frame_terms: bool,
}

impl<L: Lane> Routine<L> for LoadNumbers<'_, L> {
    #[inline(always)]
    fn run(&mut self) {
        let [block, first] = self.at;
        let run_rows = self.own.layout.run_rows.iter();
        self.instances.visit(&mut RunLoader { run_rows, block: self.own.block(block), first });
        self.instances.attach_payload();
        let InstanceSystem { system, unscaled, .. } = &mut *self.instances;
        system.apply_factors(unscaled, self.factors, self.body_frame_terms);
    }
}

/// Collects runs.
struct Collector(Vec<Vec<f64>>);

impl RunVisitor<f64> for Collector {
    fn visit(&mut self, run: &mut [f64]) {
        self.0.push(run.to_vec());
    }
}

/// Numbers of a compiled scene, run by run.
fn runs_of(compiled: &Compiled) -> Vec<Vec<f64>> {
    let mut collector = Collector(Vec::new());
    InstanceSystem::from(compiled).visit(&mut collector);
    collector.0
}
