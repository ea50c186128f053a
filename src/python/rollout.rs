//! `_core.Rollout`: episodes under a controller; `_core.Task.record`: episodes for training.

use std::sync::Arc;

use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray1, PyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use super::arrays::{copied, dict, matrix, wrong_shape};
use super::computation::exclusive;
use super::controllers::{Controller, Mlp};
use super::errors::OrRaise;
use super::task::Task;
use uvms_gym::batch::{self, Recorder, Recording, RolloutStats, Teacher};
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
            let steps = trace.rewards.len();
            traces.append(dict! { py;
                "instance": trace.instance,
                "observations": matrix(py, trace.observations.clone(), steps)?,
                "actions": matrix(py, trace.actions.clone(), steps)?,
                "rewards": PyArray1::from_slice(py, &trace.rewards),
                "info": matrix(py, trace.info.clone(), steps)?,
            })?;
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
        Ok(dict! { py;
            "steps": PyArray1::from_iter(py, stats.iter().map(|one| one.steps)),
            "returns": PyArray1::from_iter(py, stats.iter().map(|one| one.reward)),
            "terminated": PyArray1::from_iter(py, stats.iter().map(|one| one.terminated)),
            "truncated": PyArray1::from_iter(py, stats.iter().map(|one| one.truncated)),
            "sums": metrics(&|one| &one.sums),
            "squares": metrics(&|one| &one.squares),
            "last": metrics(&|one| &one.last),
        })
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

    /// Runs T control periods of all instances under `actor` with noise (N, T, a) on its unclipped actions, and records
    /// them: observations after h - 1 rows of zeros, h the actor's history, (N, h - 1 + T, d); perfect observations
    /// (N, T + 1, d); actions (N, T, a); rewards, alive and terminated (N, T); with a teacher its actions on perfect
    /// observations, targets (N, T, a), which replace the actor's if it acts; with `frames` states and memories
    /// (N, T + 1, .).
    #[pyo3(signature = (actor, noise, teacher=None, *, teacher_acts=false, frames=false))]
    fn record<'py>(
        slf: &Bound<'py, Self>,
        actor: PyRef<'py, Mlp>,
        noise: &Bound<'py, PyArray3<f32>>,
        teacher: Option<PyRef<'py, Controller>>,
        teacher_acts: bool,
        frames: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        let (n, shape) = (this.batch.instances(), noise.shape().to_vec());
        let (actor, takes) = (actor.mlp().clone(), this.batch.task().action_len());
        let steps = match shape[..] {
            [rows, steps, width] if [rows, width] == [n, takes] => steps,
            _ => return Err(wrong_shape("noise", &shape, &format!("({n}, T, {takes})"))),
        };
        let noise = copied(noise)?;
        let teacher = teacher.map(|teacher| teacher.inner.clone());
        let Recording {
            observations,
            perfect,
            actions,
            rewards,
            alive,
            terminated,
            targets,
            frames: [states, memories],
        } = this.advance(py, f64::INFINITY, |batch| {
            let teacher = teacher.as_deref().map(|controller| Teacher { controller, acts: teacher_acts });
            let frames = if frames { batch.frame_widths() } else { [0, 0] };
            batch.record(Recorder { actor: &actor, noise: &noise, teacher, frames })
        })?;
        let result = dict! { py;
            "observations": cube(py, n, steps + actor.network().history - 1, observations)?,
            "perfect": cube(py, n, steps + 1, perfect)?,
            "actions": cube(py, n, steps, actions)?,
            "rewards": matrix(py, rewards, n)?,
            "alive": matrix(py, alive, n)?,
            "terminated": matrix(py, terminated, n)?,
        };
        if teacher.is_some() {
            result.set_item("targets", cube(py, n, steps, targets)?)?;
        }
        if frames {
            result.set_item("states", cube(py, n, steps + 1, states)?)?;
            result.set_item("memories", cube(py, n, steps + 1, memories)?)?;
        }
        Ok(result)
    }
}

/// A fresh (n, rows, .) array from its entries by rows.
fn cube<'py>(py: Python<'py>, n: usize, rows: usize, flat: Vec<f32>) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let width = flat.len() / (n * rows).max(1);
    let array = Array3::from_shape_vec((n, rows, width), flat).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(array.into_pyarray(py))
}
