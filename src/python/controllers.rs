//! `_core.Controller` and `_core.Mlp`.

use std::collections::BTreeMap;
use std::sync::Arc;

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};

use super::arrays::{Rows, copied, matrix, name_of, one_of};
use super::computation::interruptible;
use super::errors::OrRaise;
use super::task::Task;
use uvms_gym::control::{
    self, Activation, Blend, GainMap, Layer, Network, Normalisation, Output, PolicySpec, ResidualController, gain_value,
};
use uvms_gym::task::ControllerKind;

const ACTIVATIONS: [(&str, Activation); 3] =
    [("tanh", Activation::Tanh), ("relu", Activation::Relu), ("elu", Activation::Elu)];
const OUTPUTS: [(&str, Output); 2] = [("clip", Output::Clip), ("tanh", Output::Tanh)];

/// A native controller, for `act` and for the closed loop of `Task.run`.
#[pyclass(module = "uvms_gym._core", subclass, frozen)]
pub struct Controller {
    pub(super) inner: Arc<dyn control::Controller>,
    gains: GainMap,
}

impl Controller {
    /// Without gains.
    pub(super) fn new(inner: Arc<dyn control::Controller>) -> Self {
        Self { inner, gains: GainMap::new() }
    }
}

#[pymethods]
impl Controller {
    /// Lengths of a row of observations, memory and actions.
    #[getter]
    fn widths(&self) -> [usize; 3] {
        let control::Widths { observation, memory, action } = self.inner.widths();
        [observation, memory, action]
    }

    /// Gains by name: numbers and arrays.
    #[getter]
    fn gains<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let result = PyDict::new(py);
        for (name, value) in &self.gains {
            if name == "hold" {
                let names: Vec<_> = value.as_array().into_iter().flatten().filter_map(|name| name.as_str()).collect();
                result.set_item(name, PyTuple::new(py, names)?)?;
            } else if let Some(list) = value.as_array() {
                let numbers: Vec<f64> = list.iter().filter_map(|x| x.as_f64()).collect();
                result.set_item(name, numbers.to_pyarray(py))?;
            } else if let Some(integer) = value.as_u64() {
                result.set_item(name, integer)?;
            } else {
                result.set_item(name, value.as_f64())?;
            }
        }
        Ok(result)
    }

    /// The weighted mean of controllers, with the guard of a task between two pose errors.
    #[staticmethod]
    fn blend(parts: Vec<(PyRef<'_, Self>, f64)>, guard: Option<(PyRef<'_, Task>, [f64; 2])>) -> PyResult<Self> {
        let parts = parts.iter().map(|(part, weight)| (part.inner.clone(), *weight)).collect();
        let guard = guard.map(|(task, range)| task.batch.task().guard(range)).transpose().or_raise()?;
        Ok(Self::new(Arc::new(Blend::new(parts, guard).or_raise()?)))
    }

    /// Name and length of each block of an instance's memory, in order.
    #[getter]
    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        self.inner.memory_layout()
    }

    /// Actions (n, a) for observations (n, d) and memory (n, m), and the updated memory.
    fn act<'py>(
        &self,
        py: Python<'py>,
        observations: PyReadonlyArray2<'py, f32>,
        memory: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<(Rows<'py, f32>, Rows<'py, f64>)> {
        let [d, m, a] = self.widths();
        let n = observations.shape()[0];
        for (name, shape, expected) in [("observations", observations.shape(), d), ("memory", memory.shape(), m)] {
            let &[rows, width] = shape else { unreachable!("the array has two dimensions") };
            if width != expected {
                return Err(PyValueError::new_err(format!("{name} have {width} entries, expected {expected}")));
            }
            if rows != n {
                return Err(PyValueError::new_err(format!("{name} have {rows} rows, expected {n}")));
            }
        }
        let (observations, mut memory) = (copied(&observations)?, copied(&memory)?);
        let mut actions = vec![0.0; n * a];
        interruptible(py, || self.inner.act(&observations, &mut memory, &mut actions))?.or_raise()?;
        Ok((matrix(py, actions, n)?, matrix(py, memory, n)?))
    }
}

/// A multilayer perceptron in single precision.
#[pyclass(module = "uvms_gym._core", extends = Controller, frozen)]
pub struct Mlp {
    mlp: Arc<control::Mlp>,
}

impl Mlp {
    fn of(mlp: control::Mlp) -> PyClassInitializer<Self> {
        let mlp = Arc::new(mlp);
        PyClassInitializer::from(Controller::new(mlp.clone())).add_subclass(Self { mlp })
    }

    /// The policy.
    pub(super) fn mlp(&self) -> &Arc<control::Mlp> {
        &self.mlp
    }
}

