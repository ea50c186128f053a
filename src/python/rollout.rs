//! `_core.Rollout`: episodes under a policy.

use std::sync::Arc;

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use super::arrays::{Row, Rows, matrix};
use super::controllers::Controller;
use super::errors::OrRaise;
use super::stability::warn;
use super::task::Task;
use uvms_gym::batch::{self, RolloutStats};
use uvms_gym::control;
use uvms_gym::task::INFO;

/// What a policy remembers of a batch's instances, and what came of it so far.
#[pyclass(module = "uvms_gym._core")]
pub struct Rollout {
    rollout: batch::Rollout,
    policy: Arc<dyn control::Controller>,
    /// Number of metrics.
    metrics: usize,
}

#[pymethods]
impl Rollout {
    /// Control periods that count, (N,).
    #[getter]
    fn steps<'py>(&self, py: Python<'py>) -> Row<'py, u32> {
        self.each(py, |stats| stats.steps)
    }

    /// Sum of the rewards, (N,).
    #[getter]
    fn returns<'py>(&self, py: Python<'py>) -> Row<'py, f64> {
        self.each(py, |stats| stats.reward)
    }

    /// Episodes that ended for a reason within the task, (N,).
    #[getter]
    fn terminated<'py>(&self, py: Python<'py>) -> Row<'py, bool> {
        self.each(py, |stats| stats.terminated)
    }

    /// Episodes that ended because their time did, (N,).
    #[getter]
    fn truncated<'py>(&self, py: Python<'py>) -> Row<'py, bool> {
        self.each(py, |stats| stats.truncated)
    }

    /// Sums of the measures, (k, N).
    #[getter]
    fn sums<'py>(&self, py: Python<'py>) -> Rows<'py, f64> {
        self.measures(py, |stats| &stats.sums)
    }

    /// Sums of their squares, (k, N).
    #[getter]
    fn squares<'py>(&self, py: Python<'py>) -> Rows<'py, f64> {
        self.measures(py, |stats| &stats.squares)
    }

    /// The measures after the last control period that counts, (k, N).
    #[getter]
    fn last<'py>(&self, py: Python<'py>) -> Rows<'py, f64> {
        self.measures(py, |stats| &stats.last)
    }

    /// Records of the chosen instances, in ascending order: instance, observations (T, d), actions (T, a), rewards (T,)
    /// and info (T, k).
    #[getter]
    fn traces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let traces = PyList::empty(py);
        for trace in self.rollout.traces() {
            let (steps, entry) = (trace.rewards.len(), PyDict::new(py));
            entry.set_item("instance", trace.instance)?;
            entry.set_item("observations", matrix(py, trace.observations.clone(), steps)?)?;
            entry.set_item("actions", matrix(py, trace.actions.clone(), steps)?)?;
            entry.set_item("rewards", PyArray1::from_slice(py, &trace.rewards))?;
            entry.set_item("info", matrix(py, trace.info.clone(), steps)?)?;
            traces.append(entry)?;
        }
        Ok(traces)
    }

    /// Counts anew from here on; the policy forgets nothing.
    fn count_anew(&mut self) {
        self.rollout.pop_stats();
    }
}

impl Rollout {
    fn each<'py, T: numpy::Element>(&self, py: Python<'py>, of: impl Fn(&RolloutStats) -> T) -> Row<'py, T> {
        PyArray1::from_iter(py, self.rollout.stats().iter().map(of))
    }

    fn measures<'py>(&self, py: Python<'py>, of: impl Fn(&RolloutStats) -> &[f64; INFO]) -> Rows<'py, f64> {
        let stats = self.rollout.stats();
        Array2::from_shape_fn((self.metrics, stats.len()), |(k, i)| of(&stats[i])[k]).into_pyarray(py)
    }
}

#[pymethods]
impl Task {
    /// A rollout of a policy that remembers nothing yet; `trace` names instances to record.
    #[pyo3(signature = (policy, trace=Vec::new()))]
    fn rollout(&self, policy: PyRef<'_, Controller>, trace: Vec<usize>) -> PyResult<Rollout> {
        let policy = policy.inner.clone();
        let metrics = self.batch.task().metric_names().len();
        Ok(Rollout {
            rollout: batch::Rollout::new(&*policy, self.batch.instances(), &trace).or_raise()?,
            policy,
            metrics,
        })
    }

    /// So many control periods of all instances under the rollout's policy, from where they stand. Instances whose
    /// episode is over wait.
    fn run(&mut self, py: Python<'_>, mut rollout: PyRefMut<'_, Rollout>, steps: u32) -> PyResult<()> {
        let (batch, Rollout { rollout, policy, .. }) = (&mut self.batch, &mut *rollout);
        if let Some(unstable) = batch.warn_of_step() {
            warn(py, &unstable.to_string())?;
        }
        py.detach(|| batch.run(&**policy, rollout, steps)).or_raise()?;
        if let Some(stray) = batch.warn_of_motion() {
            warn(py, &stray.to_string())?;
        }
        Ok(())
    }
}
