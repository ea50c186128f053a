//! `uvms_gym.Simulator`: reading and setting the state, and estimates of its errors.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{Array, Given, array, dict, optional_rows};
use super::computation::{exclusive, shared};
use super::errors::OrRaise;
use super::simulator::Simulator;
use uvms_gym::batch::{self, States};
use uvms_gym::system::quaternion;

/// Array (N, ...) of numbers of every instance, each of the shape `row`; of any number in a row where None.
fn gather<'py, I: IntoIterator<Item = f64>>(
    slf: &Bound<'py, Simulator>,
    row: Option<&[usize]>,
    numbers: impl Fn(&batch::Simulator, usize) -> I,
) -> PyResult<Array<'py>> {
    let this = &shared(slf)?.inner;
    let instances = this.instances();
    let all: Vec<f64> = (0..instances).flat_map(|i| numbers(this, i)).collect();
    let shape = [&[instances], row.unwrap_or(&[all.len() / instances])].concat();
    array(slf.py(), &shape, all)
}

/// Estimates of all instances by name.
pub fn error_estimate<'py>(simulator: &batch::Simulator, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
    let Some(estimates) = simulator.error_estimates() else {
        return Err(PyValueError::new_err("errors are not estimated: make it with error_estimate=True"));
    };
    let (n, joints) = (estimates.len(), simulator.joints());
    let column = |of: &dyn Fn(&batch::ErrorEstimate) -> f64| array(py, &[n], estimates.iter().map(of).collect());
    Ok(dict! { py;
        "position": column(&|e| e.position)?,
        "attitude": column(&|e| e.attitude)?,
        "q": array(py, &[n, joints], estimates.iter().flat_map(|e| e.q[..joints].to_vec()).collect())?,
        "end_effector_position": column(&|e| e.end_effector_position)?,
        "end_effector_attitude": column(&|e| e.end_effector_attitude)?,
        "relative": column(&|e| e.relative)?,
        "known": numpy::PyArray1::from_iter(py, estimates.iter().map(batch::ErrorEstimate::known)),
    })
}

