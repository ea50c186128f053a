//! `_core.Task`.

use numpy::ndarray::{Array1, Array2, Dimension};
use numpy::{IntoPyArray, PyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyString, PyTuple};

use super::arrays;
use super::disturbance::set_starts;
use super::errors::{IntoPyErr, OrRaise};
use super::outputs::{Past, Sheets};
use super::scene;
use super::simulator::Simulator;
use super::stability::warn;
use uvms_gym::batch::{Autoreset, Final, Outputs, Precision, Saved, SimulatorOptions, TaskBatch};
use uvms_gym::error::TaskError;
use uvms_gym::task::{INFO, METRICS, Metrics, StartOverride, TASKS, TaskOptions, privileged_layout};

const DTYPES: [(&str, Precision); 2] = [("float64", Precision::Double), ("float32", Precision::Single)];
const MODES: [(&str, Autoreset); 3] =
    [("next_step", Autoreset::NextStep), ("same_step", Autoreset::SameStep), ("disabled", Autoreset::Disabled)];

pub(super) type Rows<'py, T> = Bound<'py, PyArray2<T>>;
pub(super) type Row<'py, T> = Bound<'py, PyArray1<T>>;
/// Instances, their last observations, their last measures (k, k), what these did not tell (k, m).
type Finals<'py> = (Row<'py, i64>, Rows<'py, f32>, Rows<'py, f64>, Rows<'py, f64>);
/// Observations, rewards, terminated, truncated, measures (k, N), ends of episodes.
type StepResult<'py> =
    (Rows<'py, f32>, Row<'py, f64>, Row<'py, bool>, Row<'py, bool>, Rows<'py, f64>, Option<Finals<'py>>);

/// Observation, reward, terminated, truncated, measures.
type OneStep<'py> = (Row<'py, f32>, f64, bool, bool, Bound<'py, PyDict>);

/// A batch of episodes of a task: physics, observations, rewards and resets in one call.
///
/// The environments in `uvms_gym.envs` wrap it and document its arguments.
#[pyclass(module = "uvms_gym._core")]
pub struct Task {
    pub(super) batch: TaskBatch,
    past: Past,
    info: InfoForm,
}

/// Tasks: name and environment.
#[pyfunction]
pub fn tasks() -> Vec<(&'static str, &'static str)> {
    TASKS.to_vec()
}

/// Default options of the task of that name, as plain values.
#[pyfunction]
pub fn task_defaults<'py>(py: Python<'py>, task: &str) -> PyResult<Bound<'py, PyDict>> {
    let options = TaskOptions::of(task).or_raise()?;
    let values = scene::object(&options.to_value().or_raise()?, py)?;
    let values = values.cast_into::<PyDict>()?;
    for absent in ["disturbance", "randomize", "thruster_lag"] {
        values.set_item(absent, py.None())?;
    }
    Ok(values)
}

#[pymethods]
impl Task {
    /// Names of the measures, in the order of the rows of `info`.
    #[classattr]
    const INFO: [&'static str; METRICS] = Metrics::NAMES;

    #[new]
    #[pyo3(signature = (
        scene, options, *, num_envs=1, integrator="mk4", dtype="float64", threads=None, autoreset="disabled",
        max_episode_steps=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one Python call")]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, PyAny>,
        options: &Bound<'_, PyDict>,
        num_envs: usize,
        integrator: &str,
        dtype: &str,
        threads: Option<usize>,
        autoreset: &str,
        max_episode_steps: Option<u32>,
    ) -> PyResult<Self> {
        let (precision, autoreset) = (one_of("dtype", dtype, DTYPES)?, one_of("autoreset_mode", autoreset, MODES)?);
        let options = TaskOptions::from_value(scene::tree(options)?).or_raise()?;
        let simulator = SimulatorOptions {
            instances: num_envs,
            integrator: integrator.to_owned(),
            precision,
            threads,
            ..SimulatorOptions::default()
        };
        let batch = TaskBatch::new(scene::read(scene)?, options, simulator, autoreset, max_episode_steps).or_raise()?;
        let info = InfoForm::new(py, batch.task().metric_names())?;
        Ok(Self { batch, past: Past::default(), info })
    }

