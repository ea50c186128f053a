"""Station keeping: `UVMS-StationKeep-v0`, single and vector."""

from dataclasses import dataclass
from typing import ClassVar

from uvms_gym._task.options import TaskOptions
from uvms_gym.envs.base import TaskEnv, TaskVectorEnv


@dataclass(frozen=True, kw_only=True)
class StationKeepOptions(TaskOptions, task="station-keep"):
    """Options of station keeping: `TaskOptions` and the arm's motion.

    Attributes
    ----------
    arm_amplitude : float
        Maximum swing of the arm's reference about home, rad, >= 0 (0.25 m per rad for prismatic joints).
    """

    #: Commands there become about as smooth as those of a PD.
    storm_action_rate: ClassVar[float] = 0.8

    arm_amplitude: float = 0.4


class StationKeepEnv(TaskEnv):
    """Keep an underwater vehicle at a pose while its arm moves and a current pushes.

    ## Description
    A free-floating vehicle with or without an arm keeps a target pose by its thrusters. Two disturbances act on it: the
    arm, which follows a smooth random reference under the joints' own servos, and a steady current of random strength
    and direction. The physics is `uvms_gym.Simulator`: rigid bodies with full added mass, damping, weight and buoyancy,
    integrated on SE(3).

    ## Action Space
    A `Box(-1, 1, (a,), float32)`, constant over the control period `dt * substeps` (0.05 s). Entries beyond the range
    are clipped. An action that is not finite, or has another shape, raises `ValueError` and changes nothing.

    With `action="wrench"` (a = 6) the entries are a body wrench relative to its limits. The limit of an axis is the
    maximum that the thrusters can produce along it with nothing along the other axes. Thrusts are allocated by weighted
    least squares, and all scaled down together where one would exceed its limit. On `petasus-pum`:

    | Num | Action | -1   | +1  | Unit |
    | --- | ------ | ---- | --- | ---- |
    | 0 | surge | -200 | 200 | N |
    | 1 | sway | -200 | 200 | N |
    | 2 | heave | -200 | 200 | N |
    | 3 | roll | -60 | 60 | N m |
    | 4 | pitch | -60 | 60 | N m |
    | 5 | yaw | -60 | 60 | N m |

    With `action="thrusters"` there is one entry for each thruster, in the order of the scene: its thrust, relative to
    its forward limit if positive and to its reverse limit if negative. With `action="residual"` the action is a
    correction to the wrench action of the controller `uvms_gym.PD` on the same observation, with the scene's gains.
    An entry of 1 is `residual_scale` times the limit; the sum is clipped to the limits.

    ## Observation Space
    A `Box(-bound, bound, (d,), float32)`: physical values divided by fixed scales, clipped to bounds that no episode
    reaches. Body axes are x forward, y left, z up; r and R are the vehicle's position and rotation, r_d and R_d the
    target's. With n joints there are 18 + a + 4 n entries; on `petasus-pum` with wrench actions:

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

    `env.unwrapped.layout` describes the entries for any scene.

    ## Rewards
    With the position error e (m), the angle of the attitude error (rad), the pose error
    p = sqrt(|e|^2 + (0.5 m * angle)^2), relative thrusts u in [-1, 1] and actions a the reward is
    `-0.1 (ln(1 + (p / 0.02 m)^2) + p / (0.3 m)) - 0.02 mean(u^2) - 0.1 mean((a - a_previous)^2)`. The option `reward`
    changes the weights; its weight `diverged` adds a cost of divergence.

    ## Disturbances
    Without `disturbance` there is a steady current of up to `max_current`. The option may be the name of a level:
    `"calm"`, `"current"`, `"gusts"`, `"waves"`, `"payload"`, `"thruster-loss"`, `"storm"` (all together, with noisy,
    late sensors and parameters off by up to 30 %) or `"storm-wide"` (the storm on a vehicle whose parameters are known
    even less). All but `"calm"` and `"storm-wide"` also exist with the ending `"-hard"`, stronger and with other
    shapes, for evaluation. The option may also be a dict of components, each a dict of parameters, `True` for its
    defaults or `None` to remove it. Its key `base` names a level that the dict changes:
    `{"base": "storm", "gust": {"rise": 2.0}, "waves": None}`. A parameter is a number, or a range `[minimum, maximum]`
    from which a value is drawn per episode or event. The parameter `share` is the force of a push, or the weight of a
    payload, relative to the vehicle's maximum thrust along its weakest axis. `uvms disturbances` lists and plots the
    levels.

    | Component | Meaning | Parameters |
    | --------- | ------- | ---------- |
    | `current` | steady current | `speed` (m/s), `elevation` (rad) |
    | `drift` | random drift of the current: Gauss-Markov | `deviation` (m/s), `time` (s), `vertical` |
    | `gust` | consecutive gusts | `speed`, `rise`, `duration`, `pause` (s), `elevation`, `turns` |
    | `waves` | Airy waves, decaying with depth | `height` (m), `period` (s), `depth` (m), `trains` (1 to 3) |
    | `impulse` | pushes | `share` or `force` (N), `duration`, `pause` (s), `reach` |
    | `tether` | cable | `height`, `distance`, `slack`, `diameter`, `drag`, `weight`, `stiffness`, `attachment` |
    | `payload` | mass that is carried for a time | `share` or `mass` (kg), `pick`, `hold` (s) |
    | `thrusters` | thrusters that weaken or die | `count`, `gain` (or `gains` of all), `time`, `fade` (s) |
    | `battery` | supply voltage that falls and sags, relative to the scene's | `charge`, `drain` (1/h), `sag` |
    | `arm` | factors on the arm's motion | `amplitude`, `speed` |
    | `noise` | white noise, bias | deviations by block (`position`, ..., `joint_rate`), `bias` (share of these) |
    | `outliers` | outliers of the measured pose | `probability`, `position` (m), `attitude` (rad) |
    | `dropout` | lost measurements: the last one is held | `probability`, `gap` (s) |
    | `delay` | age of measurements, per episode | sum of `time` (s, rounded to periods) and `periods` |
    | `parameters` | as `randomize` | ranges by name |
    | `script` | time series per control period | `current` (T, 3), `wrench` (T, 6), `repeat` |

    `vertical` is the vertical deviation of a drift relative to the horizontal one. A gust takes the time `rise` to rise
    and to fall, and with `turns` it reverses half-way. A push acts at a point near the vehicle's origin; `reach` is its
    maximum distance, as a multiple of the root mean square distance of the thrusters. The tether runs from a fixed
    point, `height` above and `distance` beside the world origin (m), to the point `attachment` of the vehicle (body
    axes, m). It is longer than the distance from the fixed point to the world origin by the share `slack`. `drag` is
    its drag coefficient, `weight` its weight in water (N/m), and `stiffness` that of the taut tether, as a share of the
    maximum thrust along the weakest axis, per metre. A payload is picked up at the time `pick`, and carried for the
    time `hold`. From `time` on the thrust of a thruster falls to the share `gain` over the duration `fade`.
    The voltage of a battery is `charge` without load at the start, loses `drain` per hour, and is lower by `sag` while
    all thrusters are at full thrust; thrusts change by its power 1.25.

    A measurement is lost with this `probability` per control period; `gap` is the mean duration of a gap, and without
    it losses are independent. A pose is an outlier with this `probability`, by the errors `position` and `attitude` in
    random directions.

    `delay` may also be a number, its `time`. A payload hangs on the end effector, or on the vehicle's origin if there
    is no arm. Noise, delay and gaps apply to the errors, velocities and joints in observations, and to the integral of
    the errors. Rewards and infos use the true state. `env.unwrapped.disturbance()` returns the disturbance over the
    control periods to come.

    ## Starting State
    The vehicle is at rest up to 0.05 m and 0.05 rad from the target (by default the world origin, level), joints and
    arm reference are at rest at home, and a current of 0 to 0.3 m/s flows within 0.25 rad of the horizontal. The seed
    of the last `reset` with a seed, and the number of episodes since, determine all draws.

    ## Episode End
    Termination: the run diverges, that is, the vehicle is 10 m from the target, moves at 10 m/s or turns at 20 rad/s,
    or a joint moves at 20 rad/s (if prismatic 20 m/s).
    Truncation: after 400 steps (20 s), by Gymnasium's `TimeLimit`.

    ## Information
    `reset` and `step` return the same float keys:

    - `position_error` (m), `attitude_error` (rad) and the combined `pose_error` (m);
    - `end_effector_position_error` (m) and `end_effector_attitude_error` (rad), relative to the pose that the end
      effector would have with the vehicle at its target and the arm at its reference;
    - `effort` (mean of u^2), `power` (mean of |u|^1.5) and `saturation` (share at their limit) of the thrusters, and
      `action_rate` (mean squared change of the action);
    - root mean squares `rms_...` and means `mean_...` over the episode's steps so far;
    - `current_x`, `current_y`, `current_z` (m/s, world);
    - over the last period: `disturbance_force` (N, of pushes, tether and script), `payload` (carried mass, kg) and
      `thruster_gain` (remaining share of the weakest thruster's thrust, from the period on in which it is lost);
    - `measurement_age`, the age of the observed measurement with delay and gaps (s);
    - the reward's terms `reward_pose`, `reward_effort`, `reward_action_rate`, `reward_diverged`;
    - `success`, 1 where both errors are within `tolerance`, else 0, and its mean `mean_success`; `recovery_time`, the
      duration of the present or last departure from `tolerance`, s (the approach at the start counts as one); and
      `diverged`, 1 where the run has diverged, else 0.

    ## Arguments
    `options`, a `StationKeepOptions`, or its fields as keyword arguments; and `render_mode` (None): `"rgb_array"` or
    `"human"`. Pictures are drawn in Rust.

    `reset(options=...)` sets parts of the start, which are otherwise drawn: `position` (3), `attitude` (quaternion [w,
    x, y, z]), `twist` (6, body axes), `q`, `qd` (n), `target_position`, `target_attitude`, and `current` (3, world,
    including the scene's own), in SI units. `disturbance` replaces the disturbance for that episode. The new
    disturbance may only have components that the environment was made with, and must have the same `delay`; `randomize`
    keeps its effect. A vector environment also accepts a list with one disturbance per instance.

    `UVMS-StationKeep-Storm-v0` is the version in which controllers are compared. It has `disturbance="storm"`,
    `thruster_lag=0.1`, 200 steps and `substeps=10`. The control period is therefore 0.1 s, and so is the sensor delay.
    The reward weights `effort` 0.05 and `action_rate` 0.8 lead to commands about as calm as a PD's.
    `UVMS-StationKeep-Wide-v0` has `disturbance="storm-wide"` instead: vehicle, thrusters and sensor delay differ widely
    from episode to episode.

    ```python
    >>> import gymnasium, uvms_gym
    >>> env = gymnasium.make("UVMS-StationKeep-v0", scene="bluerov2-heavy-alpha5")
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape
    (40,)

    ```

    ## Version History
    - v0: first version.
    """

    options_class = StationKeepOptions
    options: StationKeepOptions


class StationKeepVectorEnv(TaskVectorEnv):
    """N instances of `StationKeepEnv`, stepped together in one native call; parameters as in `TaskVectorEnv`."""

    options_class = StationKeepOptions
    options: StationKeepOptions
