"""Control with the scene's nominal model: disturbance observers, computed torque, MPC, NMPC, resolved motion."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym.controllers.base import ClassicalController


def _part(controller: ClassicalController, state: ArrayLike, name: str) -> NDArray[np.float64]:
    """Part (..., k) of a state (m,) or (n, m) of `predict`, by its name in the memory's layout."""
    memory, width = np.asarray(state, dtype=np.float64), controller.native.widths[1]
    if memory.ndim not in (1, 2) or memory.shape[-1] != width:
        raise ValueError(f"state has shape {memory.shape}, but must have (n, {width})")
    return memory[..., controller.memory_layout[name]]


class ModelBased(ClassicalController):
    """Base class of controllers with a disturbance observer."""

    def disturbance(self, state: ArrayLike) -> NDArray[np.float64]:
        """Disturbing wrench in a state of `predict`, (6,) or (n, 6), N and N m, body axes.

        It is the wrench that the model does not explain, at the instant of the latest measurements.

        Raises
        ------
        ValueError
            A state of another shape.
        """
        return _part(self, state, "slow_disturbance") + _part(self, state, "wave_disturbance")


class FaultTolerant(ClassicalController):
    """Base class of controllers that may look for a lost thruster: see `DOB`."""

    def lost_thruster(self, state: ArrayLike) -> NDArray[np.int64]:
        """Index (...,) of the thruster that counts as lost in a state (..., m) of `predict`; -1: none.

        Raises
        ------
        ValueError
            A state of another shape, or a controller that looks for none.
        """
        return self._of_fault(state, "lost_thruster").astype(np.int64) - 1

    def alarms(self, state: ArrayLike) -> NDArray[np.int64]:
        """Number (...,) of times that a thruster was found to be lost in the episode so far; errors as above."""
        return self._of_fault(state, "alarms").astype(np.int64)

    def _of_fault(self, state: ArrayLike, name: str) -> NDArray[np.float64]:
        if name not in self.memory_layout:
            raise ValueError(f"{type(self).__name__} looks for no lost thruster: give fault_threshold")
        return _part(self, state, name)[..., 0]


class DOB(FaultTolerant, ModelBased):
    """PD with a disturbance observer, `F = -kp e - kd V - f(e, V, q) - d`.

    The observer predicts the momentum h of vehicle and arm, rigid and added, by the scene's nominal model:
    `h' = f + F + d - V x* h` with weight, buoyancy and damping f in still water and the wrench F of the controller's
    own actions, within the thrusters' limits and through their lag. The innovation of h from one measurement to the
    next is attributed to the disturbance, `d += (1 - exp(-w T)) (h - h_predicted) / T` at a bandwidth w, and d is
    compensated as f is.

    With `wave_acceleration` or `acceleration_noise` a steady Kalman filter weighs pose and velocity measurements
    (standard deviations 5 mm, 5 mrad, 0.01 m/s and 0.01 rad/s) against the prediction, and separates the slow part of
    the disturbance from its wave part.

    The estimate and the latest actions are its state; without it, every call of `predict` counts as an episode's first.

    With `fault_threshold` it looks for a thruster that has lost thrust, by the generalised likelihood ratio [WJ76]:
    slow observers without a fault and without each thruster predict the measurements, and the lost share of greatest
    likelihood is a regression of the innovations on the differences between their predictions, together with a common
    factor on all thrusts. From then on the observer knows of the lost share, and the thrusters are asked for what has
    the wanted effect without it. Where one is dead that the others cannot replace, they come closest to the wanted
    wrench, and it is tried by 15 % of its thrust, so that a false alarm ends. `lost_thruster` and `alarms` tell of it.
    A single fault is assumed.

    Parameters
    ----------
    env, **options
        As in `PD`; `dt`, `substeps`, `thruster_lag` and the delay of `disturbance` matter, too.
    kp, kd : array_like (6,) or None
        Gains of `PD`.
    observer_bandwidth : array_like (2,) or None
        Bandwidth, linear and angular, rad/s; 0: no observer. 2 by default.
    wave_acceleration : array_like (2,) or None
        Standard deviation of wave accelerations, m/s2 and rad/s2. 0 by default.
    wave_frequency : float or None
        Angular frequency of the waves, rad/s. 1 by default.
    acceleration_noise : array_like (2,) or None
        White noise on accelerations, m/s2 and rad/s2 times the root of a second. 0 by default.
    delay : int or None
        Age of measurements in control periods, which is compensated: the observer works at the instant of the
        measurements, and the model predicts from there to the present, with the actions since. 0 to 100; None: the age
        in the environment's sensors. 0 by default.
    prediction_horizon : float or None
        Time beyond the present for which the model predicts before the feedback, s, at most 10: the thrusters' lag. 0
        by default.
    fault_threshold : float or None
        Log-likelihood ratio from which a thruster counts as lost; 0: none is looked for. 0 by default.
    fault_loss : float or None
        Minimum share of its thrust that a lost thruster has lost. 0.6 by default.
    fault_memory : float or None
        Time constant of forgetting, s; 0: nothing is forgotten. 1 by default.
    """

    kind = "dob"


