//! `_core.Controller` and its kinds.

use std::collections::BTreeMap;
use std::sync::Arc;

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use super::errors::OrRaise;
use super::task::{Rows, Task, name_of, one_of, rows};
use uvms_gym::control::{
    self, Activation, Law, Layer, ModelGains, MpcGains, Network, Normalisation, Observing, Output, PolicySpec,
    Residual, ResolvedGains,
};
use uvms_gym::description::VehicleServo;

const ACTIVATIONS: [(&str, Activation); 3] =
    [("tanh", Activation::Tanh), ("relu", Activation::Relu), ("elu", Activation::Elu)];
const LAWS: [(&str, Law); 2] = [("disturbance", Law::Disturbance), ("computed-torque", Law::ComputedTorque)];
const OUTPUTS: [(&str, Output); 2] = [("clip", Output::Clip), ("tanh", Output::Tanh)];

/// A controller that runs here: alone by `act`, or in a closed loop by `Task.run`.
#[pyclass(module = "uvms_gym._core", subclass, frozen)]
pub struct Controller {
    pub(super) inner: Arc<dyn control::Controller>,
}

impl Controller {
    fn of(policy: impl control::Controller + 'static) -> PyClassInitializer<Self> {
        PyClassInitializer::from(Self { inner: Arc::new(policy) })
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

    /// Actions (n, a) for observations (n, d) and memory (n, m), and the memory after them.
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
        // Copies: the caller's arrays may change while other Python threads run.
        let observations: Vec<f32> = observations.as_array().iter().copied().collect();
        let mut memory: Vec<f64> = memory.as_array().iter().copied().collect();
        let mut actions = vec![0.0; n * a];
        py.detach(|| self.inner.act(&observations, &mut memory, &mut actions)).or_raise()?;
        Ok((rows(py, actions, n)?, rows(py, memory, n)?))
    }
}

/// PD on the vehicle, `F = -kp e - kd V`.
#[pyclass(module = "uvms_gym._core", extends = Controller, frozen)]
pub struct Pd {
    gains: VehicleServo,
}

#[pymethods]
impl Pd {
    /// Proportional gains, N/m and N m/rad.
    #[getter]
    fn kp(&self) -> [f64; 6] {
        self.gains.kp
    }

    /// Derivative gains, N s/m and N m s/rad.
    #[getter]
    fn kd(&self) -> [f64; 6] {
        self.gains.kd
    }
}

/// PD with an integral of the pose error.
#[pyclass(module = "uvms_gym._core", extends = Controller, frozen)]
pub struct Pid {
    gains: VehicleServo,
    ki: [f64; 6],
}

#[pymethods]
impl Pid {
    /// Proportional gains, N/m and N m/rad.
    #[getter]
    fn kp(&self) -> [f64; 6] {
        self.gains.kp
    }

    /// Derivative gains, N s/m and N m s/rad.
    #[getter]
    fn kd(&self) -> [f64; 6] {
        self.gains.kd
    }

    /// Integral gains, N/(m s) and N m/(rad s).
    #[getter]
    fn ki(&self) -> [f64; 6] {
        self.ki
    }
}

/// Feedback on what an observer tells that knows the nominal model.
#[pyclass(module = "uvms_gym._core", extends = Controller, frozen)]
pub struct ModelControl {
    gains: ModelGains,
}

#[pymethods]
impl ModelControl {
    /// Proportional gains: N/m and N m/rad, or 1/s2 for computed torque.
    #[getter]
    fn kp(&self) -> [f64; 6] {
        self.gains.kp
    }

    /// Derivative gains: N s/m and N m s/rad, or 1/s.
    #[getter]
    fn kd(&self) -> [f64; 6] {
        self.gains.kd
    }

    /// Bandwidth of the observer, linear and angular, rad/s.
    #[getter]
    fn observer(&self) -> [f64; 2] {
        self.gains.observing.observer
    }

    /// Deviation of accelerations that come and go, linear and angular, m/s2 and rad/s2.
    #[getter]
    fn waves(&self) -> [f64; 2] {
        self.gains.observing.waves
    }

    /// Their angular frequency, rad/s.
    #[getter]
    fn frequency(&self) -> f64 {
        self.gains.observing.frequency
    }

