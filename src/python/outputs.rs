//! Arrays that steps write to.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadwriteArray1, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use super::task::{Row, Rows};
use uvms_gym::batch::Outputs;

/// Arrays of past steps. Those that nobody holds any more are written to again: to make new ones and to fill them with zeros
/// would take some hundredths of a step.
#[derive(Default)]
pub(super) struct Past(Vec<Kept>);

/// The arrays of a step, of whatever type and shape they have come to be with those who had them.
type Kept = [Py<PyAny>; 5];

/// The arrays of a step of N instances.
pub(super) struct Sheets<'py> {
    /// (N, d).
    pub observations: Rows<'py, f32>,
    /// (N,).
    pub rewards: Row<'py, f64>,
    /// (N,).
    pub terminated: Row<'py, bool>,
    /// (N,).
    pub truncated: Row<'py, bool>,
    /// (k, N).
    pub info: Rows<'py, f64>,
}

/// Leave to write to them.
pub(super) struct Open<'py> {
    observations: PyReadwriteArray2<'py, f32>,
    rewards: PyReadwriteArray1<'py, f64>,
    flags: [PyReadwriteArray1<'py, bool>; 2],
    info: PyReadwriteArray2<'py, f64>,
}

impl Past {
    /// Sets of arrays that are kept: what a step brought is mostly held until the next one has returned.
    const MOST: usize = 2;

    /// Arrays for a step of `n` instances with `width` entries of an observation and `metrics` metrics. Their contents are those of another step, but
    /// for `truncated`, where nothing is.
    pub fn take<'py>(&mut self, py: Python<'py>, [n, width, metrics]: [usize; 3]) -> PyResult<Sheets<'py>> {
        #[expect(deprecated, reason = "what takes its place reads raw pointers")]
        let held_here_alone = |array: &Py<PyAny>| array.get_refcnt(py) == 1;
        let free = self.0.iter().position(|kept| kept.iter().all(held_here_alone));
        let again = free.and_then(|k| Sheets::again(py, &self.0.remove(k), [n, width, metrics]));
        let sheets = again.unwrap_or_else(|| Sheets::new(py, [n, width, metrics]));
        sheets.truncated.readwrite().as_slice_mut()?.fill(false);
        Ok(sheets)
    }

    /// Keeps arrays, in place of the oldest ones if there are many.
    pub fn keep(&mut self, sheets: &Sheets<'_>) {
        if self.0.len() == Self::MOST {
            self.0.remove(0);
        }
        self.0.push(sheets.all().map(|array| array.clone().unbind()));
    }
}

impl<'py> Sheets<'py> {
    fn new(py: Python<'py>, [n, width, metrics]: [usize; 3]) -> Self {
        Self {
            observations: PyArray2::zeros(py, [n, width], false),
            rewards: PyArray1::zeros(py, n, false),
            terminated: PyArray1::zeros(py, n, false),
            truncated: PyArray1::zeros(py, n, false),
            info: PyArray2::zeros(py, [metrics, n], false),
        }
    }

    /// Those that were kept, if they still are what they were.
    fn again(py: Python<'py>, kept: &Kept, [n, width, metrics]: [usize; 3]) -> Option<Self> {
        let [observations, rewards, terminated, truncated, info] = kept.each_ref().map(|array| array.bind(py));
        let sheets = Self {
            observations: observations.cast().ok()?.clone(),
            rewards: rewards.cast().ok()?.clone(),
            terminated: terminated.cast().ok()?.clone(),
            truncated: truncated.cast().ok()?.clone(),
            info: info.cast().ok()?.clone(),
        };
        let row = [n];
        let fits = sheets.observations.shape() == [n, width]
            && sheets.info.shape() == [metrics, n]
            && sheets.observations.is_c_contiguous()
            && sheets.info.is_c_contiguous()
            && [sheets.rewards.shape(), sheets.terminated.shape(), sheets.truncated.shape()] == [&row; 3];
        (fits && sheets.open().is_ok()).then_some(sheets)
    }

    fn all(&self) -> [&Bound<'py, PyAny>; 5] {
        [&self.observations, &self.rewards, &self.terminated, &self.truncated, &self.info]
    }

    /// Leave to write.
    ///
    /// # Errors
    /// Somebody has taken that away.
    pub fn open(&self) -> PyResult<Open<'py>> {
        Ok(Open {
            observations: self.observations.try_readwrite()?,
            rewards: self.rewards.try_readwrite()?,
            flags: [self.terminated.try_readwrite()?, self.truncated.try_readwrite()?],
            info: self.info.try_readwrite()?,
        })
    }
}

impl Open<'_> {
    /// The memory of the arrays.
    ///
    /// # Errors
    /// An array is not contiguous.
    pub fn outputs(&mut self) -> PyResult<Outputs<'_>> {
        let [terminated, truncated] = &mut self.flags;
        let flags = [terminated.as_slice_mut()?, truncated.as_slice_mut()?];
        let info = self.info.as_slice_mut()?;
        Ok(Outputs::new(self.observations.as_slice_mut()?, self.rewards.as_slice_mut()?, flags, info))
    }
}
