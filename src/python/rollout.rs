//! `_core.Rollout`: episodes under a controller.

use std::sync::Arc;

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use super::arrays::matrix;
use super::computation::exclusive;
use super::controllers::Controller;
use super::errors::OrRaise;
use super::task::Task;
use uvms_gym::batch::{self, RolloutStats};
use uvms_gym::control;
use uvms_gym::limits::memory;
use uvms_gym::task::INFO;

/// Memory of a controller for a batch's instances, and statistics of the steps so far.
#[pyclass(module = "uvms_gym._core")]
pub struct Rollout {
    rollout: batch::Rollout,
    controller: Arc<dyn control::Controller>,
    /// Number of metrics.
    metrics: usize,
}

#[pymethods]
impl Rollout {
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

    /// Returns the statistics so far and clears them; the controller's memory stays. Of each instance: steps, returns,
    /// terminated and truncated (N,); sums, squares and last values of the metrics (k, N).
    fn pop_stats<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let stats = self.rollout.pop_stats();
        let metrics = |of: &dyn Fn(&RolloutStats) -> &[f64; INFO]| {
            Array2::from_shape_fn((self.metrics, stats.len()), |(k, i)| of(&stats[i])[k]).into_pyarray(py)
        };
        let result = PyDict::new(py);
        result.set_item("steps", PyArray1::from_iter(py, stats.iter().map(|one| one.steps)))?;
        result.set_item("returns", PyArray1::from_iter(py, stats.iter().map(|one| one.reward)))?;
        result.set_item("terminated", PyArray1::from_iter(py, stats.iter().map(|one| one.terminated)))?;
        result.set_item("truncated", PyArray1::from_iter(py, stats.iter().map(|one| one.truncated)))?;
        result.set_item("sums", metrics(&|one| &one.sums))?;
        result.set_item("squares", metrics(&|one| &one.squares))?;
        result.set_item("last", metrics(&|one| &one.last))?;
        Ok(result)
    }
}

#[pymethods]
impl Task {
    /// Rollout of a controller from blank memory; `trace` lists the instances to record.
    #[pyo3(signature = (controller, trace=Vec::new()))]
    fn rollout(&self, controller: PyRef<'_, Controller>, trace: Vec<usize>) -> PyResult<Rollout> {
        let controller = controller.inner.clone();
        let metrics = self.batch.task().metric_names().len();
        let memory = [self.batch.instances(), controller.widths().memory, size_of::<f64>()];
        memory::check("the controller's memory", &memory).or_raise()?;
        Ok(Rollout {
            rollout: batch::Rollout::new(&*controller, self.batch.instances(), &trace).or_raise()?,
            controller,
            metrics,
        })
    }

    /// Runs `steps` control periods of all instances under the rollout's controller from their current states. Instances
    /// whose episode is over wait. Ctrl-C interrupts: see [`Task::advance`].
    fn run(slf: &Bound<'_, Self>, mut rollout: PyRefMut<'_, Rollout>, steps: u32) -> PyResult<()> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        let Rollout { rollout, controller, .. } = &mut *rollout;
        this.advance(py, f64::INFINITY, |batch| batch.run(&**controller, rollout, steps))
    }
}