    /// White noise on accelerations, linear and angular, m/s2 and rad/s2 times the root of a second.
    #[getter]
    fn jolts(&self) -> [f64; 2] {
        self.gains.observing.jolts
    }

    /// Age of measurements that is compensated, in control periods.
    #[getter]
    fn delay(&self) -> usize {
        self.gains.observing.delay
    }

    /// Time beyond the present that is predicted, s.
    #[getter]
    fn lead(&self) -> f64 {
        self.gains.lead
    }
}

/// Linear model-predictive control.
#[pyclass(module = "uvms_gym._core", extends = Controller, frozen)]
pub struct Mpc {
    gains: MpcGains,
}

#[pymethods]
impl Mpc {
    /// Weights on velocities, linear and angular.
    #[getter]
    fn velocity(&self) -> [f64; 2] {
        self.gains.velocity
    }

    /// Weights on wrenches, forces and moments.
    #[getter]
    fn effort(&self) -> [f64; 2] {
        self.gains.effort
    }

    /// Weights on their changes.
    #[getter]
    fn change(&self) -> [f64; 2] {
        self.gains.change
    }

    /// Bandwidth of the observer, linear and angular, rad/s.
    #[getter]
    fn observer(&self) -> [f64; 2] {
        self.gains.observing.observer
    }

    /// Deviation of accelerations that come and go, linear and angular, m/s2 and rad/s2.
    #[getter]
    fn waves(&self) -> [f64; 2] {
        self.gains.observing.waves
    }

    /// Their angular frequency, rad/s.
    #[getter]
    fn frequency(&self) -> f64 {
        self.gains.observing.frequency
    }

    /// White noise on accelerations, linear and angular, m/s2 and rad/s2 times the root of a second.
    #[getter]
    fn jolts(&self) -> [f64; 2] {
        self.gains.observing.jolts
    }

    /// Age of measurements that is compensated, in control periods.
    #[getter]
    fn delay(&self) -> usize {
        self.gains.observing.delay
    }
}

/// Resolved motion and inverse dynamics, for an end effector that follows a path.
#[pyclass(module = "uvms_gym._core", extends = Controller, frozen)]
pub struct ResolvedMotion {
    gains: ResolvedGains,
}

#[pymethods]
impl ResolvedMotion {
    /// Gains by name, as `Task.resolved_motion` takes them.
    #[getter]
    fn gains<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (gains, result) = (&self.gains, PyDict::new(py));
        for (name, value) in [
            ("error", gains.error),
            ("vehicle", gains.vehicle),
            ("joint", gains.joint),
            ("home", gains.home),
            ("level", gains.level),
            ("arm", gains.arm),
            ("lead", gains.lead),
            ("integral", gains.integral),
        ] {
            result.set_item(name, value)?;
        }
        result.set_item("observer", gains.observer)?;
        result.set_item("delay", gains.delay)?;
        Ok(result)
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
        PyClassInitializer::from(Controller { inner: mlp.clone() }).add_subclass(Self { mlp })
    }
}