class MultipleModel(ClassicalController):
    """Base class of controllers on a bank of models, weighed by the likelihood of their innovations. [Mag65]"""

    def probabilities(self, state: ArrayLike) -> NDArray[np.float64]:
        """Probabilities (..., delay + 1, 3) of the models in a state (..., m) of `predict`: delays, thrust factors.

        Raises
        ------
        ValueError
            A state of another shape.
        """
        weights = np.exp(_part(self, state, "log_weights"))
        weights /= weights.sum(axis=-1, keepdims=True)
        return weights.reshape(*weights.shape[:-1], -1, 3)


class AdaptiveDOB(MultipleModel):
    """DOBs on a bank of models, weighed by the likelihood of their innovations. [Mag65]

    The models differ in the measurements' delay, 0 to `delay` control periods, and in a factor b on the thrust, which
    stands for thrust over inertia. Each has an observer of `DOB` under b times the commanded wrench. The log-likelihood
    of its innovations fades with `memory_time`, `l = exp(-T / memory_time) l - sum (innovation / deviation)^2 / 2`:
    innovations of the vehicle's twist, which depend on the thrust, and of the joints about their references. These
    references are not delayed, so that the joints show the delay. The wrench is the mean of the models' `F / b` by
    their weights `exp(l)`.

    Gains of feedback decrease with a model's delay, `kp / (1 + a[0] tau)` and `kd / (1 + a[1] tau)` with `a` for
    `delay_schedule`. Weights are equal until all models have predicted a measurement. A
    control period costs what as many DOBs as models cost.

    Parameters
    ----------
    env, **options
        As in `PD`; `dt`, `substeps`, `thruster_lag` and the delay of `disturbance` matter, too.
    kp, kd : array_like (6,) or None
        Gains of `PD`.
    observer_bandwidth, wave_acceleration, wave_frequency, acceleration_noise, prediction_horizon
        Meaning as in `DOB`, for all models.
    delay : int or None
        Maximum delay of the bank, control periods, 0 to 10. By default the maximum of the environment's sensors.
    delay_schedule : array_like (2,) or None
        Decrease of `kp` and `kd` with the delay, 1/s. 3 and 1 by default.
    thrust_factors : array_like (3,) or None
        Factors on the thrust, above 0. 0.5, 1 and 2 by default.
    innovation : array_like (2,) or None
        Standard deviation of innovations of the twist, m/s and rad/s, above 0. 0.1 and 0.2 by default.
    joint_innovation : array_like (2,) or None
        Standard deviation of joint coordinates (rad or m) and rates about their references, above 0. 0.01 and 0.05 by
        default.
    memory_time : float or None
        Time constant of forgetting, s; 0: nothing is forgotten. 10 by default.
    """

    kind = "dob-adaptive"


