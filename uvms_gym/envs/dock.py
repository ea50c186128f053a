"""Docking: `UVMS-Dock-v0`, single and vector."""

from dataclasses import dataclass
from typing import Literal

from uvms_gym._task.options import TaskOptions
from uvms_gym.envs.base import TaskEnv, TaskVectorEnv


@dataclass(frozen=True, kw_only=True)
class DockOptions(TaskOptions, task="dock"):
    """Options of docking: `TaskOptions`, the approach, the dock's motion and the conditions of success.

    The default tolerance is 0.1 m and 0.15 rad.

    Attributes
    ----------
    dock : {"cradle", "floating"}
        "cradle": a rigid dock at the world origin, which the vehicle touches; it does not move with the waves.
        "floating": a pose that moves with the waves, without contact.
    start_clearance : float
        Minimum initial distance from the dock, m, in [0, start_distance]; `start_distance` is the maximum.
    approach_cone : float
        Half angle of the cone in front of the dock where the vehicle starts, rad, in [0, pi/2].
    arm : {"stowed", "moving"}
        "stowed": the joints stay at home. "moving": they follow references as in station keeping.
    arm_amplitude : float
        Maximum amplitude of a moving arm's reference about home, rad, >= 0 (0.25 m per rad for prismatic joints).
    dock_sway : float
        Horizontal motion of the dock, as a share of the water's motion there, in [0, 1].
    dock_heave : float
        Vertical motion of the dock, as a share of the water's motion there, in [0, 1].
    dock_tilt : float
        Tilt of the dock, as a share of the wave slope there, in [0, 1].
    hold_speed : float
        Speed relative to the dock below which the vehicle counts as holding, m/s, >= 0.
    hold_time : float
        Duration within the tolerances at low relative speed until the vehicle counts as docked, s, >= 0.
    capture_distance : float
        Distance from the dock at which the approach speed is measured, on the first crossing, m, >= 0.
    docked_reward : float
        Reward per control period while docked, >= 0.
    speed_weight : float
        Reward weight of the relative speed near the dock, >= 0.
    terminate_on_success : bool
        The first docking ends the episode.
    """

    start_distance: float = 5.0
    start_angle: float = 0.3
    dock: Literal["cradle", "floating"] = "cradle"
    start_clearance: float = 2.0
    approach_cone: float = 0.4
    arm: Literal["stowed", "moving"] = "stowed"
    arm_amplitude: float = 0.4
    dock_sway: float = 0.5
    dock_heave: float = 0.5
    dock_tilt: float = 0.5
    hold_speed: float = 0.1
    hold_time: float = 2.0
    capture_distance: float = 0.5
    docked_reward: float = 0.5
    speed_weight: float = 0.1
    terminate_on_success: bool = False


