//! `_core.Task`.

use numpy::ndarray::{Array1, Array2};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString, PyTuple};

use super::arrays::{self, Row, Rows, copied, dict, matrix, name_of, one_of};
use super::computation::{detached, exclusive, interruptible};
use super::errors::OrRaise;
use super::outputs::StepArrays;
use super::simulator::{DTYPES, Simulator};
use super::stability::warn;
use super::state::error_estimate;
use super::{scene, starts};
use uvms_gym::batch::{Autoreset, Outputs, Saved, SimulatorOptions, TaskBatch};
use uvms_gym::error::TaskError;
use uvms_gym::limits::memory;
use uvms_gym::task::{Episode, Frame, INFO, METRICS, Metrics, TASKS, TaskOptions};

/// Steps of instances that are too short to interrupt: some ten milliseconds.
const SHORT: f64 = 65536.0;

const MODES: [(&str, Autoreset); 3] =
    [("next_step", Autoreset::NextStep), ("same_step", Autoreset::SameStep), ("disabled", Autoreset::Disabled)];

/// Ends of e episodes: instances (e,), last observations (e, d), last metrics (k, e), last privileged information (e, m).
type Finals<'py> = (Row<'py, i64>, Rows<'py, f32>, Rows<'py, f64>, Rows<'py, f64>);
/// Observation, reward, terminated, truncated, metrics.
type OneStep<'py> = (Row<'py, f32>, f64, bool, bool, Bound<'py, PyDict>);

/// Batch of episodes of a task: physics, observations, rewards and resets in one call.
///
/// The environments in `uvms_gym.envs` wrap it and document its arguments.
#[pyclass(module = "uvms_gym._core")]
pub struct Task {
    pub(super) batch: TaskBatch,
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
    for absent in ["disturbance", "randomize", "thruster_lag", "end_effector"] {
        values.set_item(absent, py.None())?;
    }
    Ok(values)
}

#[pymethods]
impl Task {
    /// Names of the metrics, in the order of the rows of `info`.
    #[classattr]
    const INFO: [&'static str; METRICS] = Metrics::NAMES;

    #[new]
    #[pyo3(signature = (
        scene, options, *, num_envs=1, integrator=None, dtype="float64", threads=None, autoreset="disabled",
        max_episode_steps=None, error_estimate=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one Python call")]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, PyAny>,
        options: &Bound<'_, PyDict>,
        num_envs: usize,
        integrator: Option<String>,
        dtype: &str,
        threads: Option<usize>,
        autoreset: &str,
        max_episode_steps: Option<u32>,
        error_estimate: Option<bool>,
    ) -> PyResult<Self> {
        let (precision, autoreset) = (one_of("dtype", dtype, DTYPES)?, one_of("autoreset_mode", autoreset, MODES)?);
        let scene = scene::read(scene)?;
        let options = TaskOptions::from_value(scene::tree(options)?, &scene.integration()).or_raise()?;
        let default = SimulatorOptions::of(&scene);
        let simulator = SimulatorOptions {
            instances: num_envs,
            integrator: integrator.unwrap_or(default.integrator),
            precision,
            threads,
            error_estimate,
            ..default
        };
        let batch = TaskBatch::new(scene, options, simulator, autoreset, max_episode_steps).or_raise()?;
        let info = InfoForm::new(py, batch.task().metric_names())?;
        Ok(Self { batch, info })
    }

    /// Frame whose pose error counts: "vehicle" or "end-effector".
    #[getter]
    fn target_frame(&self) -> &'static str {
        match self.batch.task().options().task.frame() {
            Frame::Vehicle => "vehicle",
            Frame::EndEffector => "end-effector",
        }
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

    /// Minimum and maximum age of the measurements, control periods.
    #[getter]
    fn delays(&self) -> (usize, usize) {
        let [minimum, maximum] = self.batch.task().delays();
        (minimum, maximum)
    }

    /// True where measurements may be older than the present: late, or held in a gap. Their age is the last row of a memory.
    #[getter]
    fn late(&self) -> bool {
        self.batch.task().episode_rows().disturbance.is_some_and(|rows| rows.age.is_some())
    }