#[pymethods]
impl Simulator {
    /// numpy.ndarray (N, 3): vehicle origin in the world, m.
    #[getter]
    fn position<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, Some(&[3]), |simulator, i| <[f64; 3]>::from(simulator.state(i).position))
    }

    /// numpy.ndarray (N, 3, 3): rotation matrix of the vehicle, body to world.
    #[getter]
    fn rotation<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, Some(&[3, 3]), |simulator, i| simulator.state(i).rotation.transpose().as_slice().to_vec())
    }

    /// numpy.ndarray (N, 4): unit quaternion [w, x, y, z] of the vehicle, w >= 0, body to world. The quaternion
    /// integrators return theirs unchanged: of either sign, and only approximately of unit length. [HC eq. 14]
    #[getter]
    fn quaternion<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, Some(&[4]), |simulator, i| {
            simulator.kept_quaternion(i).unwrap_or_else(|| quaternion(&simulator.state(i).rotation))
        })
    }

    /// numpy.ndarray (N, 6): absolute body twist [v; omega] of the vehicle, m/s and rad/s.
    #[getter]
    fn twist<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, Some(&[6]), |simulator, i| <[f64; 6]>::from(simulator.state(i).twist))
    }

    /// numpy.ndarray (N, n): joint coordinates, rad or m.
    #[getter]
    fn q<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, None, |simulator, i| simulator.state(i).q[..simulator.joints()].to_vec())
    }

    /// numpy.ndarray (N, n): joint rates, rad/s or m/s.
    #[getter]
    fn qd<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, None, |simulator, i| simulator.state(i).qd[..simulator.joints()].to_vec())
    }

    /// numpy.ndarray (N, m): thrust of each thruster in still water, N: the state of thrusters with dynamics (`lag`,
    /// `dead_band`, `map` or `ambient_flow` in the scene). 0 in scenes without.
    #[getter]
    fn thrust<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, None, |simulator, i| simulator.state(i).thrust.into_iter().take(simulator.allocation().count()))
    }

    /// numpy.ndarray (N,): time, s.
    #[getter]
    fn time<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, Some(&[]), |simulator, i| [simulator.state(i).time])
    }

    /// numpy.ndarray (N,): h*lambda, dt times the fastest rate (1/s) that the motion of each instance excites, estimated from
    /// the stages of the last thirty steps or so. Explicit methods of order 4 are unstable beyond about 2.8, and inaccurate
    /// well below. 0 before the first step after `set_state`, and for the integrators of one stage. For adaptive integrators
    /// dt is the sub-interval that they choose.
    #[getter]
    fn stiffness<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, Some(&[]), |simulator, i| [simulator.stiffness(i)])
    }

    /// numpy.ndarray (N,): relative velocity error of the last thirty steps or so of each instance: the sum of the errors
    /// estimated from the stages over the maximum speed; or the error of spinning in ten seconds, if that is greater.
    /// Integrators of one stage have only the error of spinning; "mk54", which controls its error, has 0.
    #[getter]
    fn step_error<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, Some(&[]), |simulator, i| [simulator.step_error(i)])
    }

    /// numpy.ndarray (N, 3): velocity of the water in the world, m/s.
    #[getter]
    fn current<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, Some(&[3]), |simulator, i| <[f64; 3]>::from(simulator.flow(i).velocity))
    }

    /// numpy.ndarray (N, 3): acceleration of the water in the world, m/s^2.
    #[getter]
    fn current_acceleration<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        gather(slf, Some(&[3]), |simulator, i| <[f64; 3]>::from(simulator.flow(i).acceleration))
    }

    /// Set parts of the state; parts that are not given do not change.
    ///
    /// Each part has one row for all instances, or one per instance. Everything is checked before anything changes.
    ///
    /// Parameters
    /// ----------
    /// position : array_like (3,) or (N, 3)
    ///     Vehicle origin in the world, m.
    /// rotation : array_like (3, 3) or (N, 3, 3)
    ///     Body to world. Deviation of R^T R from I at most 1e-6 per entry; is made orthonormal.
    /// quaternion : array_like (4,) or (N, 4)
    ///     Attitude as [w, x, y, z], normalised here. Excludes `rotation`.
    /// twist : array_like (6,) or (N, 6)
    ///     Absolute body twist [v; omega], m/s and rad/s; zero if the vehicle is fixed.
    /// q : array_like (n,) or (N, n)
    ///     Joint coordinates, rad or m.
    /// qd : array_like (n,) or (N, n)
    ///     Joint rates, rad/s or m/s.
    /// thrust : array_like (m,) or (N, m)
    ///     Thrust of each thruster in still water, N, within its limits; only where the scene gives thrusters dynamics.
    /// time : float or array_like (N,)
    ///     Time, s.
    /// current : array_like (3,) or (N, 3)
    ///     Velocity of the water in the world, m/s; changes at `current_acceleration` until it is set again.
    /// current_acceleration : array_like (3,) or (N, 3)
    ///     Acceleration of the water in the world, m/s^2, uniform in space; the current changes by it. The pressure that
    ///     accelerates the water acts on the bodies too (Froude-Krylov force), beside added mass. Zero if the scene has no
    ///     gravity.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     Wrong shape, number not finite, invalid rotation, zero quaternion, motion of a fixed vehicle, acceleration of water
    ///     in a scene without gravity.
    /// TypeError
    ///     Argument that is not an array of real numbers.
    #[pyo3(signature = (
        position=None, rotation=None, quaternion=None, twist=None, q=None, qd=None, time=None, current=None,
        current_acceleration=None, thrust=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn set_state(
        slf: &Bound<'_, Self>,
        position: Given,
        rotation: Given,
        quaternion: Given,
        twist: Given,
        q: Given,
        qd: Given,
        time: Given,
        current: Given,
        current_acceleration: Given,
        thrust: Given,
    ) -> PyResult<()> {
        let this = &mut *exclusive(slf)?;
        let (instances, n) = (this.inner.instances(), this.inner.joints());
        let rows = |name: &str, given: Given, row: &[usize]| optional_rows(name, given, instances, row);
        let thrusters = this.inner.allocation().count();
        let result = this.inner.set_states(&States {
            position: rows("position", position, &[3])?.as_deref(),
            rotation: rows("rotation", rotation, &[3, 3])?.as_deref(),
            quaternion: rows("quaternion", quaternion, &[4])?.as_deref(),
            twist: rows("twist", twist, &[6])?.as_deref(),
            q: rows("q", q, &[n])?.as_deref(),
            qd: rows("qd", qd, &[n])?.as_deref(),
            thrust: rows("thrust", thrust, &[thrusters])?.as_deref(),
            time: rows("time", time, &[])?.as_deref(),
            current: rows("current", current, &[3])?.as_deref(),
            current_acceleration: rows("current_acceleration", current_acceleration, &[3])?.as_deref(),
        });
        result.or_raise()
    }

    /// Put all instances at the scene's home: level at the world origin, at rest at time 0, joints at home, in the
    /// scene's current.
    fn reset(slf: &Bound<'_, Self>) -> PyResult<()> {
        exclusive(slf)?.inner.reset();
        Ok(())
    }

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
