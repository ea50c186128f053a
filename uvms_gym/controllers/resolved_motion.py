"""Classical control of an end effector that follows a path."""

from collections.abc import Sequence
from typing import Any, Unpack

from uvms_gym import _core
from uvms_gym.controllers.base import Controller, options_of, remade
from uvms_gym.envs._options import Options, native


class ResolvedMotion(Controller):
    """Resolved motion and inverse dynamics for `UVMS-EETrack`, from observations alone.

    The end effector's commanded twist is the reference's less `error` times the pose error and its integral. A damped
    and weighted pseudo-inverse of its Jacobian shares it out among vehicle and joints; what the end effector does not
    feel of it pulls the arm home and the vehicle level. Inverse dynamics of the scene's nominal model in still water
    turns the error of these velocities, and the reference's acceleration, into a wrench and torques.

    With `observer` the forces and torques that the nominal model does not know of (currents, waves, a payload, other
    parameters) are estimated from how the velocities went under the actions, and made up for. With `delay` the
    controller acts on a prediction of the present, by the same model and its own past actions, from what was measured
    so many periods ago. Both need to know that actions are carried out as given, and remember.

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
    lead : float
        Share of the thrusters' nominal lag over a period that is made up for; only with `observer` or `delay`.
    integral : float
        Of the integral of the pose error, against the error itself, 1/s. The integral waits while actuators saturate
        and the error would drive it further.
    observer : sequence of 3 float
        Bandwidths of the disturbance observer, rad/s: of forces and of moments on the vehicle, and of torques on
        joints. An entry of 0 estimates nothing there.
    delay : int
        Control periods by which measurements are late, 0 to 10.
    **options
        Without `env`: arguments of `EETrackEnv`, of which those of the scene, the action and the observation matter.

    Raises
    ------
    ValueError
        Another task, actions that are corrections to it, a gain that is negative or not finite, or a delay beyond 10.
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
        lead: float = 0.0,
        integral: float = 0.0,
        observer: Sequence[float] = (0.0, 0.0, 0.0),
        delay: int = 0,
        **options: Unpack[Options],
    ) -> None:
        if env is None:
            options = {"task": "ee-track", **options}
        self._options = options_of(type(self).__name__, env, options)
        self.policy = native(self._options).resolved_motion(
            error=error,
            vehicle=vehicle,
            joint=joint,
            home=home,
            level=level,
            arm=arm,
            lead=lead,
            integral=integral,
            observer=list(observer),
            delay=delay,
        )

    @property
    def gains(self) -> dict[str, Any]:
        """Gains by name: the arguments that make it again."""
        return self.policy.gains

    def __reduce__(self) -> Any:
        return remade, (type(self), self._options, self.gains)
