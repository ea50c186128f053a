"""End-effector tracking: `UVMS-EETrack-v0`, single and vector."""

from dataclasses import dataclass
from typing import Literal

from uvms_gym._task.options import Preview, TaskOptions
from uvms_gym.envs.base import TaskEnv, TaskVectorEnv


@dataclass(frozen=True, kw_only=True)
class EETrackOptions(TaskOptions, task="ee-track"):
    """Options of end-effector tracking: `TaskOptions` and the reference.

    Attributes
    ----------
    reference : {"mixed", "point", "line", "circle", "figure-eight", "spline"}
        Kind of the reference path; "mixed" draws one for each episode.
    reference_size : float
        Maximum amplitude or radius, m, in [0, 5]; an episode has 50 to 100 % of it.
    reference_speed : float
        Maximum speed, m/s, in [0, 2]; an episode has 50 to 100 % of it.
    reference_rotation : float
        Maximum amplitude of turns about the vertical, rad, in [0, 0.6]; about horizontal axes it is less than
        a third of that.
    preview : dict or None
        Any of `points`, the number of reference points seen ahead, 0 to 8 (3), and `spacing`, the time between them, s,
        in [0, 10] (0.2).
    """

    substeps: int = 10
    reference: Literal["point", "line", "circle", "figure-eight", "spline", "mixed"] = "mixed"
    reference_size: float = 0.4
    reference_speed: float = 0.2
    reference_rotation: float = 0.4
    preview: Preview | None = None


