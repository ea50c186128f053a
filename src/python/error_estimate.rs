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
    /// A companion of each instance follows its motion with the same integrator and inputs at steps that are r times as long, r
    /// between 3/2 and 2 (5/3 for calls of 5, 10, ... steps): with a method of order p the error is the difference of both over
    /// `r^p - 1`, however the errors of the steps add up, and where forces have kinks (end stops, dead-bands, limits, friction at
    /// rest), which leave any method order 2, over `r^2 - 1`. The estimate divides by `(r^p - 1)^(2/3) (r^2 - 1)^(1/3)`: for `mk4`
    /// and r = 5/3 it is 1.6 times too great in smooth motion and 2.4 times too small at kinks. In float32 differences below 1e-4
    /// turn into rounding, whose divisor is 1.26, down to 1e-6. After a call of a single step, and where twice the step would be
    /// unstable, r is 1/2, at twice a step's cost. A call with another r than the last counts with the smaller divisor.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray
    ///     position (N,), m; attitude (N,), rad; q (N, n), rad or m; end_effector_position (N,), m; end_effector_attitude (N,),
    ///     rad; relative (N,): the greatest of the errors in position, attitude, joints and velocities, against the greatest
    ///     distance, rotation (at most 1 rad), travel (at most 1 rad or m) and velocities since the states were set; known (N,),
    ///     bool: True where `relative` is below 0.1. Beyond, the companion has gone another way, in chaotic motion or where the
    ///     step is far too long: the error is then at least of the size given.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     The simulator was made without `error_estimate=True`.
    fn error_estimate<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        error_estimate(&self.inner, py)
    }
}
