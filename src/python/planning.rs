//! `_core.optimize_trajectory`: trajectory optimisation, by flat arrays.

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use super::arrays::{array, read};
use super::computation::interruptible;
use super::errors::OrRaise;
use super::simulator::Simulator;
use uvms_gym::batch::Argument;
use uvms_gym::optimize::Settings;
use uvms_gym::planning::{Numbers, Plan, Problems, input_argument, input_width, optimize};
use uvms_gym::system::State;

fn arguments(simulator: &Simulator, names: &[String]) -> PyResult<Vec<Argument>> {
    let found: Result<Vec<_>, _> = names.iter().map(|name| input_argument(&simulator.inner, name)).collect();
    found.or_raise()
}

/// Width of each input that a trajectory chooses; ValueError for one that the scene does not have.
#[pyfunction]
pub fn trajectory_inputs(simulator: PyRef<'_, Simulator>, names: Vec<String>) -> PyResult<Vec<usize>> {
    let found = arguments(&simulator, &names)?;
    Ok(found.into_iter().map(|argument| input_width(&simulator.inner, argument)).collect())
}

/// Trajectories of minimum cost, by arrays of `Problems` under its names; see `uvms_gym.optimize_trajectory`.
#[pyfunction]
#[pyo3(signature = (simulator, inputs, arrays, *, horizon, substeps, iterations, tolerance))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn optimize_trajectory<'py>(
    py: Python<'py>,
    simulator: PyRef<'py, Simulator>,
    inputs: Vec<String>,
    arrays: &Bound<'py, PyDict>,
    horizon: usize,
    substeps: usize,
    iterations: usize,
    tolerance: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let chosen = arguments(&simulator, &inputs)?;
    let numbers = |name: &str| match arrays.get_item(name)? {
        Some(given) => Ok::<_, PyErr>(read(name, &given)?.1),
        None => Ok(Vec::new()),
    };
    let (references, weights) = (numbers("references")?, numbers("weights")?);
    let (input_references, input_weights) = (numbers("input_references")?, numbers("input_weights")?);
    let (lower, upper, start) = (numbers("lower")?, numbers("upper")?, numbers("start")?);
    let problems = Problems {
        horizon,
        substeps,
        inputs: &chosen,
        numbers: Numbers {
            references: &references,
            weights: &weights,
            input_references: &input_references,
            input_weights: &input_weights,
            lower: &lower,
            upper: &upper,
        },
        start: &start,
        settings: Settings { iterations, tolerance },
    };
    let inner = &simulator.inner;
    let plans = interruptible(py, || optimize(inner, &problems))?.or_raise()?;
    let (count, joints) = (plans.len(), inner.joints());
    let result = PyDict::new(py);
    let all = |name: &str, shape: &[usize], of: &dyn Fn(&Plan) -> Vec<f64>| {
        let shape = [&[count], shape].concat();
        result.set_item(name, array(py, &shape, plans.iter().flat_map(of).collect())?)
    };
    let states = |name: &str, shape: &[usize], of: &dyn Fn(&State) -> Vec<f64>| {
        let shape = [&[horizon + 1], shape].concat();
        all(name, &shape, &|plan| plan.trajectory.states.iter().flat_map(of).collect())
    };
    let w = chosen.iter().map(|argument| input_width(inner, *argument)).sum();
    all("inputs", &[horizon, w], &|plan| plan.trajectory.inputs.clone())?;
    all("gains", &[horizon, w, inner.state_size()], &|plan| {
        plan.solution.policies.iter().flat_map(|policy| policy.gain.transpose().as_slice().to_vec()).collect()
    })?;
    states("position", &[3], &|state| state.position.as_slice().to_vec())?;
    states("rotation", &[3, 3], &|state| state.rotation.transpose().as_slice().to_vec())?;
    states("q", &[joints], &|state| state.q[..joints].to_vec())?;
    states("twist", &[6], &|state| state.twist.as_slice().to_vec())?;
    states("qd", &[joints], &|state| state.qd[..joints].to_vec())?;
    all("end_effector", &[horizon + 1, 3], &|plan| plan.end_effector.concat())?;
    all("decrement", &[], &|plan| vec![plan.solution.decrement])?;
    let costs = plans.iter().map(|plan| PyArray1::from_slice(py, &plan.solution.costs));
    result.set_item("costs", PyList::new(py, costs)?)?;
    result.set_item("converged", PyArray1::from_iter(py, plans.iter().map(|plan| plan.solution.converged)))?;
    Ok(result)
}
