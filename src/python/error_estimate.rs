//! `uvms_gym.Simulator`: estimates of accumulated errors.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::array;
use super::simulator::Simulator;
use uvms_gym::batch;

/// Estimates of all instances by name.
pub fn error_estimate<'py>(simulator: &batch::Simulator, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
    let Some(estimates) = simulator.error_estimates() else {
        return Err(PyValueError::new_err("errors are not estimated: make it with error_estimate=True"));
    };
    let (n, joints) = (estimates.len(), simulator.joints());
    let column = |of: &dyn Fn(&batch::ErrorEstimate) -> f64| array(py, &[n], estimates.iter().map(of).collect());
    let result = PyDict::new(py);
    result.set_item("position", column(&|e| e.position)?)?;
    result.set_item("attitude", column(&|e| e.attitude)?)?;
    result.set_item("q", array(py, &[n, joints], estimates.iter().flat_map(|e| e.q[..joints].to_vec()).collect())?)?;
    result.set_item("end_effector_position", column(&|e| e.end_effector_position)?)?;
    result.set_item("end_effector_attitude", column(&|e| e.end_effector_attitude)?)?;
    result.set_item("relative", column(&|e| e.relative)?)?;
    let known: Vec<bool> = estimates.iter().map(batch::ErrorEstimate::known).collect();
    result.set_item("known", numpy::PyArray1::from_vec(py, known))?;
    Ok(result)
}

#[pymethods]
impl Simulator {
    /// Estimated errors of integration that have accumulated since the states were set; with `error_estimate=True` only.
    ///
    /// A companion of each instance follows its motion with the same integrator and inputs at half the step in float64. With a
    /// method of order p the error is the difference of both over `1 - 2^-p`, however the errors of the steps add up, and where
    /// forces have kinks (end stops, dead-bands, limits, friction at rest), which leave any method order 2, over 3/4. The estimate
    /// divides by `(1 - 2^-p)^(2/3) (3/4)^(1/3)`, 0.87 for `mk4`. In float32 rounding is part of the difference.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray
    ///     position (N,), m; attitude (N,), rad; q (N, n), rad or m; end_effector_position (N,), m; end_effector_attitude (N,),
    ///     rad; relative (N,): the maximum of the errors in position, attitude, joints and velocities, against the maximum
    ///     distance, rotation (at most 1 rad), travel (at most 1 rad or m) and velocities since the states were set; known (N,),
    ///     bool: True where `relative` is below 0.1. Beyond, or where it is NaN, the companion has gone another way, in chaotic
    ///     motion or where the step is far too long.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     The simulator was made without `error_estimate=True`.
    fn error_estimate<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        error_estimate(&self.inner, py)
    }
}
