"""Classical control of an end effector that follows a path."""

from typing import Any, Unpack

from uvms_gym import _core
from uvms_gym.controllers.base import Controller, options_of, remade
from uvms_gym.envs._base import Options, native


class ResolvedMotion(Controller):
    """Resolved motion and inverse dynamics for `UVMS-EETrack`, from observations alone.

    The end effector's commanded twist is the reference's less `error` times the pose error. A damped and weighted
    pseudo-inverse of its Jacobian shares it out among vehicle and joints; what the end effector does not feel of it
    pulls the arm home and the vehicle level. Inverse dynamics of the scene's nominal model in still water turns the
    error of these velocities, and the reference's acceleration, into a wrench and torques.

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        A `UVMS-EETrack` environment; wrappers do not matter, but those that change observations or actions do.
    error : float or None
        Of the pose error on the commanded twist, 1/s (2.5).
    vehicle, joint : float or None
        Of the errors of the vehicle's twist and of the joints' rates on their accelerations, 1/s (6 and 10).
    home, level : float or None
        Of the joints' distance from home and of the vehicle's tilt on their rates, 1/s (0.5 and 0.5).
    arm : float or None
        How readily joints move against the vehicle: an arm of length 1 m takes as much of a motion at 1 (2).
    **options
        Without `env`: arguments of `EETrackEnv`, of which those of the scene, the action and the observation matter.

    Raises
    ------
    ValueError
        Another task, actions that are corrections to it, or a gain that is negative or not finite.
    TypeError
        `env` is something else, or options are given besides.
    """

    policy: _core.ResolvedMotion

    def __init__(
        self,
        env: Any = None,
        *,
        error: float | None = None,
        vehicle: float | None = None,
        joint: float | None = None,
        home: float | None = None,
        level: float | None = None,
        arm: float | None = None,
        **options: Unpack[Options],
    ) -> None:
        if env is None:
            options = {"task": "ee-track", **options}
        self._options = options_of(type(self).__name__, env, options)
        self.policy = native(self._options).resolved_motion(
            error=error, vehicle=vehicle, joint=joint, home=home, level=level, arm=arm
        )

    @property
    def gains(self) -> dict[str, float]:
        """Gains by name, 1/s but for `arm`."""
        return self.policy.gains

    def __reduce__(self) -> Any:
        return remade, (type(self), self._options, self.gains)