class ComputedTorque(ModelBased):
    """Computed torque: the model's inverse dynamics of vehicle and arm, with the observer of `DOB`. [HC eq. 13]

    `F = M a + (h(q+, q'+) - h(q, q')) / T + V x* h - f - d` with `a = -kp e - kd V`: the composite inertia M at the
    arm's position, the momentum h at the arm's references for the next control instant, weight, buoyancy and damping f
    of the scene's nominal model in still water, and the observed disturbance d.

    Parameters
    ----------
    env, **options
        As in `PD`; `dt`, `substeps`, `thruster_lag` and the delay of `disturbance` matter, too.
    kp, kd : array_like (6,) or None
        Gains per body axis, 1/s2 and 1/s. Where None: the scene's, over the diagonal of M at home.
    observer_bandwidth
        Meaning as in `DOB`; 8 by default.
    wave_acceleration
        Meaning as in `DOB`; 0.3 by default.
    acceleration_noise
        Meaning as in `DOB`; (0.05, 0.3) by default.
    wave_frequency, prediction_horizon
        Meaning as in `DOB`.
    delay
        Meaning as in `DOB`; the age in the environment's sensors by default.
    """

    kind = "computed-torque"


class MPC(FaultTolerant, ModelBased):
    """Linear model-predictive control, with the observer of `DOB`.

    It plans the thrusts over the next 15 control periods, constant over 1, 2, 4 and 8 of them, at minimum cost within
    their limits: squares of pose errors (1 rad as 0.5 m), of velocities, of the wrench beyond the compensation of
    disturbances (over its limits) and of its changes; beyond the plan, the cost of linear feedback. The model is
    linear: nominal inertia with the arm at home, and thrusters through their lag; forces and the disturbance have their
    present values, waves continue. A plan without limits that is within them is optimal; otherwise a quadratic program
    with bounds is solved.

    Parameters
    ----------
    env, **options
        As in `PD`; `dt`, `substeps`, `thruster_lag` and the delay of `disturbance` matter, too.
    velocity : array_like (2,) or None
        Weights on velocities, linear and angular, s2. 0.02 by default.
    effort, change : array_like (2,) or None
        Weights on wrenches over their limits, forces and moments, and on their changes from one move to the next, m2.
        (0.03, 0.06) and (0.01, 0.02) by default.
    observer_bandwidth, wave_acceleration, wave_frequency, acceleration_noise, delay
        Meaning as in `ComputedTorque`.
    fault_threshold, fault_loss, fault_memory
        Meaning as in `DOB`.
    """

    kind = "mpc"


