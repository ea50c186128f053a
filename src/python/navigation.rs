//! `uvms_gym.NavigationFilter`: pose, twist and biases from readings.

use nalgebra::{Matrix3, Vector3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{Array, Given, array, dict, rows};
use super::computation::{detached, exclusive, shared};
use super::errors::OrRaise;
use super::sensors::{chosen, motion, suite, suite_dict};
use super::simulator::Simulator;
use uvms_gym::navigation::{self, Estimate, InstanceReadings, OUTPUT, Start, StartDeviations, UPDATES};
use uvms_gym::sensors::{BEAMS, Motion};

/// Error-state Kalman filter on SE(3): pose, twist and biases of vehicles from the readings of their sensors.
///
/// It integrates the IMU and corrects by the DVL's beams, depth, heading and acoustic fixes. Errors are in body axes: of
/// the estimated position p and rotation R, the true ones are `p + R rho` and `R exp(theta)`. A late fix corrects the
/// position at its ping, which is part of the state. A reading is refused where its normalised innovation squared exceeds
/// the bound that a chi-squared number exceeds once in a thousand. After three refusals in a row of another sensor than the
/// acoustic one, the deviations of attitude and velocity grow, and the reading corrects. N is the number of instances.
///
/// Parameters
/// ----------
/// suite : dict, sequence of str, or None
///     Settings of the sensors as of `Sensors`: `sensors.suite`. The filter takes noise, biases, rates and mounts from it.
/// num_envs : int
///     Number of instances N.
///
/// Raises
/// ------
/// ValueError
///     As of `Sensors`; no IMU; a delay of another sensor than the acoustic one, or a delay of fixes beyond their interval.
#[pyclass(module = "uvms_gym", name = "NavigationFilter")]
pub struct NavigationFilter {
    inner: navigation::NavigationFilter,
}

/// Rows of three numbers of an instance.
fn three(rows: &[f64], i: usize) -> Vector3<f64> {
    Vector3::from_column_slice(&rows[3 * i..3 * i + 3])
}

/// Readings of one sensor: validity, time, and the named part.
struct Part {
    valid: Vec<bool>,
    time: Vec<f64>,
    values: Vec<f64>,
}

impl Part {
    fn read(readings: &Bound<'_, PyDict>, sensor: &str, field: &str, n: usize, width: usize) -> PyResult<Option<Self>> {
        let Some(given) = readings.get_item(sensor)? else { return Ok(None) };
        let given = given.cast_into::<PyDict>()?;
        let part = |key: &str| match given.get_item(key)? {
            Some(value) => Ok(value),
            None => Err(PyValueError::new_err(format!("readings of {sensor} have no '{key}'"))),
        };
        let name = |key: &str| format!("{sensor} {key}");
        Ok(Some(Self {
            valid: chosen(Some(&part("valid")?), n)?,
            time: rows(&name("time"), &part("time")?, n, &[])?,
            values: rows(&name(field), &part(field)?, n, &[width])?,
        }))
    }
}

impl NavigationFilter {
    fn gather<'py, const K: usize>(
        &self,
        py: Python<'py>,
        shape: &[usize],
        of: impl Fn(&Estimate) -> [f64; K],
    ) -> PyResult<Array<'py>> {
        let n = self.inner.instances();
        let mut all = Vec::with_capacity(n * K);
        for i in 0..n {
            all.extend(of(&self.inner.estimate(i).or_raise()?));
        }
        array(py, &[&[n], shape].concat(), all)
    }
}

