//! `uvms_gym.Simulator`: construction, properties, copies.

use pyo3::exceptions::{PyOverflowError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString, PyTuple};

use super::arrays::{Array, Given, array, count, dict, name_of, one_of, read, wrong_shape};
use super::computation::interruptible;
use super::errors::OrRaise;
use super::scene;
use uvms_gym::batch::{self, Precision, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::limits::memory;

/// Batched simulator of one scene, or of scenes that differ in their numbers, without a task.
///
/// Instances are independent: the result of each depends only on its own state and inputs, bit for bit, and not on
/// `num_envs`, the instance's place among the others or `threads`.
///
/// N is `num_envs`, n the number of joints, m of thrusters, k of fins. SI units. World z up; body x forward, y left,
/// z up; quaternions [w, x, y, z]; 6-vectors [linear; angular]: twists [v; omega] in body axes at the vehicle
/// frame, absolute (not relative to the water), and wrenches [f; m] in body axes at the body's frame origin. External
/// wrenches act on the vehicle and on one body per joint; a link's frame lies at its joint and moves with it.
///
/// Parameters
/// ----------
/// scene : str, os.PathLike, dict, or list of these
///     Name of a shipped scene (see `scenes`), path of a TOML file, or a dict of the same form; or a list of N scenes, one for
///     each instance. They have the same structure: the same joints, thrusters, fins and terms, and a number that is 0 in one
///     scene, where its term is left out, is 0 in all.
/// num_envs : int
///     Number of instances N. None: the number of scenes or rows of `parameters`, or 1.
/// dt : float or None
///     Step size, s. None: the step that the (first) scene states in its table `integration`, or 0.01.
/// integrator : str or None
///     Name of an integrator that `integrators` lists. None: as the (first) scene states in its table `integration`, or "mk4"
///     (Munthe-Kaas, order 4). [HC eqs. 14, 17, 18]
/// dtype : str
///     "float64", or "float32": twice as fast, less accurate. Arrays are float64 in both cases.
/// threads : int or None
///     Maximum number of threads; one per core where None. Few instances use fewer.
/// gamma : float
///     Gain of the norm-restoring term of the quaternion integrators, 1/s. [HC eq. 14]
/// parameters : dict of array_like (N, ...), optional
///     Numbers of the scene that instances have of their own, by their keys in the scene, one row for each instance:
///     `{"vehicle.body.mass": masses, "arm.links[0].joint.friction.viscous": frictions, "vehicle.body.added_mass": diagonals}`
///     with shapes (N,), (N,) and (N, 6). A scalar applies to all. Each resulting scene is checked.
/// tolerance : float
///     For adaptive integrators ("mk54"): bound on the estimated error of each sub-interval of a step, in m and rad
///     for the pose, absolute and relative for twist, q and qd. Minimum value about 1e-6 in float32; smaller ones count as that.
/// prescribed_joints : bool or sequence of str or int
///     Joints, by name or index, that follow `joint_target` of `step` exactly instead of by a servo (True: all of them), in
///     addition to joints that the scene prescribes (`joint.prescribed`).
/// end_effector : str, optional
///     Name of the end effector in use, one of `end_effector_names`: pose, Jacobian, planning, tasks, payloads of
///     `scale_parameters` and estimated errors concern it. None: the scene's `arm.end_effector`.
/// error_estimate : bool or None
///     True to estimate the errors of integration that have accumulated, of every instance at every step: see the method
///     `error_estimate`. A call of `step` then takes 3.3 times as long, 5.5 times in float32. None: errors are
///     estimated only for warnings, of all instances up to eight, otherwise of eight out of every 128 in turns of 20 s, which
///     takes about 1 % of a step on average. False: no estimates.
///
/// Raises
/// ------
/// SceneError
///     A scene cannot be read or is not physical: the message names instance, key and value. A key of `parameters` is unknown.
/// ValueError, TypeError
///     Another argument is out of range or of the wrong type.
#[pyclass(module = "uvms_gym", name = "Simulator")]
pub struct Simulator {
    pub(super) inner: batch::Simulator,
}

/// Number of an argument.
pub(super) fn number(name: &str, given: Given, default: f64) -> PyResult<f64> {
    let Some(given) = given else { return Ok(default) };
    given.extract().map_err(|error: PyErr| {
        if error.is_instance_of::<PyOverflowError>(given.py()) {
            PyValueError::new_err(format!("{name} is out of range"))
        } else {
            PyTypeError::new_err(format!("{name} must be a number: {error}"))
        }
    })
}

/// Types of numbers by name.
pub(super) const DTYPES: [(&str, Precision); 2] = [("float64", Precision::Double), ("float32", Precision::Single)];

fn precision(given: &Bound<'_, PyAny>) -> PyResult<Precision> {
    let name: String = if given.is_instance_of::<PyString>() || given.is_none() {
        given.str()?.to_string_lossy().into_owned()
    } else {
        given.py().import("numpy")?.call_method1("dtype", (given,))?.getattr("name")?.extract()?
    };
    one_of("dtype", &name, DTYPES)
}

/// Prescribes joints, given by names or indices, or all or none by a bool.
fn prescribe(scene: &mut Scene, given: &Bound<'_, PyAny>) -> PyResult<()> {
    let names = scene.joint_names();
    let mut joints: Vec<_> = scene.joints_mut().collect();
    if let Ok(all) = given.extract::<bool>() {
        joints.iter_mut().for_each(|joint| joint.prescribed |= all);
        return Ok(());
    }
    for entry in given.try_iter()? {
        let entry = entry?;
        let k = match entry.extract::<usize>() {
            Ok(k) => Some(k).filter(|k| *k < names.len()),
            Err(_) => entry.extract::<String>().ok().and_then(|name| names.iter().position(|known| *known == name)),
        };
        let Some(k) = k else {
            let known = names.join(", ");
            return Err(PyValueError::new_err(format!(
                "prescribed_joints: no joint {}; joints: {known}",
                entry.repr()?
            )));
        };
        joints[k].prescribed = true;
    }
    Ok(())
}

impl Simulator {
    /// A copy of a simulator with its present state.
    pub(super) fn copy_of(simulator: &batch::Simulator) -> PyResult<Self> {
        memory::check("the copy", &[simulator.instances(), simulator.bytes_per_instance()]).or_raise()?;
        Ok(Self { inner: simulator.clone() })
    }
}

#[pymethods]
impl Simulator {
    #[new]
    #[pyo3(
        signature = (
            scene, num_envs=None, *, dt=None, integrator=None, dtype=None, threads=None, gamma=None, tolerance=None,
            prescribed_joints=None, parameters=None, end_effector=None, error_estimate=None
        ),
        text_signature = "(scene, num_envs=None, *, dt=None, integrator=None, dtype='float64', threads=None, gamma=1.0, tolerance=1e-08, prescribed_joints=False, parameters=None, end_effector=None, error_estimate=None)"
    )]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, PyAny>,
        num_envs: Given,
        dt: Given,
        integrator: Option<String>,
        dtype: Given,
        threads: Given,
        gamma: Given,
        tolerance: Given,
        prescribed_joints: Given,
        parameters: Option<&Bound<'_, PyDict>>,
        end_effector: Option<&str>,
        error_estimate: Option<bool>,
    ) -> PyResult<Self> {
        let num_envs = num_envs.filter(|n| !n.is_none()).map(|n| count("num_envs", n)).transpose()?;
        let mut scenes = scene::read_each(scene, num_envs, parameters, end_effector)?;
        if let Some(given) = prescribed_joints {
            scenes.iter_mut().try_for_each(|scene| prescribe(scene, given))?;
        }
        let default = scenes.first().map_or_else(SimulatorOptions::default, SimulatorOptions::of);
        let options = SimulatorOptions {
            instances: num_envs.unwrap_or(scenes.len()),
            dt: number("dt", dt, default.dt)?,
            integrator: integrator.unwrap_or(default.integrator),
            gamma: number("gamma", gamma, default.gamma)?,
            tolerance: number("tolerance", tolerance, default.tolerance)?,
            precision: dtype.map_or(Ok(default.precision), precision)?,
            threads: threads.map(|n| count("threads", n)).transpose()?,
            error_estimate,
        };
        let make = |mut scenes: Vec<Scene>| match (scenes.pop(), scenes.is_empty()) {
            (Some(scene), true) => batch::Simulator::new(scene, options),
            (last, _) => batch::Simulator::with_scenes(scenes.into_iter().chain(last).collect(), options),
        };
        Ok(Self { inner: interruptible(py, || make(scenes))?.or_raise()? })
    }

    /// int: number of instances N.
    #[getter]
    fn num_envs(&self) -> usize {
        self.inner.instances()
    }

    /// float: step size, s.
    #[getter]
    fn dt(&self) -> f64 {
        self.inner.options().dt
    }

    /// str: name of the integrator.
    #[getter]
    fn integrator(&self) -> &str {
        &self.inner.options().integrator
    }

    /// str: number type that the kernel computes with, "float64" or "float32".
    #[getter]
    fn dtype(&self) -> &'static str {
        name_of(self.inner.options().precision, DTYPES)
    }

    /// float: gain of the quaternion integrators, 1/s. [HC eq. 14]
    #[getter]
    fn gamma(&self) -> f64 {
        self.inner.options().gamma
    }

    /// float: bound on the estimated error of a sub-interval of a step, for adaptive integrators.
    #[getter]
    fn tolerance(&self) -> f64 {
        self.inner.options().tolerance
    }

    /// int: maximum number of threads of a step.
    #[getter]
    fn threads(&self) -> usize {
        self.inner.threads()
    }

    /// str: instruction set of the kernels: "avx512", "avx2", "neon", "fma" or "plain"; the widest available, but "fma" for a
    /// single instance, where it is faster. The environment variable UVMS_INSTRUCTION_SET chooses another. All but "plain" give the same
    /// results bit for bit.
    #[getter]
    fn instruction_set(&self) -> &'static str {
        self.inner.isa().name()
    }

    /// dict: the complete scene, in the form of `load_scene`; where scenes differ, the scene of the first instance.
    #[getter]
    fn scene<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        scene::to_python(self.inner.scene(), py)
    }

    /// list of dict: the complete scene of each instance.
    #[getter]
    fn scenes<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        (0..self.num_envs()).map(|i| scene::to_python(self.inner.scene_of(i), py)).collect()
    }

    /// str: name of the scene.
    #[getter]
    fn scene_name(&self) -> &str {
        &self.inner.scene().name
    }

    /// int: number of joints n.
    #[getter]
    fn num_joints(&self) -> usize {
        self.inner.joints()
    }

    /// int: number of moving bodies, n + 1.
    #[getter]
    fn num_bodies(&self) -> usize {
        self.inner.joints() + 1
    }

    /// int: number of thrusters m.
    #[getter]
    fn num_thrusters(&self) -> usize {
        self.inner.allocation().count()
    }

    /// list of str: names of the joints, in the order of every joint array.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.inner.scene().coordinate_names()
    }

    /// list of str: names of the moving bodies, "vehicle" first, then one per joint.
    #[getter]
    fn body_names(&self) -> Vec<String> {
        self.inner.scene().body_names()
    }

    /// list of str: names of the end effectors; "default" is the scene's `arm.end_effector` where it has no other name.
    #[getter]
    fn end_effector_names(&self) -> Vec<String> {
        self.inner.scene().end_effector_names()
    }

    /// list of str: names of the thrusters.
    #[getter]
    fn thruster_names(&self) -> Vec<String> {
        self.inner.scene().thruster_names()
    }

    /// int: number of fins k.
    #[getter]
    fn num_fins(&self) -> usize {
        self.inner.scene().vehicle.fins.len()
    }

    /// list of str: names of the fins.
    #[getter]
    fn fin_names(&self) -> Vec<String> {
        self.inner.scene().fin_names()
    }

    /// numpy.ndarray (k, 2): minimum and maximum deflection, rad; of the first instance where they differ.
    #[getter]
    fn fin_limits<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let fins = &self.inner.scene().vehicle.fins;
        array(py, &[fins.len(), 2], fins.iter().flat_map(|fin| fin.range()).collect())
    }

    /// numpy.ndarray (m, 2): minimum and maximum thrust, N; of the first instance where they differ.
    #[getter]
    fn thruster_limits<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let allocation = self.inner.allocation();
        array(py, &[allocation.count(), 2], (0..allocation.count()).flat_map(|i| allocation.limits(i)).collect())
    }

    /// numpy.ndarray (6, m): thruster configuration matrix, wrench on the vehicle per thrust; of the first instance where they
    /// differ. [HC eq. 25]
    #[getter]
    fn thruster_configuration<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let configuration = self.inner.allocation().configuration();
        array(py, &[6, configuration.ncols()], configuration.transpose().as_slice().to_vec())
    }

    /// int: bytes of memory per instance; a few instances fill a block of 8 (float64) or 16 (float32). With those of a copy in
    /// double precision, once a float32 simulator has computed derivatives.
    #[getter]
    fn bytes_per_env(&self) -> usize {
        self.inner.bytes_per_instance()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let name = PyString::new(py, self.scene_name()).repr()?;
        Ok(format!(
            "Simulator({name}, num_envs={}, dt={:?}, integrator='{}', dtype='{}')",
            self.num_envs(),
            self.dt(),
            self.integrator(),
            self.dtype(),
        ))
    }

    fn __copy__(&self) -> PyResult<Self> {
        Self::copy_of(&self.inner)
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.__copy__()
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let SimulatorOptions { dt, integrator, gamma, tolerance, threads, error_estimate, .. } = self.inner.options();
        let options = dict! { py;
            "dt": dt, "integrator": integrator, "dtype": self.dtype(), "threads": threads,
            "gamma": gamma, "tolerance": tolerance, "error_estimate": error_estimate,
        };
        let scene = match self.inner.scenes() {
            Some(_) => self.scenes(py)?.into_pyobject(py)?.into_any(),
            None => self.scene(py)?,
        };
        Ok(((scene, self.num_envs()).into_pyobject(py)?, options))
    }

    fn __getstate__<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let size = self.inner.save_len() * size_of::<f64>();
        memory::check("the state", &[self.num_envs(), size]).or_raise()?;
        let numbers = self.inner.save();
        array(py, &[self.num_envs(), numbers.len() / self.num_envs()], numbers)
    }

    fn __setstate__(&mut self, state: &Bound<'_, PyAny>) -> PyResult<()> {
        let (shape, numbers) = read("state", state)?;
        let expected = [self.num_envs(), self.inner.save_len()];
        if shape != expected {
            return Err(wrong_shape("state", &shape, &format!("{expected:?}")));
        }
        self.inner.load(&numbers).or_raise()
    }
}