    /// The complete scene, as `load_scene` gives it.
    #[getter]
    fn scene<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        scene::to_python(self.batch.simulator().scene(), py)
    }

    /// Simulator with a copy of the current state.
    fn snapshot(&self) -> PyResult<Simulator> {
        Simulator::copy_of(self.batch.simulator())
    }

    /// Maximum magnitude of each entry of an observation, (d,).
    #[getter]
    fn observation_bound<'py>(&self, py: Python<'py>) -> Row<'py, f32> {
        PyArray1::from_slice(py, self.batch.task().layout().bound())
    }

    /// Privileged information: true state, flow, parameters and target, (N, m).
    fn privileged<'py>(&self, py: Python<'py>) -> PyResult<Rows<'py, f64>> {
        matrix(py, self.batch.privileged(), self.batch.instances())
    }

    /// Observations of the true, present state, (N, d): sensors without noise and delay.
    fn perfect_observations<'py>(&mut self, py: Python<'py>) -> PyResult<Rows<'py, f32>> {
        let batch = &mut self.batch;
        let observations = detached(py, || batch.perfect_observations())?.or_raise()?;
        self.observations(py, observations)
    }

    /// Estimated errors of integration since the start of the episodes: see `Simulator.error_estimate`.
    fn error_estimate<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        error_estimate(self.batch.simulator(), py)
    }

    /// Starts episodes of all instances, or of those in `mask`. Keywords give parts of the start, (N, .), that are drawn
    /// otherwise. Returns observations (N, d) and metrics (k, N).
    #[pyo3(signature = (seeds, mask=None, **given))]
    fn reset<'py>(
        slf: &Bound<'py, Self>,
        seeds: Vec<Option<u64>>,
        mask: Option<PyReadonlyArray1<'py, bool>>,
        given: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(Rows<'py, f32>, Rows<'py, f64>)> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        let mask = mask.map(|mask| mask.as_array().to_vec());
        let starts = starts::read(given, this.batch.instances(), this.batch.task().joint_count())?;
        let begun = this.batch.reset(&seeds, mask.as_deref(), &starts).or_raise()?;
        Ok((this.observations(py, begun.observations)?, matrix(py, begun.info, this.info.len())?))
    }

    /// One control period of all instances under `actions` (N, a), written to `out`: observations (N, d), rewards,
    /// terminated and truncated (N,), metrics (k, N). Returns the ends of episodes that were replaced.
    fn step<'py>(
        slf: &Bound<'py, Self>,
        actions: &Rows<'py, f32>,
        out: StepArrays<'py>,
    ) -> PyResult<Option<Finals<'py>>> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        let expected = [this.batch.instances(), this.batch.task().action_len()];
        if actions.shape() != expected {
            let message = format!("actions have shape {:?}, expected {expected:?}", actions.shape());
            return Err(PyValueError::new_err(message));
        }
        let actions = copied(actions)?;
        let mut guards = out.lock()?;
        let outputs = guards.outputs()?;
        let finals = this.advance(py, 1.0, |batch| batch.step_into(&actions, outputs))?;
        if finals.is_empty() {
            return Ok(None);
        }
        let instances: Array1<i64> = finals.iter().map(|end| end.instance as i64).collect();
        let last: Vec<f32> = finals.iter().flat_map(|end| end.observation.iter().copied()).collect();
        let info = Array2::from_shape_fn((this.info.len(), finals.len()), |(k, i)| finals[i].info[k]);
        let truth = matrix(py, finals.iter().flat_map(|end| end.privileged.iter().copied()).collect(), finals.len())?;
        Ok(Some((instances.into_pyarray(py), this.observations(py, last)?, info.into_pyarray(py), truth)))
    }

    /// One control period of a single instance under `action` (a,), float32; TypeError for anything else.
    fn step_one<'py>(slf: &Bound<'py, Self>, action: &Row<'py, f32>) -> PyResult<OneStep<'py>> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        // Subclasses may have masks.
        if action.len() != this.batch.task().action_len() || !action.get_type().is(py.get_type::<PyUntypedArray>()) {
            return Err(PyTypeError::new_err("an action of another length or kind"));
        }
        let action = copied(action)?;
        // Copied afterwards: locking an array for writing takes longer.
        let mut observation = vec![0.0; this.batch.task().observation_len()];
        let (mut reward, mut flags, mut info) = ([0.0], [[false]; 2], [0.0; INFO]);
        let each = flags.each_mut().map(|flag| &mut flag[..]);
        let outputs = Outputs::new(&mut observation, &mut reward, each, &mut info[..this.info.len()]);
        this.advance(py, 1.0, |batch| batch.step_into(&action, outputs))?;
        let observation = PyArray1::from_slice(py, &observation);
        let [[terminated], [truncated]] = flags;
        Ok((observation, reward[0], terminated, truncated, this.info.fill(py, &info)?))
    }

    /// Complete state of the batch: two arrays (N, .).
    fn __getstate__<'py>(&self, py: Python<'py>) -> PyResult<(Rows<'py, f64>, Rows<'py, f64>)> {
        let simulator = self.batch.simulator();
        // Physics, and about as many numbers of the episodes.
        memory::check("the state", &[2, simulator.instances(), simulator.save_len(), size_of::<f64>()]).or_raise()?;
        let Saved { physics, episodes } = self.batch.save();
        let n = self.batch.instances();
        Ok((matrix(py, physics, n)?, matrix(py, episodes, n)?))
    }

    /// Continues from the state of a batch with the same arguments.
    fn __setstate__(&mut self, state: (Bound<'_, PyAny>, Bound<'_, PyAny>)) -> PyResult<()> {
        let rows = |name: &str, given| {
            let (shape, numbers) = arrays::read(name, given)?;
            match shape[..] {
                [rows, _] if rows == self.batch.instances() => Ok(numbers),
                _ => Err(arrays::wrong_shape(name, &shape, &format!("({}, n)", self.batch.instances()))),
            }
        };
        let saved = Saved { physics: rows("physics", &state.0)?, episodes: rows("episodes", &state.1)? };
        self.batch.load(&saved).or_raise()
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let (batch, simulator) = (&self.batch, self.batch.simulator().options());
        let options = dict! { py;
            "num_envs": batch.instances(),
            "integrator": &simulator.integrator,
            "dtype": name_of(simulator.precision, DTYPES),
            "threads": simulator.threads,
            "autoreset": name_of(batch.autoreset(), MODES),
            "max_episode_steps": batch.max_steps(),
            "error_estimate": simulator.error_estimate,
        };
        let task = scene::object(&batch.task().options().to_value().or_raise()?, py)?;
        let scene = scene::to_python(batch.task().given_scene(), py)?;
        Ok(((scene, task).into_pyobject(py)?, options))
    }

    /// Drawn parts and progress of the episodes: seed, episode and step (N,), target_position (N, 3),
    /// target_rotation (N, 3, 3), current (N, 3), action (N, a), joint_reference and joint_reference_rate (N, n).
    fn episodes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let n = self.batch.instances();
        let all = (0..n).map(|i| self.batch.episode(i).ok_or(TaskError::NotBegun { instance: i }));
        let all: Vec<_> = all.collect::<Result<_, _>>().or_raise()?;
        let gather = |of: &dyn Fn(&Episode) -> Vec<f64>| matrix(py, all.iter().flat_map(of).collect(), n);
        let rotation = gather(&|e| e.target().rotation.transpose().as_slice().to_vec())?;
        Ok(dict! { py;
            "seed": PyArray1::from_iter(py, all.iter().map(|e| e.key().seed)),
            "episode": PyArray1::from_iter(py, all.iter().map(|e| e.key().episode)),
            "step": PyArray1::from_iter(py, all.iter().map(|e| e.step())),
            "target_position": gather(&|e| e.target().position.as_slice().to_vec())?,
            "target_rotation": rotation.call_method1("reshape", (n, 3, 3))?,
            "current": gather(&|e| e.current().as_slice().to_vec())?,
            "action": gather(&|e| e.action().to_vec())?,
            "joint_reference": gather(&|e| e.reference().iter().map(|r| r.value).collect())?,
            "joint_reference_rate": gather(&|e| e.reference().iter().map(|r| r.rate).collect())?,
        })
    }

    /// Points along the reference paths of the end effectors, (N, count, 3); count is 0 for tasks without a path.
    fn paths<'py>(&self, py: Python<'py>, count: usize) -> PyResult<arrays::Array<'py>> {
        let n = self.batch.instances();
        let places = (0..n).filter_map(|i| self.batch.episode(i)).flat_map(|e| e.path(count).into_flattened());
        let places: Vec<f64> = places.collect();
        arrays::array(py, &[n, places.len() / (3 * n), 3], places)
    }
}