class NMPC(FaultTolerant):
    """Nonlinear model-predictive control of both tasks, by real-time iterations. [Die02]

    It plans over the next control periods by the scene's nominal model in still water, with the estimated disturbance:
    thrusts over 8 periods in station keeping, while servos move the arm along its reference, and thrusts and joint
    torques over 10 periods in end-effector tracking, along the reference's points ahead. The cost sums the squares of
    pose errors (1 rad as 0.5 m), of velocities, and, over their limits, of the efforts beyond the compensation of the
    model's forces and of disturbances, and of the change of the thrusters' wrench. Beyond the plan, station keeping has
    the cost of linear feedback, tracking five times the last pose error.

    In each period the plan before, without its first inputs, is improved by one Gauss-Newton step within the bounds of
    thrusts and torques: a motion of the nonlinear model, its derivatives at the present state for all periods, a
    quadratic program and a line search. A backward pass as in `optimize_trajectory` solves the program where no bound
    is active, otherwise a projected Newton method on all inputs. The plan is part of the controller's state.

    The present is predicted from delayed measurements, and the disturbance estimated, as by `DOB` in station keeping,
    where waves continue, and as by `ResolvedMotion` in tracking.

    Parameters
    ----------
    env, **options
        As in `PD`, also of `UVMS-EETrack`; `dt`, `substeps`, `preview`, `thruster_lag`, `end_effector` and the delay of
        `disturbance` matter, too. A delay beyond 10 is a `ValueError`.
    velocity : array_like (3,) or None
        Weights on velocities: linear, angular and, in tracking, of joints, s2. 0.02 by default, in tracking
        (0.05, 0.05, 0.01).
    effort : array_like (3,) or None
        Weights on efforts over their limits: forces, moments and, in tracking, joint torques, m2. (0.03, 0.06, 0.03) by
        default, in tracking (0.003, 0.003, 0.02).
    change : array_like (2,) or None
        Weights on the wrench minus the thrusters' present wrench, over its limits: forces and moments, m2.
        (0.01, 0.02) by default, in tracking 0.003.
    posture, levelling : float or None
        Weights on the distance of joints from home and on the vehicle's tilt, 1 rad as 0.5 m. 1e-6 and 0.01 by
        default. Tracking only.
    observer_bandwidth : array_like (3,) or None
        Bandwidths of the observer, rad/s: of forces, moments and, in tracking, torques on joints. 8 by default, in
        tracking (7, 7, 10).
    wave_acceleration, wave_frequency, acceleration_noise
        Meaning as in `ComputedTorque`; station keeping only.
    delay : int or None
        Age of measurements in control periods, which is compensated, 0 to 10. By default the age in the environment's
        sensors.
    fault_threshold, fault_loss, fault_memory
        Meaning as in `DOB`; station keeping only.
    """

    kind = "nmpc"
    tasks = ("station-keep", "ee-track")


class ResolvedMotion(ClassicalController):
    """Resolved motion and inverse dynamics for end effectors that follow a reference, from observations only. [Whi69]

    The end effector's commanded twist is the reference's less `pose_gain` times the pose error and its integral. A
    damped and weighted pseudo-inverse of its Jacobian distributes it among vehicle and joints; in its null space the
    arm returns home and the vehicle levels. Inverse dynamics of the scene's nominal model in still water turns the
    error of these velocities, and the reference's acceleration, into a wrench and torques.

    With `observer_bandwidth` the forces and torques that the nominal model lacks (currents, waves, a payload, other
    parameters) are estimated from the measured velocities under the actions, and compensated. With `delay` the
    controller acts on a prediction of the present from delayed measurements, by the same model and its own past
    actions. Both assume that actions are carried out as given, and need the controller's state.

    With `hold` one arm works while others hold still: each end effector that is held has its target where it is when
    the episode begins, and its Jacobian and its commanded twist, minus `pose_gain` times its pose error, are six
    further rows of the same pseudo-inverse. Where vehicle and joints cannot satisfy all rows, the errors are shared.
    Observations have no pose in the world, so the target is carried along relative to the reference, whose pose and
    twist are observed; this needs the controller's state.

    Parameters
    ----------
    env, **options
        As in `PD`, of `UVMS-EETrack`, `UVMS-Button` or `UVMS-Valve`; `dt`, `substeps`, `preview`, `thruster_lag`,
        `end_effector` and the delay of `disturbance` matter, too. Residual actions and a delay beyond 10 are each a
        `ValueError`.
    pose_gain : float or None
        Pose error to the commanded twist, 1/s. 2.5 by default.
    twist_gain, joint_gain : float or None
        Errors of the vehicle's twist and of the joints' rates to their accelerations, 1/s. 6 and 10 by default.
    posture_gain, levelling_gain : float or None
        Distance of the joints from home and tilt of the vehicle to their rates, 1/s. 0.5 by default.
    arm_weight : float or None
        Weight of the joints relative to the vehicle's: at 1 an arm of 1 m and the vehicle share a motion equally. 2 by
        default.
    lag_compensation : float or None
        Share of the thrusters' nominal lag over a period that is compensated; only with `observer_bandwidth` or
        `delay`. 0 by default.
    integral_gain : float or None
        Integral of the pose error, over `pose_gain`, 1/s. The integral pauses while actuators saturate and the error
        would drive it further. 0 by default.
    observer_bandwidth : array_like (3,) or None
        Bandwidths of the disturbance observer, rad/s: of forces and of moments on the vehicle, and of torques on
        joints; 0 estimates nothing there. 0 by default.
    compliance : float or None
        Displacement of the end effector by a force on it, m/N: the reference gives way to the force that explains the
        observer's disturbance of the joints' torques best. 0 by default.
    delay : int or None
        Age of measurements in control periods, which is compensated, 0 to 10; None: the age in the environment's
        sensors. 0 by default.
    hold : sequence of str or None
        Names of up to three further end effectors that are held still in the world while the one in use
        (`end_effector` of the environment) follows the reference. None by default.
    """

    kind = "resolved-motion"
    tasks = ("ee-track", "button", "valve")