#[pymethods]
impl NavigationFilter {
    #[new]
    #[pyo3(signature = (suite=None, num_envs=1))]
    fn new(py: Python<'_>, suite: Given, num_envs: usize) -> PyResult<Self> {
        let inner = navigation::NavigationFilter::new(self::suite(py, suite)?, num_envs).or_raise()?;
        Ok(Self { inner })
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

    /// Start from the motion of a simulator plus errors, or from given poses.
    ///
    /// Parameters
    /// ----------
    /// simulator : Simulator
    ///     Time, gravity and, where they are not given, pose and twist at the start.
    /// position : array_like (3,) or (N, 3), optional
    ///     Estimated origin in the world, m.
    /// rotation : array_like (3, 3) or (N, 3, 3), optional
    ///     Estimated rotation, body to world.
    /// twist : array_like (6,) or (N, 6), optional
    ///     Estimated absolute body twist, m/s and rad/s.
    /// deviations : tuple of float
    ///     Standard deviations of the errors along each body axis: position (m), attitude (rad), velocity (m/s).
    /// mask : array_like (N,) of bool, optional
    ///     Instances to reset; all without it.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     Wrong shape, another number of instances, or deviations that are negative or not finite.
    #[pyo3(
        signature = (simulator, position=None, rotation=None, twist=None, *, deviations=(0.1, 0.05, 0.05), mask=None)
    )]
    fn reset(
        slf: &Bound<'_, Self>,
        simulator: &Bound<'_, Simulator>,
        position: Given,
        rotation: Given,
        twist: Given,
        deviations: (f64, f64, f64),
        mask: Given,
    ) -> PyResult<()> {
        let inner = &mut exclusive(slf)?.inner;
        let simulator = &shared(simulator)?.inner;
        let n = inner.instances();
        if simulator.instances() != n {
            return Err(PyValueError::new_err(format!("{} instances, but there are {n}", simulator.instances())));
        }
        let (position_deviation, attitude, velocity) = deviations;
        for (name, value) in [("position", position_deviation), ("attitude", attitude), ("velocity", velocity)] {
            if !(0.0..=1e6).contains(&value) {
                return Err(PyValueError::new_err(format!(
                    "deviation of the {name} is {value}, but must be within [0, 1e6]"
                )));
            }
        }
        let deviations = StartDeviations { position: position_deviation, attitude, velocity };
        let optional = |name: &str, given: Given, row: &[usize]| given.map(|g| rows(name, g, n, row)).transpose();
        let positions = optional("position", position, &[3])?;
        let rotations = optional("rotation", rotation, &[3, 3])?;
        let twists = optional("twist", twist, &[6])?;
        for (i, chosen) in chosen(mask, n)?.into_iter().enumerate() {
            if !chosen {
                continue;
            }
            let truth = motion(simulator, i);
            let start = Motion {
                position: positions.as_ref().map_or(truth.position, |rows| three(rows, i)),
                rotation: rotations
                    .as_ref()
                    .map_or(truth.rotation, |rows| Matrix3::from_row_slice(&rows[9 * i..9 * i + 9])),
                linear: twists.as_ref().map_or(truth.linear, |rows| three(rows, 2 * i)),
                angular: twists.as_ref().map_or(truth.angular, |rows| three(rows, 2 * i + 1)),
                ..truth
            };
            inner.reset(i, &Start { motion: start, deviations });
        }
        Ok(())
    }

    /// Update by readings: move with the IMU, correct by the other sensors.
    ///
    /// Call it with the readings of every call of `Sensors.measure`, the first one included.
    ///
    /// Parameters
    /// ----------
    /// readings : dict
    ///     As `Sensors.measure` returns it; sensors may be absent. Readings of real sensors have the same form: of "dvl" it
    ///     reads "beams", and "time" only of "imu" and "acoustic"; without "latest_angular_velocity" the IMU's
    ///     "angular_velocity" counts as that.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     Wrong shape, a missing part, an instance without `reset`, or time that runs backward.
    fn update(slf: &Bound<'_, Self>, readings: &Bound<'_, PyDict>) -> PyResult<()> {
        let py = slf.py();
        let inner = &mut exclusive(slf)?.inner;
        let n = inner.instances();
        let Some(time) = readings.get_item("time")? else {
            return Err(PyValueError::new_err("readings have no 'time'"));
        };
        let time = rows("time", &time, n, &[])?;
        let part = |sensor: &str, field: &str, width: usize| Part::read(readings, sensor, field, n, width);
        let force = part("imu", "specific_force", 3)?;
        let rate = part("imu", "angular_velocity", 3)?;
        let name = "latest_angular_velocity";
        let given = readings.get_item("imu")?.is_some_and(|imu| imu.contains(name).unwrap_or(false));
        let latest = part("imu", if given { name } else { "angular_velocity" }, 3)?;
        let beams = part("dvl", "beams", BEAMS)?;
        let depth = part("depth", "depth", 1)?;
        let heading = part("heading", "heading", 1)?;
        let acoustic = part("acoustic", "position", 3)?;
        let at = |part: &Option<Part>, i: usize, width: usize| -> Option<(f64, Vec<f64>)> {
            let part = part.as_ref().filter(|part| part.valid[i])?;
            Some((part.time[i], part.values[width * i..width * (i + 1)].to_vec()))
        };
        let result = detached(py, || {
            for i in 0..n {
                let vector = |values: Vec<f64>| Vector3::from_column_slice(&values);
                let one = InstanceReadings {
                    imu: at(&force, i, 3)
                        .zip(at(&rate, i, 3).zip(at(&latest, i, 3)))
                        .map(|((time, force), parts)| (time, [force, parts.0.1, parts.1.1].map(vector))),
                    dvl: at(&beams, i, BEAMS).map(|(_, beams)| std::array::from_fn(|k| beams[k])),
                    depth: at(&depth, i, 1).map(|(_, depth)| depth[0]),
                    heading: at(&heading, i, 1).map(|(_, heading)| heading[0]),
                    acoustic: at(&acoustic, i, 3).map(|(time, fix)| (time, vector(fix))),
                };
                inner.update(i, time[i], &one)?;
            }
            Ok::<_, uvms_gym::error::SensorError>(())
        })?;
        result.or_raise()
    }

    /// numpy.ndarray (N, 3): estimated vehicle origin in the world, m.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.gather(py, &[3], |estimate| estimate.position.into())
    }

    /// numpy.ndarray (N, 3, 3): estimated rotation matrix of the vehicle, body to world.
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.gather(py, &[3, 3], |estimate| std::array::from_fn::<_, 9, _>(|k| estimate.rotation[(k / 3, k % 3)]))
    }

    /// numpy.ndarray (N, 6): estimated absolute body twist [v; omega] of the vehicle, m/s and rad/s.
    #[getter]
    fn twist<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.gather(py, &[6], |estimate| {
            std::array::from_fn::<_, 6, _>(|k| if k < 3 { estimate.linear[k] } else { estimate.angular[k - 3] })
        })
    }

    /// numpy.ndarray (N, 12, 12): covariance of the errors [rho; theta; dv; domega] of pose,
    /// `(R exp(theta), p + R rho)`, and twist, in body axes, m, rad, m/s and rad/s.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        const SIZE: usize = OUTPUT * OUTPUT;
        self.gather(py, &[OUTPUT, OUTPUT], |estimate| {
            std::array::from_fn::<_, SIZE, _>(|k| estimate.covariance[(k / OUTPUT, k % OUTPUT)])
        })
    }

    /// numpy.ndarray (N, 6): estimated biases of the IMU along the vehicle's axes, of specific force (m/s2) and angular
    /// velocity (rad/s).
    #[getter]
    fn biases<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.gather(py, &[6], |estimate| {
            std::array::from_fn::<_, 6, _>(|k| {
                if k < 3 { estimate.accelerometer_bias[k] } else { estimate.gyro_bias[k - 3] }
            })
        })
    }

    /// Innovations of the last update.
    ///
    /// Returns
    /// -------
    /// dict
    ///     For each of "dvl", "depth", "heading" and "acoustic" a dict: "nis" (N,), the normalised innovation squared, NaN
    ///     without a reading; "degrees" (N,), its degrees of freedom; "accepted" (N,), bool, False where it was refused.
    fn innovations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let n = self.inner.instances();
        let all = PyDict::new(py);
        for (k, name) in UPDATES.into_iter().enumerate() {
            let of = |i: usize| self.inner.innovations(i)[k];
            let nis = (0..n).map(|i| of(i).map_or(f64::NAN, |innovation| innovation.nis)).collect();
            let degrees = (0..n).map(|i| of(i).map_or(0, |innovation| innovation.degrees));
            let accepted = (0..n).map(|i| of(i).is_some_and(|innovation| innovation.accepted));
            let one = dict! { py;
                "nis": array(py, &[n], nis)?,
                "degrees": numpy::PyArray1::from_iter(py, degrees),
                "accepted": numpy::PyArray1::from_iter(py, accepted),
            };
            all.set_item(name, one)?;
        }
        Ok(all)
    }

    fn __repr__(&self) -> String {
        let names: Vec<_> = self.inner.suite().sensors().iter().map(|sensor| sensor.name()).collect();
        format!("NavigationFilter(num_envs={}, sensors={names:?})", self.num_envs())
    }
}
