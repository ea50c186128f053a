"""Classical feedback by the scene's nominal model: restoring, disturbance observer, computed torque, MPC."""

from typing import Any, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym import _core
from uvms_gym.controllers.base import Controller, options_of, remade
from uvms_gym.envs._options import Options, native

Floats = NDArray[np.float64]

#: Where a state holds the disturbance: what stays of it, and what comes and goes.
_DRIFT, _WAVE = slice(13, 19), slice(25, 31)


class PDRestoring(Controller):
    """`PD` less the weight and buoyancy of the whole system, `F = -kp e - kd V - f_g`.

    f_g is that of vehicle, arm and payload as the scene has them, at the measured attitude and joint coordinates.
    Targets are level, so that the attitude error alone tells the direction of gravity.

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        As `PD` has it.
    kp, kd : array_like (6,) or None
        As `PD` has them.
    **options
        Without `env`: arguments of `StationKeepEnv`, of which `scene` and `action` matter.

    Raises
    ------
    ValueError
        The scene has no gains and none are given, or a gain is negative or not finite.
    TypeError
        `env` is something else, or options are given besides.
    """

    policy: _core.Pd

    def __init__(
        self, env: Any = None, *, kp: ArrayLike | None = None, kd: ArrayLike | None = None, **options: Unpack[Options]
    ) -> None:
        self._options = options_of(type(self).__name__, env, options)
        self.policy = native(self._options).pd_restoring(_floats("kp", kp, 6), _floats("kd", kd, 6))

    @property
    def kp(self) -> Floats:
        """Proportional gains (6,), N/m and N m/rad."""
        return np.array(self.policy.kp)

    @property
    def kd(self) -> Floats:
        """Derivative gains (6,), N s/m and N m s/rad."""
        return np.array(self.policy.kd)

    def __reduce__(self) -> Any:
        return remade, (type(self), self._options, {"kp": self.kp, "kd": self.kd})


class _Observing(Controller):
    """What controllers with an observer have in common."""

    policy: _core.ModelControl | _core.Mpc
    _options: Options
    #: Names of its gains.
    _names: tuple[str, ...]

    @property
    def observer(self) -> Floats:
        """Bandwidth of the observer (2,), linear and angular, rad/s."""
        return np.array(self.policy.observer)

    @property
    def waves(self) -> Floats:
        """Deviation of accelerations that come and go (2,), m/s2 and rad/s2."""
        return np.array(self.policy.waves)

    @property
    def frequency(self) -> float:
        """Their angular frequency, rad/s."""
        return self.policy.frequency

    @property
    def jolts(self) -> Floats:
        """White noise on accelerations (2,), m/s2 and rad/s2 times the root of a second."""
        return np.array(self.policy.jolts)

    @property
    def delay(self) -> int:
        """Age of measurements that is compensated, control periods."""
        return self.policy.delay

    def disturbance(self, state: ArrayLike) -> Floats:
        """Wrench that the model does not explain, (6,) or (n, 6), N and N m, body axes, as a state of `predict` tells.

        It is that of the instant when the latest measurements were made.
        """
        memory = np.asarray(state, dtype=np.float64)
        if memory.ndim not in (1, 2) or memory.shape[-1] != self.policy.widths[1]:
            raise ValueError(f"state has shape {memory.shape}, but must have (n, {self.policy.widths[1]})")
        return memory[..., _DRIFT] + memory[..., _WAVE]

    def __reduce__(self) -> Any:
        return remade, (type(self), self._options, {name: getattr(self, name) for name in self._names})


def _task(controller: str, env: Any, options: Options) -> tuple[_core.Task, Options]:
    """Task of the options, and those that matter once the delay of its sensors is known."""
    given = options_of(controller, env, options, "disturbance")
    task = native(given)
    given.pop("disturbance", None)
    return task, given


class _ModelControl(_Observing):
    """Feedback on an observer's estimate."""

    policy: _core.ModelControl
    _law: Literal["disturbance", "computed-torque"]
    _names = ("kp", "kd", "observer", "waves", "frequency", "jolts", "delay", "lead")

    def __init__(
        self,
        env: Any = None,
        *,
        kp: ArrayLike | None = None,
        kd: ArrayLike | None = None,
        observer: ArrayLike | None = None,
        waves: ArrayLike | None = None,
        frequency: float | None = None,
        jolts: ArrayLike | None = None,
        delay: int | None = None,
        lead: float | None = None,
        **options: Unpack[Options],
    ) -> None:
        task, self._options = _task(type(self).__name__, env, options)
        self.policy = task.model_control(
            self._law,
            kp=_floats("kp", kp, 6),
            kd=_floats("kd", kd, 6),
            observer=_floats("observer", observer, 2),
            waves=_floats("waves", waves, 2),
            frequency=frequency,
            jolts=_floats("jolts", jolts, 2),
            delay=delay,
            lead=lead,
        )

    @property
    def kp(self) -> Floats:
        """Proportional gains (6,)."""
        return np.array(self.policy.kp)

    @property
    def kd(self) -> Floats:
        """Derivative gains (6,)."""
        return np.array(self.policy.kd)

    @property
    def lead(self) -> float:
        """Time beyond the present that is predicted, s."""
        return self.policy.lead


