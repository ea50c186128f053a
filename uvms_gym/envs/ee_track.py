"""End-effector tracking: `UVMS-EETrack-v0`, single and vector."""

from typing import Literal, Unpack

from gymnasium.vector import AutoresetMode

from uvms_gym.envs import EPISODE_STEPS
from uvms_gym.envs._base import INFO, TaskEnv, TaskVectorEnv
from uvms_gym.envs._options import Disturbance, Options, Preview, Randomize, RewardWeights, Scene, Tolerance

__all__ = ["INFO", "EETrackEnv", "EETrackVectorEnv"]


class EETrackEnv(TaskEnv):
    """Follow a moving pose with the end effector of an underwater vehicle-manipulator system.

    ## Description
    A reference pose moves through the world: it stays where it is, goes along a line, a circle, a figure eight or a
    random spline, and turns on the way. It starts at rest at the end effector's home pose and gathers speed over 3
    s; it is twice continuously differentiable. The end effector is to follow it, while vehicle (thrusters) and arm
    (joint torques; of the joints' servos the damping alone stays on, as friction) act together. A steady current of
    random strength and direction drags both away. On a scene without an arm the end effector is the vehicle itself.
    The physics is that of `uvms_gym.Simulator`.

    ## Action Space
    A `Box(-1, 1, (a,), float32)`, held over the control period `dt * substeps` (0.05 s). Entries beyond the range are
    clipped; an action that is not finite or has another shape is refused with a `ValueError` and changes nothing.

    With `action="wrench"` (a = 6 + n) the first entries are a body wrench over its limits, as `StationKeepEnv` has
    them, and the others are joint torques. A torque of 1 is the joint's effort limit or, where that is less, twice what
    holds the arm in any pose, with what friction takes at 1 rad/s and an acceleration of 10 rad/s^2 (2 rad/s^2 with all
    else held; times 0.25 m/rad if prismatic), so that light joints do not fly apart within a control period. On
    `petasus-pum`:

    | Num | Action | -1   | +1  | Unit |
    | --- | ------ | ---- | --- | ---- |
    | 0 | surge | -200 | 200 | N |
    | 1 | sway | -200 | 200 | N |
    | 2 | heave | -200 | 200 | N |
    | 3 | roll | -60 | 60 | N m |
    | 4 | pitch | -60 | 60 | N m |
    | 5 | yaw | -60 | 60 | N m |
    | 6 | yaw | -13.93 | 13.93 | N m |
    | 7 | upper-arm | -21.41 | 21.41 | N m |
    | 8 | forearm | -4.103 | 4.103 | N m |
    | 9 | wrist | -0.8609 | 0.8609 | N m |
    | 10 | gripper | -0.0629 | 0.0629 | N m |

    With `action="thrusters"` (a = m + n) each of the first entries is a thruster's thrust over its limit on that side,
    in the order of the scene. With `action="residual"` (a = 6 + n) it is a correction to the action of
    `uvms_gym.ResolvedMotion` on the same observation for `action="wrench"`, over `residual` of the limits; the sum is
    clipped to the limits.

    ## Observation Space
    A `Box(-bound, bound, (d,), float32)`: physical values over fixed scales, clipped to a bound that a run does not
    reach before it ends. Body axes are x forward, y left, z up; end-effector axes are those of the scene. With n joints
    and p points of preview there are 27 + a + 2 n + 6 p entries; on `petasus-pum` with wrench actions:

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

    `env.unwrapped.layout` has the same as data, for any scene.

    ## Rewards
    With the pose error p = sqrt(|e|^2 + (0.5 m * angle)^2) of the end effector, relative thrusts and torques u in
    [-1, 1] and actions a the reward is
    `-0.1 (ln(1 + (p / 0.02 m)^2) + p / 0.3 m) - 0.02 mean(u^2) - 0.1 mean((a - a_previous)^2)`, less 100 where the run
    diverges: as much as 100 steps a metre away, so that nobody flees. The four weights are the argument `reward`.

    ## Starting State
    Vehicle at rest up to 0.05 m and 0.05 rad from where it has the end effector on the reference (world origin, level,
    by default), joints at their home, and a current of 0 to 0.3 m/s within 0.25 rad of the horizontal. All of it, and
    the reference, follows from the seed and the number of the episode since that seed was given.

    ## Episode End
    Termination: the run diverges (the end effector 10 m from the reference, 10 m/s, 20 rad/s, 20 rad/s or m/s at a
    joint, or a joint beyond where it is observed). Truncation: after 400 steps (20 s), by Gymnasium's `TimeLimit`.

    ## Information
    `reset` and `step` give the same float keys: `position_error` (m), `attitude_error` (rad) of the end effector
    (and the same as `end_effector_...`); `effort` (mean of |u|^1.5) and `saturation` over thrusters and joints;
    their root mean squares `rms_...` and means `mean_...` over the episode's steps so far; `current_x`,
    `current_y`, `current_z` (m/s, world); and the reward's terms `reward_pose`, `reward_effort`, `reward_rate`,
    `reward_diverged`. None but these depends on the reward's weights. `success` is 1 where both errors are within
    `tolerance`, else 0, and `mean_success` its mean; `recovery_time` is for how long they were not, s: since they
    last left it, up to now or to when they came back (from the episode's start, if they were outside then).
    `diverged` is 1 where the run has diverged, else 0.
    `disturbance_force`, `payload` and `thruster_gain` tell of the disturbance, as in `StationKeepEnv`.

    ## Arguments
    - `scene` (`"petasus-pum"`): name of a shipped scene with thrusters, path of a TOML file, or a dict.
    - `action` (`"wrench"`): `"wrench"`, `"thrusters"` or `"residual"`.
    - `reference` (`"mixed"`): `"point"`, `"line"`, `"circle"`, `"figure-eight"`, `"spline"`, or `"mixed"`, which draws
      one of them for each episode.
    - `reference_size` (0.4), `reference_speed` (0.2): greatest amplitude or radius, m, and greatest speed, m/s; 50 to
      100 % of each are drawn.
    - `reference_turn` (0.4): greatest amplitude of its turns about the vertical, rad; out of the horizontal less than a
      third of it.
    - `preview` (None): a dict with any of `points` (3), the number of points of the reference seen ahead, up to 8, and
      `spacing` (0.2 s), the time between them.
    - `disturbance` (None), `randomize` (None), `thruster_lag` (None): as `StationKeepEnv` has them; noise and delay of
      the pose error are those of the end effector, what is seen ahead is off by as much, and `arm` has no effect.
    - `dt` (0.01), `substeps` (5), `integrator` (`"mk4"`), `dtype` (`"float64"`), `max_current` (0.3), `start_distance`
      (0.05), `start_angle` (0.05), `target_distance` (0), `target_turn` (0), `reward` (None: `pose` 0.1, `effort` 0.02,
      `rate` 0.1, `diverged` 100), `tolerance` (None: `position` 0.05, `attitude` 0.1), `residual` (0.3), `privileged`
      (False),
      `threads` (None), `render_mode` (None): as `StationKeepEnv` has them; the target is where the vehicle would be at
      the start.

    `reset(options=...)` gives parts of the start that are not to be drawn: `position` (3), `attitude` (quaternion
    [w, x, y, z]), `twist` (6, body axes), `q`, `qd` (n), `target_position`, `target_attitude` (of the vehicle, where
    the reference starts), `current` (3, world, the scene's own included), and `disturbance`. SI units.

    `UVMS-EETrack-Storm-v0` is this task under the conditions of `UVMS-StationKeep-Storm-v0`.

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

    task = "ee-track"

    def __init__(
        self,
        scene: Scene = "petasus-pum",
        action: Literal["wrench", "thrusters", "residual"] = "wrench",
        reference: Literal["point", "line", "circle", "figure-eight", "spline", "mixed"] = "mixed",
        reference_size: float = 0.4,
        reference_speed: float = 0.2,
        reference_turn: float = 0.4,
        preview: Preview | None = None,
        dt: float = 0.01,
        substeps: int = 5,
        integrator: str = "mk4",
        dtype: Literal["float64", "float32"] = "float64",
        max_current: float = 0.3,
        start_distance: float = 0.05,
        start_angle: float = 0.05,
        target_distance: float = 0.0,
        target_turn: float = 0.0,
        disturbance: Disturbance | None = None,
        randomize: Randomize | None = None,
        thruster_lag: float | None = None,
        reward: RewardWeights | None = None,
        tolerance: Tolerance | None = None,
        residual: float = 0.3,
        privileged: bool = False,
        threads: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        options: Options = {
            "scene": scene,
            "action": action,
            "reference": reference,
            "reference_size": reference_size,
            "reference_speed": reference_speed,
            "reference_turn": reference_turn,
            "preview": preview,
            "dt": dt,
            "substeps": substeps,
            "integrator": integrator,
            "dtype": dtype,
            "max_current": max_current,
            "start_distance": start_distance,
            "start_angle": start_angle,
            "target_distance": target_distance,
            "target_turn": target_turn,
            "disturbance": disturbance,
            "randomize": randomize,
            "thruster_lag": thruster_lag,
            "reward": reward,
            "tolerance": tolerance,
            "residual": residual,
            "privileged": privileged,
            "threads": threads,
        }
        super().__init__(options, render_mode)


class EETrackVectorEnv(TaskVectorEnv):
    """Many `EETrackEnv`, stepped together in one native call: as `StationKeepVectorEnv`, with its arguments.

    Raises
    ------
    ValueError, TypeError
        An argument is out of range or unknown.
    """

    task = "ee-track"

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = EPISODE_STEPS,
        copy: bool = True,
        render_mode: str | None = None,
        **options: Unpack[Options],
    ) -> None:
        super().__init__(num_envs, autoreset_mode, max_episode_steps, copy, render_mode, options)
