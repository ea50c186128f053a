//! Arrays of the caller that steps write to.

use numpy::{PyArrayMethods, PyReadwriteArray1, PyReadwriteArray2};
use pyo3::prelude::*;

use super::arrays::{Row, Rows};
use uvms_gym::batch::Outputs;

/// Arrays of the results of a step of N instances.
#[derive(FromPyObject)]
pub(super) struct StepArrays<'py>(
    /// Observations (N, d).
    Rows<'py, f32>,
    /// Rewards (N,).
    Row<'py, f64>,
    /// Terminated (N,).
    Row<'py, bool>,
    /// Truncated (N,).
    Row<'py, bool>,
    /// Metrics (k, N).
    Rows<'py, f64>,
);

/// Write guards of [`StepArrays`].
pub(super) struct Guards<'py> {
    observations: PyReadwriteArray2<'py, f32>,
    rewards: PyReadwriteArray1<'py, f64>,
    flags: [PyReadwriteArray1<'py, bool>; 2],
    info: PyReadwriteArray2<'py, f64>,
}

impl<'py> StepArrays<'py> {
    /// Locks the arrays for writing; their contents need not be initialized.
    ///
    /// # Errors
    /// An array is read-only, or written to by another call.
    pub fn lock(&self) -> PyResult<Guards<'py>> {
        let Self(observations, rewards, terminated, truncated, info) = self;
        Ok(Guards {
            observations: observations.try_readwrite()?,
            rewards: rewards.try_readwrite()?,
            flags: [terminated.try_readwrite()?, truncated.try_readwrite()?],
            info: info.try_readwrite()?,
        })
    }
}

impl Guards<'_> {
    /// Memory of the arrays. A step sets `truncated` only where it is true, so it is cleared here.
    ///
    /// # Errors
    /// An array is not contiguous.
    pub fn outputs(&mut self) -> PyResult<Outputs<'_>> {
        let [terminated, truncated] = &mut self.flags;
        let flags = [terminated.as_slice_mut()?, truncated.as_slice_mut()?];
        flags[1].fill(false);
        let info = self.info.as_slice_mut()?;
        Ok(Outputs::new(self.observations.as_slice_mut()?, self.rewards.as_slice_mut()?, flags, info))
    }
}