impl Task {
    /// Control periods of the batch without the GIL, and their warnings. Ctrl-C interrupts a long call: instances
    /// may then have advanced by different numbers of periods.
    pub(super) fn advance<R: Send>(
        &mut self,
        py: Python<'_>,
        periods: f64,
        steps: impl FnOnce(&mut TaskBatch) -> Result<R, TaskError> + Send,
    ) -> PyResult<R> {
        let batch = &mut self.batch;
        warn(py, batch.warn_of_step())?;
        let result = match periods * batch.instances() as f64 * f64::from(batch.task().options().substeps) > SHORT {
            true => interruptible(py, || steps(batch)),
            false => detached(py, || steps(batch)),
        };
        let result = result?.or_raise()?;
        std::iter::from_fn(|| batch.warn_of_motion()).try_for_each(|warning| warn(py, Some(warning)))?;
        Ok(result)
    }

    fn observations<'py>(&self, py: Python<'py>, flat: Vec<f32>) -> PyResult<Rows<'py, f32>> {
        let width = self.batch.task().observation_len();
        let count = flat.len() / width;
        matrix(py, flat, count)
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

    /// A dict of these values. A copy of a dict with all names does not grow.
    fn fill<'py>(&self, py: Python<'py>, values: &[f64]) -> PyResult<Bound<'py, PyDict>> {
        let info = self.blank.bind(py).copy()?;
        for (name, value) in self.names.iter().zip(values) {
            info.set_item(name, value)?;
        }
        Ok(info)
    }
}