    /// Names of the metrics, in the order of the rows of `info`.
    #[getter]
    fn metric_names(&self) -> Vec<&'static str> {
        self.batch.task().metric_names().to_vec()
    }

    /// Number of instances N.
    #[getter]
    fn num_envs(&self) -> usize {
        self.batch.instances()
    }

    /// Control period, s.
    #[getter]
    fn control_period(&self) -> f64 {
        self.batch.task().options().control_period()
    }

    /// The complete scene, as `load_scene` gives it.
    #[getter]
    fn scene<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        scene::to_python(self.batch.simulator().scene(), py)
    }

    /// A copy of the physics as it stands: the true state, and a simulator to look ahead with.
    #[getter]
    fn simulator(&self) -> Simulator {
        Simulator { inner: self.batch.simulator().clone() }
    }

    /// Greatest magnitude of each entry of an observation, (d,).
    #[getter]
    fn observation_bound<'py>(&self, py: Python<'py>) -> Row<'py, f32> {
        PyArray1::from_slice(py, self.batch.task().layout().bound())
    }

    /// Blocks of an observation, each with name, offset, scale, bound, unit and description.
    #[getter]
    fn layout<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let blocks = PyList::empty(py);
        for block in self.batch.task().layout().blocks() {
            let entry = PyDict::new(py);
            entry.set_item("name", block.name)?;
            entry.set_item("offset", block.offset)?;
            entry.set_item("scale", block.scale.clone())?;
            entry.set_item("bound", block.bound.clone())?;
            entry.set_item("unit", block.unit)?;
            entry.set_item("description", block.description)?;
            blocks.append(entry)?;
        }
        Ok(blocks)
    }

    /// Entries of an action, each with name, what -1 and +1 ask for, and unit.
    #[getter]
    fn action_layout(&self) -> Vec<(String, [f64; 2], &'static str)> {
        self.batch.task().action_ranges().into_iter().map(|r| (r.name, r.limits, r.unit)).collect()
    }

    /// What observations do not tell: true state, flow, parameters and target, (N, m).
    fn privileged<'py>(&self, py: Python<'py>) -> PyResult<Rows<'py, f64>> {
        rows(py, self.batch.privileged(), self.batch.instances())
    }

    /// Names and lengths of the parts of a row of `privileged`.
    #[getter]
    fn privileged_layout(&self) -> Vec<(&'static str, usize)> {
        privileged_layout(self.batch.task().joint_count()).into()
    }

    /// Starts episodes: of all instances, or of those that `mask` picks. Keywords give what is not to be drawn, (N, .).
    /// Returns observations (N, d) and measures (k, N).
    #[pyo3(signature = (seeds, mask=None, **given))]
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        seeds: Vec<Option<u64>>,
        mask: Option<PyReadonlyArray1<'py, bool>>,
        given: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(Rows<'py, f32>, Rows<'py, f64>)> {
        let mask = mask.map(|mask| mask.as_array().to_vec());
        let starts = self.starts(given)?;
        let begun = self.batch.reset(&seeds, mask.as_deref(), &starts).map_err(refused)?;
        Ok((self.observations(py, begun.observations)?, rows(py, begun.info, self.info.len())?))
    }

    /// One control period of all instances under `actions` (N, a).
    fn step<'py>(&mut self, py: Python<'py>, actions: &Rows<'py, f32>) -> PyResult<StepResult<'py>> {
        let expected = [self.batch.instances(), self.batch.task().action_len()];
        if actions.shape() != expected {
            let message = format!("actions have shape {:?}, expected {expected:?}", actions.shape());
            return Err(PyValueError::new_err(message));
        }
        let actions = copied(actions)?;
        let (n, width) = (self.batch.instances(), self.batch.task().observation_len());
        let sheets = self.past.take(py, [n, width, self.info.len()])?;
        let finals = self.step_into(py, &actions, sheets.open()?.outputs()?)?;
        self.past.keep(&sheets);
        let finals = if finals.is_empty() {
            None
        } else {
            let instances: Array1<i64> = finals.iter().map(|end| end.instance as i64).collect();
            let last: Vec<f32> = finals.iter().flat_map(|end| end.observation.iter().copied()).collect();
            let info = Array2::from_shape_fn((self.info.len(), finals.len()), |(k, i)| finals[i].info[k]);
            let truth = rows(py, finals.iter().flat_map(|end| end.privileged.iter().copied()).collect(), finals.len())?;
            Some((instances.into_pyarray(py), self.observations(py, last)?, info.into_pyarray(py), truth))
        };
        let Sheets { observations, rewards, terminated, truncated, info } = sheets;
        Ok((observations, rewards, terminated, truncated, info, finals))
    }

    /// One control period of the one instance that there is, under `action` (a,), float32; TypeError if it is anything else.
    fn step_one<'py>(&mut self, py: Python<'py>, action: &Row<'py, f32>) -> PyResult<OneStep<'py>> {
        if action.len() != self.batch.task().action_len() {
            return Err(PyTypeError::new_err("an action of another length"));
        }
        let action = copied(action)?;
        // Likewise a copy: to lock an array, as whoever writes to one has to, would take longer.
        let mut observation = vec![0.0; self.batch.task().observation_len()];
        let (mut reward, mut flags, mut info) = ([0.0], [[false]; 2], [0.0; INFO]);
        let each = flags.each_mut().map(|flag| &mut flag[..]);
        self.step_into(py, &action, Outputs::new(&mut observation, &mut reward, each, &mut info[..self.info.len()]))?;
        let observation = PyArray1::from_slice(py, &observation);
        let [[terminated], [truncated]] = flags;
        Ok((observation, reward[0], terminated, truncated, self.info.fill(py, &info)?))
    }

    /// Everything that makes the batch go on as if it had not been interrupted: two arrays (N, .).
    fn __getstate__<'py>(&self, py: Python<'py>) -> PyResult<(Rows<'py, f64>, Rows<'py, f64>)> {
        let Saved { physics, episodes } = self.batch.save();
        let n = self.batch.instances();
        Ok((rows(py, physics, n)?, rows(py, episodes, n)?))
    }

    /// Continues from what `__getstate__` of a batch with the same arguments gave.
    fn __setstate__(&mut self, state: (Bound<'_, PyAny>, Bound<'_, PyAny>)) -> PyResult<()> {
        let (physics, episodes) = (arrays::read("physics", &state.0)?.1, arrays::read("episodes", &state.1)?.1);
        self.batch.load(&Saved { physics, episodes }).or_raise()
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let (batch, simulator) = (&self.batch, self.batch.simulator().options());
        let options = PyDict::new(py);
        options.set_item("num_envs", batch.instances())?;
        options.set_item("integrator", &simulator.integrator)?;
        options.set_item("dtype", name_of(simulator.precision, DTYPES))?;
        options.set_item("threads", simulator.threads)?;
        options.set_item("autoreset", name_of(batch.autoreset(), MODES))?;
        options.set_item("max_episode_steps", batch.max_steps())?;
        let task = scene::object(&batch.task().options().to_value().or_raise()?, py)?;
        Ok(((self.scene(py)?, task).into_pyobject(py)?, options))
    }

    /// What the episodes drew, and how far they are: seed, episode and step (N,), target_position (N, 3),
    /// target_rotation (N, 3, 3), current (N, 3), action (N, a), joint_reference and joint_reference_rate (N, n).
    fn episodes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let n = self.batch.instances();
        let all = (0..n).map(|i| self.batch.episode(i).ok_or(TaskError::NotBegun { instance: i }));
        let all: Vec<_> = all.collect::<Result<_, _>>().map_err(refused)?;
        let gather = |of: &dyn Fn(&uvms_gym::task::Episode) -> Vec<f64>| rows(py, all.iter().flat_map(of).collect(), n);
        let result = PyDict::new(py);
        result.set_item("seed", PyArray1::from_iter(py, all.iter().map(|e| e.key().seed)))?;
        result.set_item("episode", PyArray1::from_iter(py, all.iter().map(|e| e.key().episode)))?;
        result.set_item("step", PyArray1::from_iter(py, all.iter().map(|e| e.step())))?;
        result.set_item("target_position", gather(&|e| e.target().position.iter().copied().collect())?)?;
        let rotation = gather(&|e| e.target().rotation.transpose().iter().copied().collect())?;
        result.set_item("target_rotation", rotation.call_method1("reshape", (n, 3, 3))?)?;
        result.set_item("current", gather(&|e| e.current().iter().copied().collect())?)?;
        result.set_item("action", gather(&|e| e.action().to_vec())?)?;
        result.set_item("joint_reference", gather(&|e| e.reference().iter().map(|r| r.value).collect())?)?;
        let rates = gather(&|e| e.reference().iter().map(|r| r.rate).collect())?;
        result.set_item("joint_reference_rate", rates)?;
        Ok(result)
    }

    /// Places all along the paths of the end effectors, (N, count, 3); count is 0 for tasks without.
    fn paths<'py>(&self, py: Python<'py>, count: usize) -> PyResult<arrays::Array<'py>> {
        let n = self.batch.instances();
        let places = (0..n).filter_map(|i| self.batch.episode(i)).flat_map(|e| e.path(count).into_flattened());
        let places: Vec<f64> = places.collect();
        arrays::array(py, &[n, places.len() / (3 * n), 3], places)
    }
}

