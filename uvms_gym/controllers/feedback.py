"""Classical feedback: PD, PID, and none."""

from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym import _core
from uvms_gym.controllers.base import Controller, options_of, remade
from uvms_gym.envs._options import Options, native

Floats = NDArray[np.float64]


class NoControl(Controller):
    """No control: every action is 0.

    Parameters
    ----------
    env, **options
        As `PD` has them.
    """

    def __init__(self, env: Any = None, **options: Unpack[Options]) -> None:
        self._options = options_of(type(self).__name__, env, options)
        self.policy = native(self._options).no_control()

    def __reduce__(self) -> Any:
        return remade, (type(self), self._options, {})


class PD(Controller):
    """The paper's PD on the vehicle, `F = -kp e - kd V`, from observations alone.

    [HC sec. 5.2] It reads the pose error e (body axes; attitude error "log": the rotation vector) and the body twist V;
    the arm is held by its own servos. `Simulator.step(pose_target=...)` evaluates the same law at every stage, with the
    attitude error "vee": `vee(R_d^T R - R^T R_d) / 2`, the sine of the angle. The wrench is turned into an action of the environment's kind, clipped to [-1, 1].

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        A `UVMS-StationKeep` environment that tells scene and kind of action; wrappers do not matter, but those that
        change observations or actions change what the PD would read and say.
    kp, kd : array_like (6,) or None
        Gains per body axis [x, y, z, roll, pitch, yaw], N/m, N m/rad and N s/m, N m s/rad; the scene's own where None.
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
        self.policy = native(self._options).pd(_gains(kp), _gains(kd))

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


class PID(Controller):
    """`PD` with an integral of the pose error, `F = -kp e - kd V - ki z` with `z' = e`.

    The integral takes out what a current or a weight leaves of the error. It is the controller's state, which `predict`
    takes and gives back: without it, every call is the first of an episode. Against windup it waits on every axis whose
    wrench the thrusters do not reach, for as long as the error would drive it further that way.

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        As `PD` has it; it tells the control period, too.
    kp, kd : array_like (6,) or None
        As `PD` has them.
    ki : array_like (6,) or None
        Integral gains, N/(m s) and N m/(rad s). Where None, from the others by T_i = 2 T_d: `ki = kp**2 / (2 kd)`.
        (On a critically damped PD the slowest poles then have a damping ratio of 0.69.)
    **options
        Without `env`: arguments of `StationKeepEnv`, of which `scene`, `action`, `dt` and `substeps` matter.

    Raises
    ------
    ValueError
        The scene has no gains and none are given, or a gain is negative or not finite.
    TypeError
        `env` is something else, or options are given besides.
    """

    policy: _core.Pid

    def __init__(
        self,
        env: Any = None,
        *,
        kp: ArrayLike | None = None,
        kd: ArrayLike | None = None,
        ki: ArrayLike | None = None,
        **options: Unpack[Options],
    ) -> None:
        self._options = options_of(type(self).__name__, env, options)
        self.policy = native(self._options).pid(_gains(kp), _gains(kd), _gains(ki))

    @property
    def kp(self) -> Floats:
        """Proportional gains (6,), N/m and N m/rad."""
        return np.array(self.policy.kp)

    @property
    def kd(self) -> Floats:
        """Derivative gains (6,), N s/m and N m s/rad."""
        return np.array(self.policy.kd)

    @property
    def ki(self) -> Floats:
        """Integral gains (6,), N/(m s) and N m/(rad s)."""
        return np.array(self.policy.ki)

    def __reduce__(self) -> Any:
        return remade, (type(self), self._options, {"kp": self.kp, "kd": self.kd, "ki": self.ki})


def _gains(given: ArrayLike | None) -> list[float] | None:
    if given is None:
        return None
    gains = np.asarray(given, dtype=np.float64)
    if gains.shape != (6,):
        raise ValueError(f"gains have shape {gains.shape}, but must have (6,)")
    return [float(gain) for gain in gains]
