"""Classical feedback: PD, PID, PD with restoring compensation, PD for docking, and zero action."""

from uvms_gym import _core
from uvms_gym.controllers.base import ClassicalController


class NoControl(ClassicalController):
    """Zero action.

    Parameters
    ----------
    env, **options
        As in `PD`, of any task.
    """

    kind = "none"
    tasks = tuple(dict(_core.tasks()))


class PD(ClassicalController):
    """PD on the vehicle, `F = -kp e - kd V`, from observations only. [HC sec. 5.2]

    It reads the pose error e (body axes; attitude error "log": the rotation vector) and the body twist V; the arm's
    servos hold the arm. The wrench becomes an action of the environment's kind, clipped to [-1, 1].
    `Simulator.step(pose_target=...)` evaluates the same law at every stage, with the attitude error "vee":
    `vee(R_d^T R - R^T R_d) / 2`, the sine of the angle.

    `PD(env)` has the scene's gains; `uvms_gym.make_controller("pd", env)` has the tuned ones that the package ships.

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        A `UVMS-StationKeep` environment: it determines the scene and the kind of action. Wrappers are looked through;
        those that change observations or actions invalidate the controller.
    kp, kd : array_like (6,) or None
        Gains per body axis [x, y, z, roll, pitch, yaw], N/m, N m/rad and N s/m, N m s/rad; the scene's where None.
    **options
        Without `env`: arguments of `StationKeepEnv`, of which `scene` and `action` matter.

    Raises
    ------
    ValueError
        The scene has no gains and none are given, or a gain is negative, not finite or of another shape.
    TypeError
        `env` is something else, options are given besides, or an argument is unknown.
    """

    kind = "pd"


class PID(ClassicalController):
    """`PD` with an integral of the pose error, `F = -kp e - kd V - ki z` with `z' = e`.

    The integral removes the steady-state offset under a current or a weight. It is the controller's state, which
    `predict` takes and returns: without it, every call counts as an episode's first. Against windup it pauses on every
    axis whose wrench the thrusters do not reach, for as long as the error would drive it further that way.

    Parameters
    ----------
    env, **options
        As in `PD`; `dt` and `substeps` matter, too.
    kp, kd : array_like (6,) or None
        Gains of `PD`.
    ki : array_like (6,) or None
        Integral gains, N/(m s) and N m/(rad s). Where None, from the others by T_i = 2 T_d: `ki = kp**2 / (2 kd)`.
        (On a critically damped PD the slowest poles then have a damping ratio of 0.69.)
    """

    kind = "pid"


class PDRestoring(ClassicalController):
    """`PD` minus the weight and buoyancy of the system, `F = -kp e - kd V - f_g`.

    f_g is the weight and buoyancy of the scene's vehicle, arm and payload at the measured attitude and joint angles.
    Targets are level, so that the attitude error gives the direction of gravity.

    Parameters
    ----------
    env, **options
        As in `PD`.
    kp, kd : array_like (6,) or None
        Gains of `PD`.
    """

    kind = "pd-restoring"


class DockPD(ClassicalController):
    """PD for `UVMS-Dock` with a limited approach speed, `F = -kp sat(e) - kd V_r`, from observations only.

    It reads the pose error and the twist V_r relative to the dock, which feeds the dock's velocity forward. `sat`
    scales the linear and the angular part of e down together where the velocity at which both terms balance,
    `-kp e / kd`, exceeds the approach speed. The arm's servos hold the arm.

    e is the pose error from an aim. For a dock with contact the aim of a vehicle at the distance x in front of the
    dock is `min(lift, glide_slope x - press[1])` above the docking pose and `press[0]` beyond it, so the vehicle comes
    down into the dock and is pressed on it. Where the vehicle is aside of the aim or below it by more than the
    clearance, the aim retreats, by `retreat` times the rest. These gains are 0 for a floating dock, where e is the pose
    error.

    Parameters
    ----------
    env, **options
        As in `PD`, of `UVMS-Dock`.
    kp, kd : array_like (6,) or None
        Gains of `PD`.
    approach_speed : float or None
        Maximum speed of approach, m/s. 0.5 by default.
    turn_speed : float or None
        Maximum angular speed of approach, rad/s. 0.3 by default.
    press : array_like (2,) or None
        Distances of the aim beyond the docking pose, forward and downward, m. 0.15 and 0.1 by default.
    lift : float or None
        Maximum height of the aim above the docking pose, m. 0.15 by default.
    glide_slope : float or None
        Rise of the aim with the distance in front of the dock, m/m. 0.5 by default.
    retreat : float or None
        Retreat of the aim with the error aside or downward beyond the clearance, m/m. 3 by default.
    clearance : float or None
        Error aside or downward without retreat, m. 0.05 by default.
    """

    kind = "dock-pd"
    tasks = ("dock",)
