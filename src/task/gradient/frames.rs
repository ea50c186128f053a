//! Frames, coordinates and blocks of gradients.

use std::ops::Range;

use crate::error::{ControlError, SimulatorError, TaskError};
use crate::lane::{Isa, Real};
use crate::task::episode::EpisodeRows;

/// Frames of a block.
pub(super) const BLOCK: usize = f64::BLOCK;

/// Numbers of coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GradientWidths {
    /// State of vehicle and joints: `[xi; q; V; q']` with the pose `T exp(xi)` and the coordinates of fixtures behind those of the robot's joints, 12 + 2 n.
    pub state: usize,
    /// Measured quantities: pose error, twist, joint coordinates, joint rates and, where observed, the direction against gravity.
    pub measurement: usize,
    /// Memory.
    pub memory: usize,
    /// Entries of an observation.
    pub observation: usize,
    /// Entries of an action.
    pub action: usize,
    /// Thrusts, and torques of driven joints.
    pub force: usize,
    /// Rows of a recorded memory.
    pub rows: usize,
}

impl GradientWidths {
    /// Numbers of a frame's state: rotation by rows (9), position, twist, joint coordinates and rates.
    pub fn state_numbers(&self) -> usize {
        self.state + 6
    }
}

/// Frames after the physics.
pub struct Evaluated<'a> {
    /// States, (k, [`GradientWidths::state_numbers`]).
    pub states: &'a [f32],
    /// Memory at that instant, (k, rows).
    pub memory: &'a [f32],
    /// Memory one control period before, (k, rows), for the rows that the task updates.
    pub before: &'a [f32],
    /// Instances whose measurement belongs to this state, (k,).
    pub fresh: &'a [bool],
    /// The observation comes from perfect sensors.
    pub perfect: bool,
}

/// Frames before the physics.
pub struct Acted<'a> {
    /// Memory at that instant, (k, rows).
    pub memory: &'a [f32],
    /// Actions, (k, a).
    pub actions: &'a [f64],
    /// Actions of the base controller, (k, a), with residual actions.
    pub base: Option<&'a [f64]>,
}

/// Refuses arrays of other lengths, given as name, length and what it must be, and machines without the lanes.
pub(super) fn check(lengths: &[(&'static str, usize, usize)]) -> Result<(), TaskError> {
    if !Isa::available().any(Isa::is_wide) {
        return Err(SimulatorError::DerivativeLanes.into());
    }
    match lengths.iter().find(|(_, got, expected)| got != expected) {
        Some(&(what, got, expected)) => Err(ControlError::Shape { what, got, expected }.into()),
        None => Ok(()),
    }
}

impl Acted<'_> {
    pub(super) fn check(&self, widths: &GradientWidths, cotangents: Option<&[f64]>) -> Result<(), TaskError> {
        let (k, outputs, actions) = (self.actions.len() / widths.action, widths.force + widths.memory, self.actions);
        check(&[
            ("actions", actions.len(), k * widths.action),
            ("memories", self.memory.len(), k * widths.rows),
            ("base", self.base.unwrap_or(actions).len(), actions.len()),
            ("cotangents", cotangents.map_or(k * outputs, <[f64]>::len), k * outputs),
        ])
    }
}

/// Row of coordinate `k` of the memory.
#[inline(always)]
pub(super) fn memory_row(rows: &EpisodeRows, k: usize) -> usize {
    let common = rows.means - rows.action;
    if k < common { rows.action + k } else { rows.task.updated[0] + k - common }
}

/// Copies some rows of frames (k, width) to the columns of a block; columns past the last frame repeat it.
pub(super) fn pack<T: Real>(frames: &[T], rows: Range<usize>, width: usize, first: usize, block: &mut [f64]) {
    let last = frames.len() / width - 1;
    for column in 0..BLOCK {
        let frame = &frames[(first + column).min(last) * width..];
        for row in rows.clone() {
            block[row * BLOCK + column] = frame[row].to_f64();
        }
    }
}

/// Copies the columns of a block to the rows of frames (k, width).
pub(super) fn unpack(block: &[f64], width: usize, first: usize, frames: &mut [f64]) {
    let left = frames[first * width..].chunks_exact_mut(width);
    for (column, frame) in left.take(BLOCK).enumerate() {
        for (row, x) in frame.iter_mut().enumerate() {
            *x = block[row * BLOCK + column];
        }
    }
}
