//! Numbers of each instance, computed on the simulator's threads.

use std::sync::{Mutex, PoisonError};

use super::Simulator;
use crate::batch::stepping::threads::for_each;
use crate::batch::storage::inputs::{CheckedInputs, Inputs};
use crate::error::SimulatorError;
use crate::limits::{interrupt, memory};

/// Instances that a thread computes at a time.
const PART: usize = 16;

impl Simulator {
    /// K arrays of rows of these widths, one row per instance, which `rows` computes.
    ///
    /// # Errors
    /// [`SimulatorError::OutOfMemory`], [`SimulatorError::Interrupted`], and the error of the first instance that has one.
    pub fn each_instance<const K: usize>(
        &self,
        widths: [usize; K],
        rows: impl Fn(usize) -> Result<[Vec<f64>; K], SimulatorError> + Sync,
    ) -> Result<[Vec<f64>; K], SimulatorError> {
        let instances = self.instances();
        memory::check("the results (take fewer instances)", &[instances, widths.iter().sum(), size_of::<f64>()])?;
        let mut columns = widths.map(|width| vec![0.0; instances * width]);
        let mut parts = columns.each_mut().map(|column| {
            let width = column.len() / instances;
            (width, column.chunks_mut((PART * width).max(1)))
        });
        let failure: Mutex<Option<(usize, SimulatorError)>> = Mutex::new(None);
        let items = (0..instances.div_ceil(PART)).map(|part| {
            (part * PART, parts.each_mut().map(|(width, chunks)| (*width, chunks.next().unwrap_or_default())))
        });
        for_each(items, self.threads().min(instances.div_ceil(PART)), |(first, mut parts)| {
            for i in first..(first + PART).min(instances) {
                let found = if interrupt::requested() { Err(SimulatorError::Interrupted) } else { rows(i) };
                match found {
                    Ok(rows) => {
                        for ((width, part), row) in parts.iter_mut().zip(rows) {
                            part[(i - first) * *width..][..*width].copy_from_slice(&row);
                        }
                    }
                    Err(error) => {
                        let mut failure = failure.lock().unwrap_or_else(PoisonError::into_inner);
                        if failure.as_ref().is_none_or(|(before, _)| i < *before) {
                            *failure = Some((i, error));
                        }
                        return;
                    }
                }
            }
        });
        match failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some((_, error)) => Err(error),
            None => Ok(columns),
        }
    }

    /// Linearizations of all instances: A, (N, 2 (6 + n), 2 (6 + n)), and B, (N, 2 (6 + n), 6 + n), by rows; see
    /// [`Self::linearize`].
    ///
    /// # Errors
    /// As [`Self::step`] and [`Self::each_instance`].
    pub fn linearizations(&self, inputs: &Inputs) -> Result<[Vec<f64>; 2], SimulatorError> {
        let inputs = CheckedInputs::new(inputs, self.scene(), self.allocation(), self.own.as_ref(), self.options())?;
        let rates = 6 + self.joints();
        self.each_instance([4 * rates * rates, 2 * rates * rates], |i| {
            let linear = self.linearize_checked(&inputs, i);
            Ok([linear.a, linear.b].map(|matrix| matrix.transpose().as_slice().to_vec()))
        })
    }
}