class DOB(_ModelControl):
    """PD with a disturbance observer, `F = -kp e - kd V - f(e, V, q) - d`.

    The observer predicts the momentum h of vehicle and arm, rigid and added, by the scene's nominal model:
    `h' = f + F + d - V x* h` with weight, buoyancy and drag f in still water and the wrench F that the controller's own
    actions gave, within the thrusters' limits and through their lag. What h differs by from one measurement to the next
    is the disturbance's, `d += (1 - exp(-observer T)) (h - h_predicted) / T`, and is compensated as f is.

    With `waves` or `jolts` a steady Kalman filter weighs pose and velocity measurements (deviations 5 mm, 5 mrad,
    0.01 m/s and 0.01 rad/s) against the prediction, and tells what stays of the disturbance from
    what comes and goes.

    It remembers its estimate and its latest actions; without a state, every call of `predict` is an episode's first.

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        As `PD` has it; it tells the control period, the thrusters' lag and the age of measurements, too.
    kp, kd : array_like (6,) or None
        As `PD` has them.
    observer : array_like (2,) or None
        Bandwidth, linear and angular, rad/s; 0: no observer. 2 by default.
    waves : array_like (2,) or None
        Deviation of disturbing accelerations that come and go, m/s2 and rad/s2. 0 by default.
    frequency : float or None
        Their angular frequency, rad/s. 1.1 by default.
    jolts : array_like (2,) or None
        White noise on accelerations, m/s2 and rad/s2 times the root of a second. 0 by default.
    delay : int or None
        Age of measurements in control periods, which is compensated: the observer is then as late as these are, and the
        model goes on from there to the present, with the actions since. 0 by default; None: what sensors have in the
        environment.
    lead : float or None
        Time for which the model goes on beyond the present before the feedback, s: what thrusters lag. 0 by default.
    **options
        Without `env`: arguments of `StationKeepEnv`, of which `scene`, `action`, `dt`, `substeps`, `thruster_lag` and
        the delay of `disturbance` matter.

    Raises
    ------
    ValueError
        The scene has no gains and none are given, or a gain is negative or not finite.
    TypeError
        `env` is something else, or options are given besides.
    """

    _law = "disturbance"

    def __init__(self, env: Any = None, *, delay: int | None = 0, **arguments: Any) -> None:
        super().__init__(env, delay=delay, **arguments)


class ComputedTorque(_ModelControl):
    """Computed torque: the model's inverse dynamics of vehicle and arm, with the observer of `DOB`.

    `F = M a + (h(q+, q'+) - h(q, q')) / T + V x* h - f - d` with `a = -kp e - kd V`: the composite inertia M as the arm
    stands, the momentum h that the arm's references for the next control instant bring, weight, buoyancy and drag f of
    the scene's nominal model in still water, and the disturbance d that is observed. [HC eq. 13]

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        As `DOB` has it.
    kp, kd : array_like (6,) or None
        Gains per body axis, 1/s2 and 1/s. Where None: the scene's own, over the diagonal of M at home.
    observer, waves, frequency, jolts, lead
        As `DOB` has them.
    delay : int or None
        As `DOB` has it; None, what sensors have in the environment, by default.
    **options
        As `DOB` has them.

    Raises
    ------
    ValueError, TypeError
        As `DOB` has them.
    """

    _law = "computed-torque"


class MPC(_Observing):
    """Linear model-predictive control, with the observer of `DOB`.

    Of all plans of the wrench over the next 15 control periods, held over 1, 2, 4 and 8 of them, it takes the one
    that costs least within the thrusters' limits: squares of pose errors (1 rad for 0.5 m), of velocities, of the
    wrench that is not needed against what disturbs (over its limits) and of its changes; beyond the plan as linear
    feedback would. The model is linear: nominal inertia with the arm at home, and thrusters through their lag;
    forces and the disturbance are those of the present, from which waves go on. Where the plan without limits keeps
    within them it is the best; else a quadratic program tells (Clarabel).

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        As `DOB` has it.
    velocity : array_like (2,) or None
        Weights on velocities, linear and angular, s2. 0.02 by default.
    effort, change : array_like (2,) or None
        Weights on wrenches over their limits, forces and moments, and on their changes from one move to the next, m2.
    observer, waves, frequency, jolts
        As `DOB` has them.
    delay : int or None
        As `DOB` has it; None, what sensors have in the environment, by default.
    **options
        As `DOB` has them.

    Raises
    ------
    ValueError, TypeError
        As `DOB` has them.
    """

    policy: _core.Mpc
    _names = ("velocity", "effort", "change", "observer", "waves", "frequency", "jolts", "delay")

    def __init__(
        self,
        env: Any = None,
        *,
        velocity: ArrayLike | None = None,
        effort: ArrayLike | None = None,
        change: ArrayLike | None = None,
        observer: ArrayLike | None = None,
        waves: ArrayLike | None = None,
        frequency: float | None = None,
        jolts: ArrayLike | None = None,
        delay: int | None = None,
        **options: Unpack[Options],
    ) -> None:
        task, self._options = _task(type(self).__name__, env, options)
        self.policy = task.mpc(
            velocity=_floats("velocity", velocity, 2),
            effort=_floats("effort", effort, 2),
            change=_floats("change", change, 2),
            observer=_floats("observer", observer, 2),
            waves=_floats("waves", waves, 2),
            frequency=frequency,
            jolts=_floats("jolts", jolts, 2),
            delay=delay,
        )

    @property
    def velocity(self) -> Floats:
        """Weights on velocities (2,), s2."""
        return np.array(self.policy.velocity)

    @property
    def effort(self) -> Floats:
        """Weights on wrenches (2,), m2."""
        return np.array(self.policy.effort)

    @property
    def change(self) -> Floats:
        """Weights on their changes (2,), m2."""
        return np.array(self.policy.change)


def _floats(name: str, given: ArrayLike | None, length: int) -> list[float] | None:
    if given is None:
        return None
    numbers = np.asarray(given, dtype=np.float64)
    if numbers.shape != (length,):
        raise ValueError(f"{name} has shape {numbers.shape}, but must have ({length},)")
    return [float(number) for number in numbers]