impl Task {
    /// A step, without the GIL, and the warnings that go with it.
    fn step_into(&mut self, py: Python<'_>, actions: &[f32], out: Outputs<'_>) -> PyResult<Vec<Final>> {
        let batch = &mut self.batch;
        if let Some(unstable) = batch.warn_of_step() {
            warn(py, &unstable.to_string())?;
        }
        let finals = py.detach(|| batch.step_into(actions, out)).map_err(refused)?;
        if let Some(stray) = batch.warn_of_motion() {
            warn(py, &stray.to_string())?;
        }
        Ok(finals)
    }

    fn observations<'py>(&self, py: Python<'py>, flat: Vec<f32>) -> PyResult<Rows<'py, f32>> {
        let width = self.batch.task().observation_len();
        let count = flat.len() / width;
        rows(py, flat, count)
    }

    /// One start per instance, from arrays by name.
    fn starts(&self, given: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<StartOverride>> {
        let Some(given) = given.filter(|given| !given.is_empty()) else { return Ok(Vec::new()) };
        let n = self.batch.instances();
        let joints = self.batch.task().joint_count();
        let mut starts = vec![StartOverride::default(); n];
        for (name, values) in given.iter() {
            let name: String = name.extract()?;
            if name == "disturbance" {
                set_starts(&mut starts, &values)?;
                continue;
            }
            let Some(width) = start_width(&name, joints) else {
                return Err(PyValueError::new_err(format!("there is no start of the name '{name}'")));
            };
            let values = arrays::rows(&name, &values, n, &[width])?;
            for (i, start) in starts.iter_mut().enumerate() {
                let row = &values[i * width..(i + 1) * width];
                match name.as_str() {
                    "position" => start.position = row.try_into().ok(),
                    "attitude" => start.attitude = row.try_into().ok(),
                    "twist" => start.twist = row.try_into().ok(),
                    "q" => start.q = Some(row.to_vec()),
                    "qd" => start.qd = Some(row.to_vec()),
                    "target_position" => start.target_position = row.try_into().ok(),
                    "target_attitude" => start.target_attitude = row.try_into().ok(),
                    _ => start.current = row.try_into().ok(),
                }
            }
        }
        Ok(starts)
    }
}

