"""Station keeping: `UVMS-StationKeep-v0`, single and vector."""

from typing import Literal, Unpack

from gymnasium.vector import AutoresetMode

from uvms_gym.envs import EPISODE_STEPS
from uvms_gym.envs._base import INFO, TaskEnv, TaskVectorEnv
from uvms_gym.envs._options import Disturbance, Options, Randomize, RewardWeights, Scene, Tolerance

__all__ = ["INFO", "StationKeepEnv", "StationKeepVectorEnv"]


class StationKeepEnv(TaskEnv):
    """Hold an underwater vehicle at a pose while its arm moves and a current pushes.

    ## Description
    A free-floating vehicle with an arm (or without) is to stay at a target pose. Its arm follows a smooth random
    reference under the joints' own servos, which pushes the vehicle about, and a steady current of random strength
    and direction drags it away. What acts on the vehicle are its thrusters. The physics is that of
    `uvms_gym.Simulator`: rigid bodies with full added mass, drag, weight and buoyancy, integrated on SE(3).

    ## Action Space
    A `Box(-1, 1, (a,), float32)`, held over the control period `dt * substeps` (0.05 s). Entries beyond the range are
    clipped; an action that is not finite or has another shape is refused with a `ValueError` and changes nothing.

    With `action="wrench"` (a = 6) the entries are a body wrench over its limits, which are what the thrusters reach
    along one axis alone. Thrusters are allocated by weighted least squares, and scaled down together where one
    would exceed its limit. On `petasus-pum`:

    | Num | Action | -1   | +1  | Unit |
    | --- | ------ | ---- | --- | ---- |
    | 0 | surge | -200 | 200 | N |
    | 1 | sway | -200 | 200 | N |
    | 2 | heave | -200 | 200 | N |
    | 3 | roll | -60 | 60 | N m |
    | 4 | pitch | -60 | 60 | N m |
    | 5 | yaw | -60 | 60 | N m |

    With `action="thrusters"` each entry is a thruster's thrust over its limit on that side, in the order of the scene.
    With `action="residual"` it is a correction to the action of the paper's PD (`uvms_gym.PD` on the same observation,
    with the scene's gains) for `action="wrench"`, over `residual` of the limits; the sum is clipped to the limits.

    ## Observation Space
    A `Box(-bound, bound, (d,), float32)`: physical values over fixed scales, clipped to a bound that a run does not
    reach before it ends. Body axes are x forward, y left, z up. With n joints there are 24 + 4 n entries (18 + a + 4 n
    in general); on `petasus-pum` with wrench actions:

    | Num | Observation | Scale | Bound | Unit |
    | --- | ----------- | ----- | ----- | ---- |
    | 0-2 | `position_error`: R^T (r - r_d), body axes | 0.1 | 100 | m |
    | 3-5 | `attitude_error`: rotation vector log(R_d^T R), body axes | 0.1 | 31.42 | rad |
    | 6-8 | `linear_velocity`: absolute velocity of the vehicle origin, body axes | 0.2 | 50 | m/s |
    | 9-11 | `angular_velocity`: absolute angular velocity, body axes | 0.2 | 100 | rad/s |
    | 12-16 | `joint_position`: joint coordinates relative to home | 0.5 | 20 to 24.8 | rad or m |
    | 17-21 | `joint_rate`: joint rates | 0.5 | 40 | rad/s or m/s |
    | 22-26 | `joint_reference`: reference at the next control instant, relative to home | 0.5 | 20 to 24.8 | rad or m |
    | 27-31 | `joint_reference_rate`: rate of the reference at the next control instant | 0.5 | 40 | rad/s or m/s |
    | 32-37 | `previous_action`: the last action, as clipped | 1 | 1 | 1 |
    | 38-43 | `error_integral`: leaky integral of both errors, I' = e - 0.1 I | 0.2 | 157.1 to 500 | m s and rad s |

    `env.unwrapped.layout` has the same as data, for any scene.

    ## Rewards
    With the pose error p = sqrt(|e|^2 + (0.5 m * angle)^2), relative thrusts u in [-1, 1] and actions a the reward is
    `-0.1 (ln(1 + (p / 0.02 m)^2) + p / 0.3 m) - 0.02 mean(u^2) - 0.1 mean((a - a_previous)^2)`. Its weights are the
    argument `reward`, whose `diverged` may have divergence cost something, too.

    ## Disturbances
    Without `disturbance` there is a steady current of up to `max_current`. Otherwise it is the name of a level:
    `"calm"`, `"current"`, `"gusts"`, `"waves"`, `"payload"`, `"thruster-loss"`, `"storm"` (all at once), or one of
    them but calm with `"-hard"`: stronger, of shapes that the others lack, meant to be held out for evaluation. Or it
    is a dict of components, each a dict of what it takes, `True` for its defaults or `None` for none; `base` names a
    level that the dict changes, key by key: `{"base": "storm", "gust": {"rise": 2.0}, "waves": None}`. Ranges
    `[least, greatest]` (or one number) are drawn from, uniformly, per episode or event; shares are of the thrust that
    the vehicle has along its weakest axis. `uvms disturbances` lists and draws all of it.

    | Component | What it is | Takes |
    | --------- | ---------- | ----- |
    | `current` | steady current | `speed` (m/s), `elevation` (rad) |
    | `drift` | current that wanders: Gauss-Markov | `deviation` (m/s), `time` (s), `vertical` |
    | `gust` | gusts, one after the other | `speed`, `rise`, `duration`, `pause` (s), `elevation`, `turns` |
    | `waves` | waves by Airy's theory, felt in depth | `height` (m), `period` (s), `depth` (m), `trains` (1 to 3) |
    | `impulse` | pushes | `share` or `force` (N), `duration`, `pause` (s), `reach` |
    | `tether` | cable | `height`, `distance`, `slack`, `diameter`, `drag`, `weight`, `stiffness`, `attachment` |
    | `payload` | mass seized, and dropped | `share` or `mass` (kg), `pick`, `hold` (s) |
    | `thrusters` | thrusters that weaken or fail | `count`, `gain` (or `gains` of all), `time`, `fade` (s) |
    | `arm` | factors on the arm's motion | `amplitude`, `speed` |
    | `noise` | white noise of sensors, and bias | deviations by block (`position`, ..., `joint_rate`), `bias` (share) |
    | `delay` | age of what sensors show | `time` (s, rounded to periods), `periods`; or a number, s |
    | `parameters` | as `randomize` | ranges by name |
    | `script` | time series per control period | `current` (T, 3), `wrench` (T, 6), `repeat` |

    Noise and delay change what observations show of errors, velocities and joints, and the integral of the errors;
    rewards and infos tell the truth. `env.unwrapped.disturbance()` tells what is to come.

    ## Starting State
    Vehicle at rest up to 0.05 m and 0.05 rad from the target (world origin, level, by default), joints at their home,
    arm reference at rest there too, and a current of 0 to 0.3 m/s within 0.25 rad of the horizontal. All of it follows
    from the seed and the number of the episode since that seed was given.

    ## Episode End
    Termination: the run diverges (10 m from the target, 10 m/s, 20 rad/s, or 20 rad/s or m/s at a joint).
    Truncation: after 400 steps (20 s), by Gymnasium's `TimeLimit`.

    ## Information
    `reset` and `step` give the same float keys: `position_error` (m), `attitude_error` (rad) and the same of the end
    effector against where target and arm reference would have it; `effort` (mean of |u|^1.5) and `saturation`; their
    root mean squares `rms_...` and means `mean_...` over the episode's steps so far; `current_x`, `current_y`,
    `current_z` (m/s, world); and the reward's terms `reward_pose`, `reward_effort`, `reward_rate`, `reward_diverged`.
    None but these depends on the reward's weights. `success` is 1 where both errors are within `tolerance`, else 0, and
    `mean_success` its mean; `recovery_time` is for how long they were not, s: since they last left it, up to now or to
    when they came back (from the episode's start, if they were outside then). `diverged` is 1 where the run has
    diverged, else 0. Over the period that passed, `disturbance_force` is that of pushes, tether and script (N),
    `payload` what is held (kg), and `thruster_gain` what is left of the weakest thruster's thrust.

    ## Arguments
    - `scene` (`"petasus-pum"`): name of a shipped scene with thrusters, path of a TOML file, or a dict.
    - `action` (`"wrench"`): `"wrench"`, `"thrusters"` or `"residual"`.
    - `dt` (0.01), `substeps` (5): physics step, s, and steps per control period. At 0.01 s the end effector errs by
      1e-9 to 3e-9 m (f64; 1e-6 to 7e-6 m in f32) after 10 s of driven motion, in the median (`uvms accuracy`). A `dt`
      that is too large for the scene is warned of by `uvms_gym.StepWarning`, once, at the first `step`.
    - `integrator` (`"mk4"`), `dtype` (`"float64"`): as `uvms_gym.Simulator` has them.
    - `max_current` (0.3): greatest speed of the drawn current, m/s, where there is no `disturbance`.
    - `start_distance` (0.05), `start_angle` (0.05): greatest initial error, m and rad.
    - `target_distance` (0), `target_turn` (0): greatest distance (m) of a drawn target from the world origin, and
      greatest heading (rad).
    - `arm_amplitude` (0.4): greatest swing of the arm's reference about home, rad (0.25 m per rad if prismatic).
    - `disturbance` (None): see above.
    - `randomize` (None): parameters that differ from the scene's in every episode, for all bodies alike: `True` for
      factors of 0.7 to 1.3 on `mass`, `added_mass`, `linear_damping`, `quadratic_damping`, `thrust` and `thruster_lag`,
      a number for another share, or a dict of shares or ranges by name, with `volume` (on top of the factor on mass,
      which it goes with, so that what floats still does) and `payload` (kg). `False` takes away what the disturbance
      has of it.
    - `thruster_lag` (None): time constant of all thrusters, s, in place of the scene's.
    - `reward` (None): a dict with any of `pose` (0.1), `effort` (0.02), `rate` (0.1) and `diverged` (0).
    - `tolerance` (None): a dict with any of `position` (0.05 m) and `attitude` (0.1 rad); the reward does not know it.
    - `residual` (0.3): greatest correction of `action="residual"`, over the actuators' limits.
    - `privileged` (False): whether `info["privileged"]` has the true state, current, parameters and target, (m,), for
      asymmetric critics: parts by the names and lengths in `env.unwrapped.privileged_layout`, SI units, world axes but
      for the twist.
    - `threads` (None): most threads; one instance never uses more than one.
    - `render_mode` (None): `"rgb_array"`, or through `gymnasium.make` also `"human"`: pictures drawn in Rust.

    `reset(options=...)` gives parts of the start that are not to be drawn: `position` (3), `attitude` (quaternion
    [w, x, y, z]), `twist` (6, body axes), `q`, `qd` (n), `target_position`, `target_attitude`, and `current` (3, world,
    the scene's own included). SI units. `disturbance` is one for that episode, of components that the environment was
    made with and with the same `delay`; parameters stay those of `randomize`, if it was given. The vector environment
    also takes a list of one per instance.

    `UVMS-StationKeep-Storm-v0` is this task under conditions that controllers are compared in: `disturbance="storm"`,
    `thruster_lag=0.1`, `substeps=10`, so a control period of 0.1 s and as much delay of the sensors, 200 steps.

    ```python
    >>> import gymnasium, uvms_gym
    >>> env = gymnasium.make("UVMS-StationKeep-v0", scene="bluerov2-heavy-alpha5")
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape
    (44,)

    ```

    ## Version History
    - v0: first version.
    """

    task = "station-keep"

    def __init__(
        self,
        scene: Scene = "petasus-pum",
        action: Literal["wrench", "thrusters", "residual"] = "wrench",
        dt: float = 0.01,
        substeps: int = 5,
        integrator: str = "mk4",
        dtype: Literal["float64", "float32"] = "float64",
        max_current: float = 0.3,
        start_distance: float = 0.05,
        start_angle: float = 0.05,
        target_distance: float = 0.0,
        target_turn: float = 0.0,
        arm_amplitude: float = 0.4,
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
            "dt": dt,
            "substeps": substeps,
            "integrator": integrator,
            "dtype": dtype,
            "max_current": max_current,
            "start_distance": start_distance,
            "start_angle": start_angle,
            "target_distance": target_distance,
            "target_turn": target_turn,
            "arm_amplitude": arm_amplitude,
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


class StationKeepVectorEnv(TaskVectorEnv):
    """Many `StationKeepEnv`, stepped together in one native call.

    It gives the same numbers as a `SyncVectorEnv` of single environments, bit for bit, whatever the number of
    instances and threads.

    Parameters
    ----------
    num_envs : int
        Number of instances N.
    autoreset_mode : AutoresetMode or str
        As Gymnasium defines them; `NEXT_STEP` is the default. `DISABLED` wants `reset(options={"reset_mask": mask})`.
    max_episode_steps : int or None
        Episodes are truncated after so many steps; None or 0: never.
    copy : bool
        Taken for compatibility: all arrays returned are the caller's own. Steps write to those alone that nobody holds
        any more.
    render_mode : str or None
        `"rgb_array"`: `render()` gives a sequence of N pictures, each drawn when first looked at.
    **options
        As `StationKeepEnv` has them.

    Raises
    ------
    ValueError, TypeError
        An argument is out of range or unknown.
    """

    task = "station-keep"

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
