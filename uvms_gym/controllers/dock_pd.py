"""Classical control of a vehicle that docks."""

from uvms_gym.controllers.base import ClassicalController


class DockPD(ClassicalController):
    """PD for `UVMS-Dock` with a limited approach speed, `F = -kp sat(e) - kd V_r`, from observations alone.

    It reads the pose error e and the twist V_r relative to the dock, which feeds the dock's velocity forward. `sat`
    scales the linear and the angular part of e down together where the velocity at which both terms balance,
    `-kp e / kd`, exceeds the approach speed. The arm is held by its own servos.

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        A `UVMS-Dock` environment: it determines the scene and the kind of action. Wrappers are looked through; those
        that change observations or actions invalidate the controller.
    kp, kd : array_like (6,) or None
        Gains per body axis [x, y, z, roll, pitch, yaw], N/m, N m/rad and N s/m, N m s/rad; the scene's where None.
    approach_speed : float or None
        Greatest speed of approach, m/s. 0.5 by default.
    turn_speed : float or None
        Greatest angular speed of approach, rad/s. 0.3 by default.
    **options
        Without `env`: arguments of `DockEnv`, of which `scene` and `action` matter.

    Raises
    ------
    ValueError
        Another task, a scene without gains if none are given, or a gain that is negative, not finite or of another
        shape.
    TypeError
        `env` is something else, options are given besides, or an argument is unknown.
    """

    kind = "dock-pd"
    _task = "dock"