#[pymethods]
impl Mlp {
    /// Layers `W x + b` from weights (outputs, inputs) and biases; mean, variance, epsilon and clip of a normalisation;
    /// and the task that the policy is for, alone or to correct a controller.
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
        let spec = task.map(|task| spec(&task, residual));
        let network = Network { history, normalisation, layers, activation, output };
        Ok(Self::of(control::Mlp::new(network, spec, notes).or_raise()?))
    }

    /// The policy that a safetensors file holds.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Py<Self>> {
        Py::new(py, Self::of(control::Mlp::from_bytes(bytes).or_raise()?))
    }

    /// The policy as a safetensors file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.mlp.to_bytes().or_raise()?))
    }

    /// Refuses a task that the policy is not for, alone or to correct a controller.
    #[pyo3(signature = (task, *, residual))]
    fn check(&self, task: PyRef<'_, Task>, residual: bool) -> PyResult<()> {
        self.mlp.check(&spec(&task, residual)).or_raise()
    }

    /// This network's corrections to a controller, of at most `limit`.
    fn correcting(&self, base: PyRef<'_, Controller>, limit: f64) -> PyResult<Controller> {
        let inner = Arc::new(Residual::new(base.inner.clone(), self.mlp.clone(), limit).or_raise()?);
        Ok(Controller { inner })
    }

    /// Whether it says that it residual a controller.
    #[getter]
    fn residual(&self) -> bool {
        self.mlp.spec().is_some_and(PolicySpec::is_residual)
    }

    /// Observations that it reads at once.
    #[getter]
    fn history(&self) -> usize {
        self.mlp.network().history
    }

    /// Entries of what it reads, and of all layers' results.
    #[getter]
    fn sizes(&self) -> Vec<usize> {
        self.mlp.network().sizes()
    }

    /// Function between layers.
    #[getter]
    fn activation(&self) -> Option<&'static str> {
        name_of(self.mlp.network().activation, ACTIVATIONS)
    }

    /// What the policy is for: task, scene, action, actions, control_period and observation.
    #[getter]
    fn spec<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(spec) = self.mlp.spec() else { return Ok(None) };
        let result = PyDict::new(py);
        result.set_item("task", &spec.task)?;
        result.set_item("scene", &spec.scene)?;
        result.set_item("action", spec.action.name())?;
        result.set_item("actions", spec.actions)?;
        result.set_item("control_period", spec.control_period)?;
        result.set_item("observation", &spec.observation)?;
        Ok(Some(result))
    }

    /// What else is to be known of it.
    #[getter]
    fn notes(&self) -> BTreeMap<String, String> {
        self.mlp.notes().clone()
    }
}

fn spec(task: &Task, residual: bool) -> PolicySpec {
    let spec = task.batch.task().policy_spec();
    if residual { spec.residual() } else { spec }
}

/// What policies need to know of the task.
#[pymethods]
impl Task {
    /// No control: every action is 0.
    fn no_control(&self, py: Python<'_>) -> PyResult<Py<Controller>> {
        Py::new(py, Controller::of(self.batch.task().no_control()))
    }

    /// The paper's PD with these gains (6 each), or with the scene's.
    #[pyo3(signature = (kp=None, kd=None))]
    fn pd(&self, py: Python<'_>, kp: Option<[f64; 6]>, kd: Option<[f64; 6]>) -> PyResult<Py<Pd>> {
        let pd = self.batch.task().pd(Some(self.gains(kp, kd)?)).or_raise()?;
        let gains = pd.gains().clone();
        Py::new(py, Controller::of(pd).add_subclass(Pd { gains }))
    }

    /// The PD with restoring compensation.
    #[pyo3(signature = (kp=None, kd=None))]
    fn pd_restoring(&self, py: Python<'_>, kp: Option<[f64; 6]>, kd: Option<[f64; 6]>) -> PyResult<Py<Pd>> {
        let policy = self.batch.task().pd_restoring(Some(self.gains(kp, kd)?)).or_raise()?;
        let gains = policy.pd().gains().clone();
        Py::new(py, Controller::of(policy).add_subclass(Pd { gains }))
    }

    /// Feedback on an observer's estimate; the usual gains where they are not given, and the task's own delay.
    #[pyo3(signature = (law, *, kp=None, kd=None, observer=None, waves=None, frequency=None, jolts=None, delay=None, lead=None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one Python call")]
    fn model_control(
        &self,
        py: Python<'_>,
        law: &str,
        kp: Option<[f64; 6]>,
        kd: Option<[f64; 6]>,
        observer: Option<[f64; 2]>,
        waves: Option<[f64; 2]>,
        frequency: Option<f64>,
        jolts: Option<[f64; 2]>,
        delay: Option<usize>,
        lead: Option<f64>,
    ) -> PyResult<Py<ModelControl>> {
        let task = self.batch.task();
        let law = one_of("law", law, LAWS)?;
        let usual = task.model_gains(law, kp, kd).or_raise()?;
        let observing = Observing {
            observer: observer.unwrap_or(usual.observing.observer),
            waves: waves.unwrap_or(usual.observing.waves),
            frequency: frequency.unwrap_or(usual.observing.frequency),
            jolts: jolts.unwrap_or(usual.observing.jolts),
            delay: delay.unwrap_or(usual.observing.delay),
        };
        let gains = ModelGains { observing, lead: lead.unwrap_or(usual.lead), ..usual };
        let policy = task.model_control(law, gains).or_raise()?;
        Py::new(py, Controller::of(policy).add_subclass(ModelControl { gains }))
    }

