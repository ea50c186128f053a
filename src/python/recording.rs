//! `_core.Task.record`: episodes for training.

use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{copied, matrix, wrong_shape};
use super::computation::exclusive;
use super::controllers::{Controller, Mlp};
use super::task::Task;
use uvms_gym::batch::{Recorder, Recording, Teacher};

#[pymethods]
impl Task {
    /// Runs T control periods of all instances under `actor` with noise (N, T, a) on its unclipped actions, and records
    /// them: observations after h - 1 rows of zeros, h the actor's history, (N, h - 1 + T, d); perfect observations
    /// (N, T + 1, d); actions (N, T, a); rewards, alive and terminated (N, T); with a teacher its actions on perfect
    /// observations, targets (N, T, a), which are taken in place of the actor's if it acts.
    #[pyo3(signature = (actor, noise, teacher=None, *, teacher_acts=false))]
    fn record<'py>(
        slf: &Bound<'py, Self>,
        actor: PyRef<'py, Mlp>,
        noise: &Bound<'py, PyArray3<f32>>,
        teacher: Option<PyRef<'py, Controller>>,
        teacher_acts: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        let (n, shape) = (this.batch.instances(), noise.shape().to_vec());
        let (actor, takes) = (actor.mlp().clone(), this.batch.task().action_len());
        if [shape[0], shape[2]] != [n, takes] {
            return Err(wrong_shape("noise", &shape, &format!("({n}, T, {takes})")));
        }
        let noise = copied(noise)?;
        let teacher = teacher.map(|teacher| teacher.inner.clone());
        let recording = this.advance(py, f64::INFINITY, |batch| {
            let teacher = teacher.as_deref().map(|controller| Teacher { controller, acts: teacher_acts });
            batch.record(Recorder { actor: &actor, noise: &noise, teacher })
        })?;
        let Recording { observations, perfect, actions, rewards, alive, terminated, targets } = recording;
        let result = PyDict::new(py);
        result.set_item("observations", cube(py, n, shape[1] + actor.network().history - 1, observations)?)?;
        result.set_item("perfect", cube(py, n, shape[1] + 1, perfect)?)?;
        result.set_item("actions", cube(py, n, shape[1], actions)?)?;
        result.set_item("rewards", matrix(py, rewards, n)?)?;
        result.set_item("alive", matrix(py, alive, n)?)?;
        result.set_item("terminated", matrix(py, terminated, n)?)?;
        if teacher.is_some() {
            result.set_item("targets", cube(py, n, shape[1], targets)?)?;
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
