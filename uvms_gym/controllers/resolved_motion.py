"""Classical control of an end effector that follows a path."""

from uvms_gym.controllers.base import ClassicalController


class ResolvedMotion(ClassicalController):
    """Resolved motion and inverse dynamics for `UVMS-EETrack`, from observations alone. [Whi69]

    The end effector's commanded twist is the reference's less `pose_gain` times the pose error and its integral. A
    damped and weighted pseudo-inverse of its Jacobian distributes it among vehicle and joints; in its null space the
    arm returns home and the vehicle levels. Inverse dynamics of the scene's nominal model in still water turns the
    error of these velocities, and the reference's acceleration, into a wrench and torques.

    With `observer_bandwidth` the forces and torques that the nominal model lacks (currents, waves, a payload, other
    parameters) are estimated from the measured velocities under the actions, and compensated. With `delay` the
    controller acts on a prediction of the present from delayed measurements, by the same model and its own past
    actions. Both assume that actions are carried out as given, and need the controller's state.

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        A `UVMS-EETrack` environment. Wrappers are looked through; those that change observations or actions invalidate
        the controller.
    pose_gain : float or None
        Pose error to the commanded twist, 1/s. 2.5 by default.
    twist_gain, joint_gain : float or None
        Errors of the vehicle's twist and of the joints' rates to their accelerations, 1/s. 6 and 10 by default.
    posture_gain, levelling_gain : float or None
        Distance of the joints from home and tilt of the vehicle to their rates, 1/s. 0.5 by default.
    arm_weight : float or None
        Mobility of the joints over the vehicle's: at 1 an arm of length 1 m takes as much of a motion. 2 by default.
    lag_compensation : float or None
        Share of the thrusters' nominal lag over a period that is compensated; only with `observer_bandwidth` or
        `delay`. 0 by default.
    integral_gain : float or None
        Integral of the pose error, over `pose_gain`, 1/s. The integral pauses while actuators saturate and the error
        would drive it further. 0 by default.
    observer_bandwidth : array_like (3,) or None
        Bandwidths of the disturbance observer, rad/s: of forces and of moments on the vehicle, and of torques on
        joints; 0 estimates nothing there. 0 by default.
    delay : int or None
        Age of measurements in control periods, which is compensated, 0 to 10. 0 by default.
    **options
        Without `env`: arguments of `EETrackEnv`, of which those of the scene, the action and the observation matter.

    Raises
    ------
    ValueError
        Another task, actions that are corrections to a controller, a gain that is negative, not finite or of another
        shape, or a delay beyond 10.
    TypeError
        `env` is something else, options are given besides, or an argument is unknown.
    """

    kind = "resolved-motion"
    _task = "ee-track"
