//! `uvms_gym.Sensors`: readings of a simulator's motion.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{Given, array, dict, read, wrong_shape};
use super::computation::{exclusive, shared};
use super::errors::OrRaise;
use super::simulator::Simulator;
use uvms_gym::batch;
use uvms_gym::sensors::{self, Motion, Suite};

/// Settings of sensors from a dict, a list of names, or None for all.
pub(super) fn suite(py: Python<'_>, given: Given) -> PyResult<Suite> {
    let text: String = match given {
        None => "null".into(),
        Some(given) => py.import("json")?.call_method1("dumps", (given,))?.extract()?,
    };
    Suite::from_json(&text).or_raise()
}

/// Settings of sensors as a dict.
pub(super) fn suite_dict<'py>(py: Python<'py>, suite: &Suite) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (suite.to_json(),))
}

/// Chosen instances of an optional mask (N,) of bool.
pub(super) fn chosen(mask: Given, instances: usize) -> PyResult<Vec<bool>> {
    let Some(mask) = mask else { return Ok(vec![true; instances]) };
    let numpy = mask.py().import("numpy")?;
    let floats = numpy.call_method1("asarray", (mask, "bool"))?.call_method1("astype", ("float64",))?;
    let (shape, flags) = read("mask", &floats)?;
    if shape != [instances] {
        return Err(wrong_shape("mask", &shape, &format!("({instances},)")));
    }
    Ok(flags.into_iter().map(|flag| flag != 0.0).collect())
}

/// Motion of instance `i`.
pub(super) fn motion(simulator: &batch::Simulator, i: usize) -> Motion {
    let state = simulator.state(i);
    let part = |first: usize| state.twist.fixed_rows::<3>(first).into();
    Motion {
        time: state.time,
        position: state.position,
        rotation: state.rotation,
        linear: part(0),
        angular: part(3),
        gravity: simulator.scene_of(i).water.gravity,
    }
}

/// Sensors on the vehicles of a simulator: IMU, DVL, depth, heading and acoustic position fixes.
///
/// Instance i draws its noise as a single instance with the seed `seed + i`: readings depend on the motion, the seed and
/// the times of the calls only. N is the number of instances. Units are SI, angles rad.
///
/// Parameters
/// ----------
/// simulator : Simulator
///     Simulator that will be measured: gives the number of instances.
/// suite : dict, sequence of str, or None
///     Sensors by name ("imu", "dvl", "depth", "heading", "acoustic") with the settings that differ from their defaults, or
///     True: `{"imu": {"rate": 200}, "depth": True}`; or names; None: all with their defaults. Every sensor has `rate` (Hz),
///     `delay` (s), `dropout` (probability that a sample is lost) and `failure` (time in s from which on nothing arrives, or
///     None). The attribute `suite` has all settings.
/// seed : int
///     Seed of the noise, from 0 on.
///
/// Raises
/// ------
/// ValueError
///     Unknown sensor or setting, or a number out of range; the message has its name and the range.
#[pyclass(module = "uvms_gym", name = "Sensors")]
pub struct Sensors {
    inner: sensors::Sensors,
}

#[pymethods]
impl Sensors {
    #[new]
    #[pyo3(signature = (simulator, suite=None, *, seed=0))]
    fn new(simulator: &Bound<'_, Simulator>, suite: Given, seed: u64) -> PyResult<Self> {
        let settings = self::suite(simulator.py(), suite)?;
        Ok(Self { inner: sensors::Sensors::new(settings, shared(simulator)?.inner.instances(), seed) })
    }

    /// int: number of instances N.
    #[getter]
    fn num_envs(&self) -> usize {
        self.inner.instances()
    }

