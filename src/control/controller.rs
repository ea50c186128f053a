//! The interface of all controllers.

use std::ops::Range;

use super::ActionMap;
use crate::description::Scene;
use crate::error::ControlError;
use crate::limits::interrupt;

/// Lengths of the rows that a controller reads, remembers and writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Widths {
    /// Entries of an observation.
    pub observation: usize,
    /// Numbers of memory per instance.
    pub memory: usize,
    /// Entries of an action.
    pub action: usize,
}

impl Widths {
    /// Number of rows of these arrays.
    ///
    /// # Errors
    /// `ControlError::Shape` if a length is not a multiple of its row, or the numbers of rows differ.
    pub fn rows(&self, observations: &[f32], memory: &[f64], actions: &[f32]) -> Result<usize, ControlError> {
        let rows = observations.len() / self.observation;
        for (what, got, width) in [
            ("observations", observations.len(), self.observation),
            ("memory", memory.len(), self.memory),
            ("actions", actions.len(), self.action),
        ] {
            if got != rows * width {
                return Err(ControlError::Shape { what, got, expected: rows * width });
            }
        }
        Ok(rows)
    }

    /// Calls `control` with the observation, the memory and the action of each row, until an interrupt.
    ///
    /// # Errors
    /// As [`Self::rows`].
    pub(super) fn each_row(
        &self,
        observations: &[f32],
        memory: &mut [f64],
        actions: &mut [f32],
        mut control: impl FnMut(&[f32], &mut [f64], &mut [f32]),
    ) -> Result<(), ControlError> {
        for k in 0..self.rows(observations, memory, actions)? {
            // The question takes as long as a row of the fastest controllers.
            if k.is_multiple_of(16) && interrupt::requested() {
                break;
            }
            control(
                &observations[k * self.observation..][..self.observation],
                &mut memory[k * self.memory..][..self.memory],
                &mut actions[k * self.action..][..self.action],
            );
        }
        Ok(())
    }
}

/// Vehicle and arm that a controller with a model acts on.
#[derive(Debug, Clone)]
pub struct Plant<'a> {
    /// Checked scene.
    pub scene: &'a Scene,
    /// Meaning of its actions.
    pub actions: ActionMap,
    /// Control period, s.
    pub period: f64,
}

/// Rows of observations to rows of actions in [-1, 1], without randomness.
///
/// Rows are independent: the action of an instance depends only on its own row and memory, bit for bit, whatever the
/// number of rows.
pub trait Controller: Send + Sync {
    /// Lengths of the rows.
    fn widths(&self) -> Widths;

    /// Name and length of each block of an instance's memory, in order; none by default.
    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        Vec::new()
    }

    /// Writes actions (n x a) for finite observations (n x d), and updates the memory (n x m). The memory of an
    /// instance is all 0 when its episode begins. Rows may be left as they are after an interrupt.
    ///
    /// # Errors
    /// `ControlError::Shape` if a length is not a multiple of its row, or the numbers of rows differ; nothing has changed then.
    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError>;
}

/// Actions of a controller that shares a memory (n x width) with others: `columns` of it are its own.
///
/// # Errors
/// As [`Controller::act`].
pub(super) fn act_in_columns(
    controller: &dyn Controller,
    observations: &[f32],
    memory: &mut [f64],
    width: usize,
    columns: Range<usize>,
    actions: &mut [f32],
) -> Result<(), ControlError> {
    let rows = width.max(1);
    let mut own: Vec<f64> = memory.chunks_exact(rows).flat_map(|row| &row[columns.clone()]).copied().collect();
    controller.act(observations, &mut own, actions)?;
    for (row, new) in memory.chunks_exact_mut(rows).zip(own.chunks_exact(columns.len().max(1))) {
        row[columns.clone()].copy_from_slice(new);
    }
    Ok(())
}

/// Zero action.
#[derive(Debug, Clone, PartialEq)]
pub struct NoControl {
    widths: Widths,
}

impl NoControl {
    /// Zero actions for rows of these lengths.
    pub fn new(widths: Widths) -> Self {
        Self { widths }
    }
}

impl Controller for NoControl {
    fn widths(&self) -> Widths {
        self.widths
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths.rows(observations, memory, actions)?;
        actions.fill(0.0);
        Ok(())
    }
}