class DockEnv(TaskEnv):
    """Approach a dock, and come to rest in it: a cradle that the vehicle touches, or a pose that sways with the waves.

    ## Description
    A free-floating vehicle with or without an arm starts 2 to 5 m in front of a dock. It is docked once it has stayed
    within the tolerances of the docking pose, at low speed relative to the dock, for the hold time. The arm is stowed,
    or follows references under its servos. A steady current of random strength and direction, or any other disturbance,
    acts on the vehicle. The physics is `uvms_gym.Simulator`.

    With `dock="cradle"` the dock is rigid and can be touched: two tilted planks carry the lower edges of the hull and
    open at the entrance, and two posts stop it at the end. The vehicle touches it with the contact spheres that the
    scene has on the vehicle, or with spheres at the corners of its outline. It is docked only while the
    contact force is above 1 N.

    With `dock="floating"` the dock is a pose on a moored platform, without contact. It follows a share of the water's
    motion in the waves, and tilts with their slope; without waves it does not move.

    ## Action Space
    The action space of `StationKeepEnv`. With `action="residual"` the action is a correction to the action of
    `uvms_gym.DockPD` with the scene's gains. On `petasus-pum` with wrench actions:

    | Num | Action | -1   | +1  | Unit |
    | --- | ------ | ---- | --- | ---- |
    | 0 | surge | -200 | 200 | N |
    | 1 | sway | -200 | 200 | N |
    | 2 | heave | -200 | 200 | N |
    | 3 | roll | -60 | 60 | N m |
    | 4 | pitch | -60 | 60 | N m |
    | 5 | yaw | -60 | 60 | N m |

    ## Observation Space
    A `Box(-bound, bound, (d,), float32)`: physical values divided by fixed scales, clipped to bounds that no episode
    reaches. r_d and R_d are the present docking pose. Velocities are relative to the dock, as the vehicle measures
    them; the dock's own motion is not observed. With n joints there are 21 + a + 4 n entries; on `petasus-pum` with
    wrench actions:

    | Num | Observation | Scale | Bound | Unit |
    | --- | ----------- | ----- | ----- | ---- |
    | 0-2 | `position_error`: R^T (r - r_d), body axes | 0.1 | 100 | m |
    | 3-5 | `attitude_error`: rotation vector log(R_d^T R), body axes | 0.1 | 31.42 | rad |
    | 6-8 | `relative_velocity`: velocity of the vehicle origin less that of the dock, body axes | 0.2 | 50 | m/s |
    | 9-11 | `relative_angular_velocity`: angular velocity less that of the dock, body axes | 0.2 | 100 | rad/s |
    | 12-14 | `up`: direction against gravity, body axes | 1 | 1.001 | 1 |
    | 15-19 | `joint_position`: joint coordinates relative to home | 0.5 | 20 to 24.8 | rad or m |
    | 20-24 | `joint_rate`: joint rates | 0.5 | 40 | rad/s or m/s |
    | 25-29 | `joint_reference`: reference at the next control instant, relative to home | 0.5 | 20 to 24.8 | rad or m |
    | 30-34 | `joint_reference_rate`: rate of the reference at the next control instant | 0.5 | 40 | rad/s or m/s |
    | 35-40 | `previous_action`: the last action, as clipped | 1 | 1 | 1 |
    | 41-46 | `error_integral`: leaky integral of both errors, I' = e - 0.1 I | 0.2 | 157.1 to 500 | m s and rad s |

    `env.unwrapped.layout` describes the entries for any scene.

    ## Rewards
    With the position error e (m), the angle of the attitude error (rad), the pose error
    p = sqrt(|e|^2 + (0.5 m * angle)^2), the relative speed v (m/s), relative thrusts u in [-1, 1] and actions a the
    reward is `-0.1 (ln(1 + (p / 0.02 m)^2) + p / (2 m)) - 0.02 mean(u^2) - 0.1 mean((a - a_previous)^2) -
    0.1 * v / (v + 0.1 m/s) / (1 + (p / 0.5 m)^2)`, plus 0.5 while docked. Divergence costs 500 more, like 370 of the
    400 steps at a distance of 5 m, so ending the episode early seldom pays. The options `reward`, `speed_weight` and
    `docked_reward` change the weights.

    ## Starting State
    The vehicle is at rest 2 to 5 m from the dock, within a cone of half angle 0.4 rad about the dock's -x axis. Its
    attitude is the dock's but for a heading error of up to 0.3 rad, and joints are at home. A cradle is at
    the world origin, level, and the vehicle starts in front of its entrance, so large vehicles start further away. The
    docking pose in a floating dock is, in still water, the target pose of the episode (by default the world origin,
    level).

    ## Episode End
    Termination: the run diverges, that is, the vehicle is 10 m from the dock, moves at 10 m/s or turns at 20 rad/s, or
    a joint moves at 20 rad/s (if prismatic 20 m/s). With `terminate_on_success` the first docking also terminates the
    episode. Truncation: after 400 steps (20 s), by Gymnasium's `TimeLimit`.

    ## Information
    The same keys as in `StationKeepEnv`. `success` is 1 from the first docking on, whether or not the vehicle stays
    docked; `mean_success` is its mean, and `recovery_time` the duration for which `success` was 0. In addition
    `docked` (1 while docked), `time_to_dock` (s until the first docking; before it the time so far), `approach_speed`
    (relative speed at the first crossing of `capture_distance`, m/s; 0 before it), `contact_force` (sum of the normal
    forces of all contacts, N), `peak_force` (its maximum over the control instants so far, N), `impulse` (its integral,
    N s) and `reward_docking` (the reward's terms for relative speed and for being docked). Forces are evaluated at
    control instants with the scene's nominal numbers.

    ## Arguments
    `options`, a `DockOptions`, or its fields as keyword arguments; and `render_mode`, as in `StationKeepEnv`.
    `reset(options=...)` sets parts of the start as in `StationKeepEnv`; `target_position` and `target_attitude` are the
    docking pose in still water. A cradle does not move: there they change only where the vehicle starts.

    `UVMS-Dock-Storm-v0` is this task under the conditions of `UVMS-StationKeep-Storm-v0`, with the reward weight
    `action_rate` at 0.2.

    ```python
    >>> import gymnasium, uvms_gym
    >>> env = gymnasium.make("UVMS-Dock-v0", scene="bluerov2-heavy", disturbance="waves")
    >>> observation, info = env.reset(seed=1)
    >>> bool(2.0 < info["position_error"] < 6.0)
    True

    ```

    ## Version History
    - v0: first version.
    """

    options_class = DockOptions
    options: DockOptions


class DockVectorEnv(TaskVectorEnv):
    """N instances of `DockEnv`, stepped together in one native call; parameters as in `TaskVectorEnv`."""

    options_class = DockOptions
    options: DockOptions
