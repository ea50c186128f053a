//! `uvms_gym.Simulator`: steps and accelerations.

use pyo3::prelude::*;

use super::arrays::{Array, Given, array, count};
use super::computation::{detached, exclusive};
use super::errors::OrRaise;
use super::inputs::{Keywords, StepInputs};
use super::simulator::Simulator;
use super::stability::warn;
use uvms_gym::dynamics::Servos;

#[pymethods]
impl Simulator {
    /// Step all instances under inputs held constant over the call; absent ones are zero.
    ///
    /// Each input has one row for all instances, or one per instance. Everything is checked before anything changes.
    /// The GIL is released; Ctrl-C interrupts between steps.
    ///
    /// Parameters
    /// ----------
    /// thrust : array_like (m,) or (N, m)
    ///     Thrust per thruster, N; saturates at its limits. [HC eq. 25] For thrusters with dynamics it is the command, which
    ///     each thrust follows with its lag: exact at the ends of every step of `dt` and in its mean, a parabola within it.
    /// wrench : array_like (6,) or (N, 6)
    ///     Wrench on the vehicle [f; m] in body axes at its origin, N and N m; in addition to the thrust, without limits.
    /// joint_torque : array_like (n,) or (N, n)
    ///     Actuator torque along +q, N m or N; saturates, together with the servo's, at the joint's effort.
    /// joint_target : array_like (n,), (N, n) or (N, n, k), k <= 4
    ///     Turns on the joint servos, which are evaluated at every stage: target coordinates, rad or m; or polynomials
    ///     c0 + c1 t + c2 t^2 + c3 t^3 in the time t since this call, whose derivative is the target of the joint rate.
    ///     Prescribed joints (`prescribed_joints`) have exactly these coordinates, rates and accelerations, from the first
    ///     step of the call on; without targets their rates stay constant. `joint_torques` returns the torques of their drives.
    /// external : array_like (n + 1, 6) or (N, n + 1, 6)
    ///     Wrench on each moving body, vehicle first, in body axes at its frame origin, N and N m.
    /// pose_target : (array_like (3,) or (N, 3), array_like (3, 3) or (N, 3, 3)) or array_like (4, 4) or (N, 4, 4)
    ///     Target of the vehicle's servo, the PD of [HC sec. 5.2], which is on where it is given: the tuple (position,
    ///     rotation) in the world, m, or the pose. Evaluated at every stage: F = -kp e - kd V with the absolute body twist
    ///     V and the pose error e = [R^T (r - r_d); vee(R_d^T R - R^T R_d) / 2], m and rad (attitude error "vee": the sine
    ///     of the angle, about its axis; 0 again at half a turn). The controller `PD` acts once per control period on
    ///     observations, whose attitude error is log(R_d^T R) (attitude error "log": the angle, about its axis). They
    ///     differ by about a sixth of the cube of the angle.
    /// fin : array_like (k,) or (N, k)
    ///     Deflection per fin, rad; saturates at its limits. Without it, the scene's deflections.
    /// substeps : int
    ///     Number of steps of `dt`.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     Wrong shape, number that is not finite, or `pose_target` for a scene without vehicle servo.
    /// TypeError
    ///     Input that is not an array of real numbers.
    ///
    /// Warns
    /// -----
    /// StepWarning
    ///     Once per simulator before the first step with servos for which `dt` is unstable in a mode of the scene (see
    ///     `modes`); and once for each of these causes, after the first call with such instances, with their number: `stiffness`
    ///     beyond 2.0 for order 4, 1.6 for "mk3", 1.2 for "mk2", or `step_error` beyond 0.05 (left out where the errors of all instances
    ///     are followed); an accumulated error beyond 2 % of the motion (`relative` of `error_estimate`) of an instance that is
    ///     followed: see the option `error_estimate`; a state that is infinite or NaN.
    #[pyo3(signature = (*, substeps=None, **inputs), text_signature = "($self, *, substeps=1, **inputs)")]
    fn step(slf: &Bound<'_, Self>, substeps: Given, inputs: Option<Keywords>) -> PyResult<()> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        let inner = &mut this.inner;
        let given = StepInputs::read(inner, inputs)?;
        let inputs = given.inputs();
        let substeps = substeps.map_or(Ok(1), |n| count("substeps", n))?;
        let servos = Servos { joints: inputs.joint_target.is_some(), vehicle: inputs.pose_target.is_some() };
        warn(py, inner.warn_of_step(servos))?;
        let mut interrupt = Ok(());
        let mut go_on = || {
            interrupt = Python::attach(|py| py.check_signals());
            interrupt.is_ok()
        };
        detached(py, || inner.step_while(&inputs, substeps, &mut go_on))?.or_raise()?;
        interrupt?;
        std::iter::from_fn(|| inner.warn_of_motion()).try_for_each(|warning| warn(py, Some(warning)))
    }

    /// Forward dynamics by the articulated-body algorithm: accelerations [V'; q''] under the inputs of `step` (StepInputs). The
    /// state is unchanged. [RF08 ch. 7]
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6 + n)
    ///     Rate of the absolute body twist and of the joint rates, m/s2 and rad/s2. V' = 0 for a fixed
    ///     vehicle.
    #[pyo3(signature = (**inputs))]
    fn forward_dynamics<'py>(slf: &Bound<'py, Self>, inputs: Option<Keywords>) -> PyResult<Array<'py>> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        let given = StepInputs::read(&this.inner, inputs)?;
        let accelerations = detached(py, || this.inner.forward_dynamics(&given.inputs()))?.or_raise()?;
        array(py, &[this.inner.instances(), 6 + this.inner.joints()], accelerations)
    }
}
