//! Disturbances: levels by name, and the forecast of an episode's disturbance.

use numpy::PyArray1;
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{dict, matrix};
use super::computation::interruptible;
use super::errors::IntoPyErr;
use super::task::Task;
use uvms_gym::error::TaskError;
use uvms_gym::task::disturbance::{LEVELS, Profile};

/// Levels of disturbances: name, description, and the components as JSON.
#[pyfunction]
pub fn disturbance_levels() -> Vec<(&'static str, &'static str, String)> {
    LEVELS.iter().map(|level| (level.name, level.description, level.disturbance().to_json())).collect()
}

/// Longest forecast, control periods.
const FARTHEST: u32 = 1_000_000;

#[pymethods]
impl Task {
    /// Disturbance of instance `i` over the next `steps` control periods, for a vehicle that stays in place: time (T,), current and acceleration (T, 3), wrench (T, 6), gains (T, thrusters) and payload (T,).
    fn disturbance<'py>(&self, py: Python<'py>, i: usize, steps: u32) -> PyResult<Bound<'py, PyDict>> {
        let instances = self.batch.instances();
        if i >= instances {
            return Err(PyIndexError::new_err(format!("there is no instance {i} among {instances}")));
        }
        if steps > FARTHEST {
            return Err(PyValueError::new_err(format!("steps is {steps}, but must be at most {FARTHEST}")));
        }
        let not_begun = || TaskError::NotBegun { instance: i }.into_py_err();
        let step = self.batch.episode(i).ok_or_else(not_begun)?.step();
        let profile = interruptible(py, || self.batch.profile(i, steps))?.ok_or_else(not_begun)?;
        let Profile { velocity, acceleration, wrench, gains, payload } = profile;
        let (count, period) = (payload.len(), self.batch.task().options().control_period());
        Ok(dict! { py;
            "time": PyArray1::from_iter(py, (step..).take(count).map(|k| f64::from(k) * period)),
            "current": matrix(py, velocity.concat(), count)?,
            "acceleration": matrix(py, acceleration.concat(), count)?,
            "wrench": matrix(py, wrench.concat(), count)?,
            "gains": matrix(py, gains.concat(), count)?,
            "payload": PyArray1::from_vec(py, payload),
        })
    }
}
