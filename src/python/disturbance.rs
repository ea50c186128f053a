//! Disturbances: levels by name, and what is to come of an episode.

use numpy::PyArray1;
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

use super::errors::OrRaise;
use super::task::{Task, refused, rows};
use uvms_gym::error::TaskError;
use uvms_gym::task::StartOverride;
use uvms_gym::task::disturbance::{Disturbance, LEVELS, Profile};

/// Levels of disturbances: name, a sentence for people, and the components as JSON.
#[pyfunction]
pub fn disturbances() -> Vec<(&'static str, &'static str, String)> {
    LEVELS.iter().map(|level| (level.name, level.description, level.disturbance().to_json())).collect()
}

/// Most control periods that are looked ahead.
const FARTHEST: u32 = 1_000_000;

#[pymethods]
impl Task {
    /// What disturbances will come to in the next `steps` control periods of instance `i`, for a vehicle that stays where it
    /// is: time (T,), current and acceleration (T, 3), wrench (T, 6), gains (T, thrusters) and payload (T,).
    fn disturbance<'py>(&self, py: Python<'py>, i: usize, steps: u32) -> PyResult<Bound<'py, PyDict>> {
        let instances = self.batch.instances();
        if i >= instances {
            return Err(PyIndexError::new_err(format!("there is no instance {i} among {instances}")));
        }
        if steps > FARTHEST {
            return Err(PyValueError::new_err(format!("steps is {steps}, but must be at most {FARTHEST}")));
        }
        let not_begun = || refused(TaskError::NotBegun { instance: i });
        let step = self.batch.episode(i).ok_or_else(not_begun)?.step();
        let profile = self.batch.profile(i, steps).ok_or_else(not_begun)?;
        let Profile { velocity, acceleration, wrench, gains, payload } = profile;
        let (count, period) = (payload.len(), self.batch.task().options().control_period());
        let result = PyDict::new(py);
        result.set_item("time", PyArray1::from_iter(py, (step..).take(count).map(|k| f64::from(k) * period)))?;
        result.set_item("current", rows(py, velocity.concat(), count)?)?;
        result.set_item("acceleration", rows(py, acceleration.concat(), count)?)?;
        result.set_item("wrench", rows(py, wrench.concat(), count)?)?;
        result.set_item("gains", rows(py, gains.concat(), count)?)?;
        result.set_item("payload", PyArray1::from_vec(py, payload))?;
        Ok(result)
    }
}

/// Sets the disturbance of every start: JSON for all, or one per instance.
pub(super) fn set_starts(starts: &mut [StartOverride], given: &Bound<'_, PyAny>) -> PyResult<()> {
    if given.is_instance_of::<PyString>() {
        let disturbance = Disturbance::from_json(&given.extract::<String>()?).or_raise()?;
        starts.iter_mut().for_each(|start| start.disturbance = Some(disturbance.clone()));
        return Ok(());
    }
    let given: Vec<String> = given.extract()?;
    let (got, expected) = (given.len(), starts.len());
    if got != expected {
        return Err(PyValueError::new_err(format!("disturbance has {got} entries, but must have {expected}")));
    }
    for (start, json) in starts.iter_mut().zip(given) {
        start.disturbance = Some(Disturbance::from_json(&json).or_raise()?);
    }
    Ok(())
}