/// An error of a call; those about the order of calls are Gymnasium's own.
pub(super) fn refused(error: TaskError) -> PyErr {
    if !matches!(error, TaskError::NotBegun { .. } | TaskError::Over { .. }) {
        return error.into_py_err();
    }
    Python::attach(|py| {
        let class = py.import("gymnasium.error").and_then(|module| module.getattr("ResetNeeded"));
        match class.and_then(|class| class.call1((error.to_string(),))) {
            Ok(raised) => PyErr::from_value(raised),
            Err(error) => error,
        }
    })
}

/// The value of that name.
pub(super) fn one_of<T, const K: usize>(what: &str, name: &str, choices: [(&str, T); K]) -> PyResult<T> {
    let known = choices.each_ref().map(|(name, _)| format!("'{name}'")).join(", ");
    let found = choices.into_iter().find(|(choice, _)| *choice == name);
    found
        .map(|(_, value)| value)
        .ok_or_else(|| PyValueError::new_err(format!("{what} is '{name}', but must be one of {known}")))
}

/// The name of that value.
pub(super) fn name_of<T: PartialEq, const K: usize>(value: T, choices: [(&'static str, T); K]) -> Option<&'static str> {
    choices.into_iter().find(|(_, choice)| *choice == value).map(|(name, _)| name)
}

/// Numbers that a given part of a start has.
fn start_width(name: &str, joints: usize) -> Option<usize> {
    match name {
        "position" | "target_position" | "current" => Some(3),
        "attitude" | "target_attitude" => Some(4),
        "twist" => Some(6),
        "q" | "qd" => Some(joints),
        _ => None,
    }
}

/// Its entries, by rows wherever they lie. A copy: the caller's array may change while other Python threads run.
fn copied<D: Dimension>(array: &Bound<'_, PyArray<f32, D>>) -> PyResult<Vec<f32>> {
    if array.is_c_contiguous() && array.data().is_aligned() {
        return Ok(array.to_vec()?);
    }
    let by_rows = array.call_method1(intern!(array.py(), "copy"), ("C",))?;
    Ok(by_rows.cast::<PyArray<f32, D>>()?.to_vec()?)
}

/// A fresh (count, .) array.
pub(super) fn rows<'py, T: numpy::Element>(py: Python<'py>, flat: Vec<T>, count: usize) -> PyResult<Rows<'py, T>> {
    let width = flat.len() / count.max(1);
    match Array2::from_shape_vec((count, width), flat) {
        Ok(array) => Ok(array.into_pyarray(py)),
        Err(error) => Err(PyValueError::new_err(error.to_string())),
    }
}

/// Form of the `info` of one instance: its names and a dict that has them all.
struct InfoForm {
    names: Vec<Py<PyString>>,
    blank: Py<PyDict>,
}

impl InfoForm {
    fn new(py: Python<'_>, names: &[&str]) -> PyResult<Self> {
        let names: Vec<_> = names.iter().map(|name| PyString::intern(py, name).unbind()).collect();
        let blank = PyDict::new(py);
        names.iter().try_for_each(|name| blank.set_item(name, 0.0))?;
        Ok(Self { names, blank: blank.unbind() })
    }

    fn len(&self) -> usize {
        self.names.len()
    }

    /// A dict of these values. The copy of a dict that has all names already does not grow.
    fn fill<'py>(&self, py: Python<'py>, values: &[f64]) -> PyResult<Bound<'py, PyDict>> {
        let info = self.blank.bind(py).copy()?;
        for (name, value) in self.names.iter().zip(values) {
            info.set_item(name, value)?;
        }
        Ok(info)
    }
}