class AdaptiveResolvedMotion(MultipleModel):
    """Resolved motion on a bank of models of delay and thrust, weighed by the likelihood of their innovations. [Mag65]

    The models differ in the measurements' delay, 0 to `delay` control periods, and in a factor b on the thrust, which
    stands for thrust over inertia. Each has an observer of `ResolvedMotion` under b times the commanded wrench. The
    log-likelihood of its innovations fades with `memory_time`, `l = exp(-T / memory_time) l - sum (innovation /
    deviation)^2 / 2`: innovations of the vehicle's twist, which depend on the thrust, and of the joints' rates, which
    depend on the delay. Wrench and torques are the means over the models by their weights `exp(l)`, wrenches divided by
    b. What the models lack, such as a payload's weight, is in their observers' disturbances of vehicle and joints.

    Gains of feedback may decrease with a model's delay, `pose_gain / (1 + a[0] tau)`, and `twist_gain` and `joint_gain`
    over `1 + a[1] tau`, with `a` for `delay_schedule`. Weights are equal until all models have predicted a measurement.

    All models take the mass matrix, the Jacobian and the bias force along the likeliest model's prediction, and models
    with a weight below a thousandth of the maximum do not count: a control period costs about two of `ResolvedMotion`.

    Parameters
    ----------
    env, **options
        As in `PD`, of `UVMS-EETrack`, `UVMS-Button` or `UVMS-Valve`; `dt`, `substeps`, `preview`, `thruster_lag`,
        `end_effector` and the delay of `disturbance` matter, too. Residual actions and a delay beyond 10 are each a
        `ValueError`.
    pose_gain, twist_gain, joint_gain, posture_gain, levelling_gain, arm_weight, lag_compensation, integral_gain, hold
        Meaning as in `ResolvedMotion`, for all models.
    observer_bandwidth : array_like (3,) or None
        Meaning as in `ResolvedMotion`; (4, 4, 8) by default.
    compliance : float or None
        Meaning as in `ResolvedMotion`.
    delay : int or None
        Maximum delay of the bank, control periods, 0 to 10. By default the maximum of the environment's sensors.
    delay_schedule : array_like (2,) or None
        Decrease of gains with the delay, 1/s. 0 by default.
    thrust_factors : array_like (3,) or None
        Factors on the thrust, above 0. 0.6, 1 and 1.6 by default.
    innovation : array_like (3,) or None
        Standard deviation of innovations of the vehicle's twist, linear and angular, m/s and rad/s, and of joint rates,
        rad/s or m/s, above 0. 0.1, 0.2 and 0.02 by default.
    memory_time : float or None
        Time constant of forgetting, s; 0: nothing is forgotten. 10 by default.
    """

    kind = "resolved-adaptive"
    tasks = ("ee-track", "button", "valve")