    /// dict: all settings of the sensors, by name.
    #[getter]
    fn suite<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        suite_dict(py, self.inner.suite())
    }

    /// Start a new episode: new biases, no samples on their way, any failure that `fail` set over.
    ///
    /// Parameters
    /// ----------
    /// seed : int or None
    ///     Seed of instance 0, `seed + i` of instance i. None: the next episode of the present seed.
    /// mask : array_like (N,) of bool, optional
    ///     Instances to reset; all without it.
    #[pyo3(signature = (seed=None, mask=None))]
    fn reset(slf: &Bound<'_, Self>, seed: Option<u64>, mask: Given) -> PyResult<()> {
        let inner = &mut exclusive(slf)?.inner;
        for (i, chosen) in chosen(mask, inner.instances())?.into_iter().enumerate() {
            if chosen {
                inner.reset(i, seed.map(|seed| seed.wrapping_add(i as u64)));
            }
        }
        Ok(())
    }

    /// Let a sensor fail, or work again: nothing that it samples in between arrives.
    ///
    /// Parameters
    /// ----------
    /// name : str
    ///     Name of the sensor.
    /// failed : bool
    ///     True: it fails; False: it works.
    /// mask : array_like (N,) of bool, optional
    ///     Instances concerned; all without it.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     Unknown sensor.
    #[pyo3(signature = (name, failed=true, mask=None))]
    fn fail(slf: &Bound<'_, Self>, name: &str, failed: bool, mask: Given) -> PyResult<()> {
        let inner = &mut exclusive(slf)?.inner;
        for (i, chosen) in chosen(mask, inner.instances())?.into_iter().enumerate() {
            if chosen {
                inner.fail(i, name, failed).or_raise()?;
            }
        }
        Ok(())
    }

    /// Sample the present motion and return the readings that have arrived since the last call.
    ///
    /// A sensor samples at the first call in each interval of `1 / rate` since time 0. Call it after a reset, and then after
    /// every step or control period. Of several readings of a sensor that arrive between two calls the last one counts.
    ///
    /// Parameters
    /// ----------
    /// simulator : Simulator
    ///     Simulator with as many instances.
    ///
    /// Returns
    /// -------
    /// dict
    ///     "time" (N,), the time of the call, s; and a dict for each sensor: "valid" (N,), bool, True where a reading arrived,
    ///     "time" (N,) of its sample, s, and its values, NaN where nothing arrived.
    ///
    ///     "imu": "specific_force" (N, 3), m/s2, and "angular_velocity" (N, 3), rad/s, in the IMU's axes, means since its last
    ///     sample, and "latest_angular_velocity" (N, 3) at the sample; the first sample of an episode is not valid. "dvl": "velocity" (N, 3) over the bottom in the DVL's axes,
    ///     m/s, NaN with fewer than three beams; "beams" (N, 4), the velocity along each beam, positive toward the bottom,
    ///     and "range" (N, 4), m, NaN for lost beams. "depth": "depth" (N, 1), m, positive downward. "heading": "heading"
    ///     (N, 1), rad in (-pi, pi], from the world's x axis about its z axis. "acoustic": "position" (N, 3) of the
    ///     transponder in the world, m.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     Another number of instances, or a time before that of the last call.
    fn measure<'py>(slf: &Bound<'py, Self>, simulator: &Bound<'py, Simulator>) -> PyResult<Bound<'py, PyDict>> {
        let py = slf.py();
        let motions: Vec<_> = {
            let simulator = &shared(simulator)?.inner;
            (0..simulator.instances()).map(|i| motion(simulator, i)).collect()
        };
        let readings = exclusive(slf)?.inner.measure(&motions).or_raise()?;
        let n = motions.len();
        let all = dict! { py; "time": array(py, &[n], readings.time)? };
        for sensor in readings.sensors {
            let one = dict! { py;
                "valid": numpy::PyArray1::from_vec(py, sensor.valid),
                "time": array(py, &[n], sensor.time)?,
            };
            let mut first = 0;
            for &(name, width) in sensor.fields {
                let rows = sensor.values.chunks_exact(sensor.width);
                let part = rows.flat_map(|row| row[first..first + width].to_vec()).collect();
                one.set_item(name, array(py, &[n, width], part)?)?;
                first += width;
            }
            all.set_item(sensor.name, one)?;
        }
        Ok(all)
    }

    /// Biases now: of the IMU's specific force (m/s2) and angular velocity (rad/s), the depth's offset (m) and the
    /// heading's bias (rad).
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray
    ///     "imu" (N, 6), "depth" (N, 1) and "heading" (N, 1), of those that are fitted.
    fn biases<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let found = PyDict::new(py);
        for (name, width) in [("imu", 6), ("depth", 1), ("heading", 1)] {
            let rows: Vec<_> = (0..self.num_envs()).filter_map(|i| self.inner.biases(i, name)).collect();
            if rows.len() == self.num_envs() {
                let numbers = rows.iter().flat_map(|row| row[..width].to_vec()).collect();
                found.set_item(name, array(py, &[self.num_envs(), width], numbers)?)?;
            }
        }
        Ok(found)
    }

    fn __repr__(&self) -> String {
        let names: Vec<_> = self.inner.suite().sensors().iter().map(|sensor| sensor.name()).collect();
        format!("Sensors(num_envs={}, sensors={names:?})", self.num_envs())
    }
}