    /// Model-predictive control; the usual weights where they are not given, and the task's own delay.
    #[pyo3(signature = (*, velocity=None, effort=None, change=None, observer=None, waves=None, frequency=None, jolts=None, delay=None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one Python call")]
    fn mpc(
        &self,
        py: Python<'_>,
        velocity: Option<[f64; 2]>,
        effort: Option<[f64; 2]>,
        change: Option<[f64; 2]>,
        observer: Option<[f64; 2]>,
        waves: Option<[f64; 2]>,
        frequency: Option<f64>,
        jolts: Option<[f64; 2]>,
        delay: Option<usize>,
    ) -> PyResult<Py<Mpc>> {
        let task = self.batch.task();
        let usual = MpcGains::usual(task.observing(true));
        let observing = Observing {
            observer: observer.unwrap_or(usual.observing.observer),
            waves: waves.unwrap_or(usual.observing.waves),
            frequency: frequency.unwrap_or(usual.observing.frequency),
            jolts: jolts.unwrap_or(usual.observing.jolts),
            delay: delay.unwrap_or(usual.observing.delay),
        };
        let gains = MpcGains {
            velocity: velocity.unwrap_or(usual.velocity),
            effort: effort.unwrap_or(usual.effort),
            change: change.unwrap_or(usual.change),
            observing,
        };
        Py::new(py, Controller::of(task.mpc(gains).or_raise()?).add_subclass(Mpc { gains }))
    }

    /// Resolved motion with these gains; the usual ones where they are not given.
    #[pyo3(signature = (*, error=None, vehicle=None, joint=None, home=None, level=None, arm=None, lead=None,
                        integral=None, observer=None, delay=None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one Python call")]
    fn resolved_motion(
        &self,
        py: Python<'_>,
        error: Option<f64>,
        vehicle: Option<f64>,
        joint: Option<f64>,
        home: Option<f64>,
        level: Option<f64>,
        arm: Option<f64>,
        lead: Option<f64>,
        integral: Option<f64>,
        observer: Option<[f64; 3]>,
        delay: Option<u32>,
    ) -> PyResult<Py<ResolvedMotion>> {
        let usual = ResolvedGains::default();
        let gains = ResolvedGains {
            error: error.unwrap_or(usual.error),
            vehicle: vehicle.unwrap_or(usual.vehicle),
            joint: joint.unwrap_or(usual.joint),
            home: home.unwrap_or(usual.home),
            level: level.unwrap_or(usual.level),
            arm: arm.unwrap_or(usual.arm),
            lead: lead.unwrap_or(usual.lead),
            integral: integral.unwrap_or(usual.integral),
            observer: observer.unwrap_or(usual.observer),
            delay: delay.unwrap_or(usual.delay),
        };
        let policy = self.batch.task().resolved_motion(Some(gains)).or_raise()?;
        Py::new(py, Controller::of(policy).add_subclass(ResolvedMotion { gains }))
    }

    /// The PD with an integral; its gains follow from the others where they are not given.
    #[pyo3(signature = (kp=None, kd=None, ki=None))]
    fn pid(
        &self,
        py: Python<'_>,
        kp: Option<[f64; 6]>,
        kd: Option<[f64; 6]>,
        ki: Option<[f64; 6]>,
    ) -> PyResult<Py<Pid>> {
        let pid = self.batch.task().pid(Some(self.gains(kp, kd)?), ki).or_raise()?;
        let (gains, ki) = (pid.pd().gains().clone(), *pid.ki());
        Py::new(py, Controller::of(pid).add_subclass(Pid { gains, ki }))
    }
}

impl Task {
    /// Gains as given, where they are; else the scene's.
    fn gains(&self, kp: Option<[f64; 6]>, kd: Option<[f64; 6]>) -> PyResult<VehicleServo> {
        if let (Some(kp), Some(kd)) = (kp, kd) {
            return Ok(VehicleServo { kp, kd });
        }
        let own = self.batch.task().pd(None).or_raise()?.gains().clone();
        Ok(VehicleServo { kp: kp.unwrap_or(own.kp), kd: kd.unwrap_or(own.kd) })
    }
}