class EETrackEnv(TaskEnv):
    """Follow a moving pose with the end effector of an underwater vehicle-manipulator system.

    ## Description
    The end effector follows a reference pose, driven by thrusters and joint torques. The joints' servos are off, except
    for their damping, which acts as friction. The reference stays in place or moves along a line, a circle, a figure
    eight or a random spline, and turns on the way. It starts at rest at the end effector's home pose, accelerates over
    3 s, and is twice continuously differentiable. A steady current of random strength and direction acts on vehicle and
    arm. Without an arm the end effector is the vehicle itself. The physics is `uvms_gym.Simulator`.

    ## Action Space
    A `Box(-1, 1, (a,), float32)` under the rules of `StationKeepEnv`.

    With `action="wrench"` (a = 6 + n, with n joints) the first entries are a body wrench relative to its limits, as in
    `StationKeepEnv`, and the others are joint torques. An entry of 1 is the smaller of the joint's
    effort limit and a bound that keeps light joints from diverging within a control period. This bound is the sum of
    three torques: first, twice the static torque of the worst pose; second, the friction at 1 rad/s; third, the torque
    that accelerates the joint by 10 rad/s^2 while everything else is free, or by 2 rad/s^2 while everything else is
    fixed, whichever torque is larger. For prismatic joints 1 rad counts as 0.25 m. On `petasus-pum`:

    | Num | Action | -1   | +1  | Unit |
    | --- | ------ | ---- | --- | ---- |
    | 0 | surge | -200 | 200 | N |
    | 1 | sway | -200 | 200 | N |
    | 2 | heave | -200 | 200 | N |
    | 3 | roll | -60 | 60 | N m |
    | 4 | pitch | -60 | 60 | N m |
    | 5 | yaw | -60 | 60 | N m |
    | 6 | yaw | -100 | 100 | N m |
    | 7 | upper-arm | -150 | 150 | N m |
    | 8 | forearm | -55.78 | 55.78 | N m |
    | 9 | wrist | -21.2 | 21.2 | N m |
    | 10 | gripper | -4.326 | 4.326 | N m |

    With `action="thrusters"` (a = m + n, with m thrusters) the first m entries are thrusts, as in `StationKeepEnv`.
    With `action="residual"` (a = 6 + n) the action is a correction to the wrench action of `uvms_gym.ResolvedMotion` on
    the same observation. An entry of 1 is `residual_scale` times the limit; the sum is clipped to the limits.

    ## Observation Space
    A `Box(-bound, bound, (d,), float32)`: physical values divided by fixed scales, clipped to bounds that no episode
    reaches. Body axes are x forward, y left, z up; the scene defines the end effector's axes. r_e and R_e are its
    position and rotation, r_d and R_d the reference's. With n joints and p points of preview there are
    27 + a + 2 n + 6 p entries; on `petasus-pum` with wrench actions:

    | Num | Observation | Scale | Bound | Unit |
    | --- | ----------- | ----- | ----- | ---- |
    | 0-2 | `position_error`: R_e^T (r_e - r_d), end-effector axes | 0.1 | 100 | m |
    | 3-5 | `attitude_error`: rotation vector log(R_d^T R_e), end-effector axes | 0.1 | 31.42 | rad |
    | 6-8 | `linear_velocity`: absolute velocity of the vehicle origin, body axes | 0.2 | 50 | m/s |
    | 9-11 | `angular_velocity`: absolute angular velocity, body axes | 0.2 | 100 | rad/s |
    | 12-14 | `up`: direction against gravity, body axes | 1 | 1.001 | 1 |
    | 15-19 | `joint_position`: joint coordinates relative to home | 0.5 | 20 to 24.8 | rad or m |
    | 20-24 | `joint_rate`: joint rates | 0.5 | 40 | rad/s or m/s |
    | 25-30 | `reference_twist`: velocities of the reference, end-effector axes | 0.2 | 50 to 100 | m/s and rad/s |
    | 31-48 | `preview`: both errors against each point of the reference ahead | 0.1 | 31.42 to 101.2 | m and rad |
    | 49-59 | `previous_action`: the last action, as clipped | 1 | 1 | 1 |
    | 60-65 | `error_integral`: leaky integral of both errors, I' = e - 0.1 I | 0.2 | 157.1 to 500 | m s and rad s |

    `env.unwrapped.layout` describes the entries for any scene.

    ## Rewards
    With the end effector's position error e (m), the angle of its attitude error (rad), its pose error
    p = sqrt(|e|^2 + (0.5 m * angle)^2), relative thrusts and torques u in [-1, 1] and actions a the reward is
    `-0.1 (ln(1 + (p / 0.02 m)^2) + p / (0.3 m)) - 0.02 mean(u^2) - 0.1 mean((a - a_previous)^2)`. Divergence costs 100
    more, like 90 steps at a distance of a metre, so ending the episode early seldom pays. The option `reward` changes
    the four weights.

    ## Starting State
    The vehicle is at rest up to 0.05 m and 0.05 rad from its target pose (by default the world origin, level). The
    reference starts where the end effector is with the vehicle at the target pose and the arm at home. Joints are at
    home, and a current of 0 to 0.3 m/s flows within 0.25 rad of the horizontal. The seed and the number of the episode
    since that seed determine all draws and the reference.

    ## Episode End
    Termination: the run diverges, that is, the end effector is 10 m from the reference, the vehicle moves at 10 m/s or
    turns at 20 rad/s, or a joint moves at 20 rad/s (if prismatic 20 m/s) or exceeds the bound of `joint_position`.
    Truncation: after 400 steps (20 s), by Gymnasium's `TimeLimit`.

    ## Information
    The same keys as in `StationKeepEnv`. `position_error`, `attitude_error` and `pose_error` are the end effector's,
    like the `end_effector_...` ones, and `effort`, `power` and `saturation` include thrusters and joints.

    ## Arguments
    `options`, an `EETrackOptions`, or its fields as keyword arguments; and `render_mode`, as in `StationKeepEnv`.
    The vehicle's target pose at the start is drawn within `target_distance` and `target_heading`. Where the disturbance
    has sensor noise or delay, they change the observed pose error of the end effector, and the errors in the preview by
    the same amount. The component `arm` of a disturbance has no effect.

    `reset(options=...)` sets parts of the start as in `StationKeepEnv`; `target_position` and `target_attitude` are the
    vehicle's target pose, from which the start of the reference is computed (Starting State).

    `UVMS-EETrack-Storm-v0` is this task under the conditions of `UVMS-StationKeep-Storm-v0`, with `substeps=20` for
    the same control period of 0.1 s, and the reward weight `action_rate` at 0.2.

    ```python
    >>> import gymnasium, uvms_gym
    >>> env = gymnasium.make("UVMS-EETrack-v0", scene="bluerov2-heavy-alpha5", reference="circle")
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape
    (63,)

    ```

    ## Version History
    - v0: first version.
    """

    options_class = EETrackOptions
    options: EETrackOptions


class EETrackVectorEnv(TaskVectorEnv):
    """N instances of `EETrackEnv`, stepped together in one native call; parameters as in `TaskVectorEnv`."""

    options_class = EETrackOptions
    options: EETrackOptions