#[pymethods]
impl Mlp {
    /// Layers `W x + b` from weights (outputs, inputs) and biases; mean, variance, epsilon and clip of a normalisation;
    /// and the task of the policy, residual or not.
    #[new]
    #[pyo3(signature = (weights, biases, *, activation, output, history, normalisation, task, residual, notes))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one Python call")]
    fn new(
        weights: Vec<PyReadonlyArray2<'_, f32>>,
        biases: Vec<PyReadonlyArray1<'_, f32>>,
        activation: &str,
        output: &str,
        history: usize,
        normalisation: Option<(Vec<f32>, Vec<f32>, f32, f32)>,
        task: Option<PyRef<'_, Task>>,
        residual: bool,
        notes: BTreeMap<String, String>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let (activation, output) = (one_of("activation", activation, ACTIVATIONS)?, one_of("output", output, OUTPUTS)?);
        if weights.len() != biases.len() {
            let (weights, biases) = (weights.len(), biases.len());
            return Err(PyValueError::new_err(format!("weights of {weights} layers, but biases of {biases}")));
        }
        let mut layers = Vec::with_capacity(weights.len());
        for (i, (weights, biases)) in weights.iter().zip(&biases).enumerate() {
            let &[outputs, inputs] = weights.shape() else { unreachable!("the array has two dimensions") };
            let got = biases.len();
            if outputs != got {
                let message = format!("layer {i} has weights {:?}, but {got} biases", [outputs, inputs]);
                return Err(PyValueError::new_err(message));
            }
            layers.push(Layer {
                weights: weights.as_array().iter().copied().collect(),
                biases: biases.as_array().iter().copied().collect(),
            });
        }
        let normalisation =
            normalisation.map(|(mean, variance, epsilon, clip)| Normalisation { mean, variance, epsilon, clip });
        let spec = task.map(|task| policy_spec(&task, residual));
        let network = Network { history, normalisation, layers, activation, output };
        Ok(Self::of(control::Mlp::new(network, spec, notes).or_raise()?))
    }

    /// The policy of a safetensors file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Py<Self>> {
        Py::new(py, Self::of(control::Mlp::from_bytes(bytes).or_raise()?))
    }

    /// The policy as a safetensors file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.mlp.to_bytes().or_raise()?))
    }

    /// Refuses another task than the policy's, residual or not.
    #[pyo3(signature = (task, *, residual))]
    fn check(&self, task: PyRef<'_, Task>, residual: bool) -> PyResult<()> {
        self.mlp.check(&policy_spec(&task, residual)).or_raise()
    }

    /// This network's corrections to a controller, of at most `limit`.
    fn correcting(&self, base: PyRef<'_, Controller>, limit: f64) -> PyResult<Controller> {
        let inner = Arc::new(ResidualController::new(base.inner.clone(), self.mlp.clone(), limit).or_raise()?);
        Ok(Controller { inner, gains: base.gains.clone() })
    }

    /// True for a residual policy.
    #[getter]
    fn residual(&self) -> bool {
        self.mlp.spec().is_some_and(PolicySpec::is_residual)
    }

    /// Number of stacked observations.
    #[getter]
    fn history(&self) -> usize {
        self.mlp.network().history
    }

    /// Entries of the input, and of all layers' results.
    #[getter]
    fn sizes(&self) -> Vec<usize> {
        self.mlp.network().sizes()
    }

    /// Function between layers.
    #[getter]
    fn activation(&self) -> &'static str {
        name_of(self.mlp.network().activation, ACTIVATIONS)
    }

    /// Environment of the policy: task, scene, action, actions, control_period and observation.
    #[getter]
    fn spec<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(spec) = self.mlp.spec() else { return Ok(None) };
        let result = PyDict::new(py);
        result.set_item("task", &spec.task)?;
        result.set_item("scene", &spec.scene)?;
        result.set_item("end_effector", &spec.end_effector)?;
        result.set_item("action", spec.action.name())?;
        result.set_item("actions", spec.actions)?;
        result.set_item("control_period", spec.control_period)?;
        result.set_item("observation", &spec.observation)?;
        Ok(Some(result))
    }

    /// Notes: seeds, steps, scores.
    #[getter]
    fn notes(&self) -> BTreeMap<String, String> {
        self.mlp.notes().clone()
    }
}

fn policy_spec(task: &Task, residual: bool) -> PolicySpec {
    let spec = task.batch.task().policy_spec();
    if residual { spec.residual() } else { spec }
}

/// A gain from Python: an integer, a number, or a list of numbers or names.
#[derive(FromPyObject)]
enum Gain {
    Whole(u32),
    Number(f64),
    List(Vec<f64>),
    Names(Vec<String>),
}

/// Names of the gains of a classical controller.
#[pyfunction]
pub fn gain_names(kind: &str) -> PyResult<Vec<String>> {
    Ok(one_of("kind", kind, ControllerKind::ALL)?.gain_names())
}

#[pymethods]
impl Task {
    /// A classical controller by its kind and its gains; defaults where a gain is None or missing.
    fn controller(&self, kind: &str, gains: BTreeMap<String, Option<Gain>>) -> PyResult<Controller> {
        let kind = one_of("kind", kind, ControllerKind::ALL)?;
        let mut map = GainMap::new();
        for (name, gain) in gains {
            let value = match gain {
                None => None::<f64>.into(),
                Some(Gain::Whole(number)) => number.into(),
                Some(Gain::Number(number)) => gain_value(&name, &[number], false).or_raise()?,
                Some(Gain::Names(names)) => names.into(),
                Some(Gain::List(numbers)) => gain_value(&name, &numbers, true).or_raise()?,
            };
            map.insert(name, value);
        }
        let (inner, gains) = self.batch.task().controller(kind, &map).or_raise()?;
        Ok(Controller { inner, gains })
    }
}
