"""Station keeping: `UVMS-StationKeep-v0`, single and vector."""

from collections.abc import Sequence
from typing import Any, Literal, Unpack, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from uvms_gym._core import StationKeep
from uvms_gym.envs import EPISODE_STEPS
from uvms_gym.envs._station_keep import (
    Actions,
    Observations,
    Options,
    RewardWeights,
    Scene,
    StationKeepBase,
    as_actions,
    native,
    refuse_rendering,
    starts,
    warn_of_rendering,
)

INFO = tuple(StationKeep.INFO)
_MASKS = tuple(f"_{name}" for name in INFO)
_SEEDS = 2**64
_MODES = {
    AutoresetMode.NEXT_STEP: "next_step",
    AutoresetMode.SAME_STEP: "same_step",
    AutoresetMode.DISABLED: "disabled",
}


class StationKeepEnv(StationKeepBase, gym.Env[Observations, Actions]):
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
    `-0.1 (ln(1 + (p / 0.02 m)^2) + p / 0.3 m) - 0.02 mean(u^2) - 0.1 mean((a - a_previous)^2)`. The three weights are
    the argument `reward`.

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
    `current_z` (m/s, world); and the reward's terms `reward_pose`, `reward_effort`, `reward_rate`. None but the last
    three depends on the reward's weights.

    ## Arguments
    - `scene` (`"petasus-pum"`): name of a shipped scene with thrusters, path of a TOML file, or a dict.
    - `action` (`"wrench"`): `"wrench"` or `"thrusters"`.
    - `dt` (0.01), `substeps` (5): physics step, s, and steps per control period. At 0.01 s the end effector errs by
      1e-9 to 3e-9 m (f64; 1e-6 to 7e-6 m in f32) after 10 s of driven motion, in the median (`uvms accuracy`). A `dt`
      that is too large for the scene is warned of by `uvms_gym.StepWarning`, once, at the first `step`.
    - `integrator` (`"mk4"`), `dtype` (`"float64"`): as `uvms_gym.Simulator` has them.
    - `max_current` (0.3): greatest speed of the drawn current, m/s.
    - `start_distance` (0.05), `start_angle` (0.05): greatest initial error, m and rad.
    - `target_distance` (0), `target_turn` (0): greatest distance (m) of a drawn target from the world origin, and
      greatest heading (rad).
    - `arm_amplitude` (0.4): greatest swing of the arm's reference about home, rad (0.25 m per rad if prismatic).
    - `reward` (None): a dict with any of `pose` (0.1), `effort` (0.02) and `rate` (0.1).
    - `threads` (None): most threads; one instance never uses more than one.
    - `render_mode` (None): there is nothing to render with.

    `reset(options=...)` gives parts of the start that are not to be drawn: `position` (3), `attitude` (quaternion
    [w, x, y, z]), `twist` (6, body axes), `q`, `qd` (n), `target_position`, `target_attitude`, and `current` (3, world,
    the scene's own included). SI units.

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

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": 20.0}  # noqa: RUF012 (as gym.Env declares it)

    def __init__(
        self,
        scene: Scene = "petasus-pum",
        action: Literal["wrench", "thrusters"] = "wrench",
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
        reward: RewardWeights | None = None,
        threads: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        refuse_rendering(render_mode)
        self.render_mode = render_mode
        self.options: Options = {
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
            "reward": reward,
            "threads": threads,
        }
        self._native = native(self.options)
        self._seeded = False
        self.metadata = {**type(self).metadata, "render_fps": 1.0 / self._native.control_period}
        self.observation_space, self.action_space = self._spaces()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, float]]:
        """Start an episode: the first of `seed`, or without one the next of the stream.

        Raises
        ------
        ValueError, TypeError
            An unknown option (the message lists the known ones), or an impossible start; the running episode goes
            on then.
        """
        given = starts(options)
        super().reset(seed=seed)
        if seed is None and not self._seeded:
            seed = self.np_random_seed
        observations, info = self._native.reset([None if seed is None else seed % _SEEDS], **given)
        self._seeded = True
        return observations[0], dict(zip(INFO, info[:, 0].tolist(), strict=True))

    def step(self, action: ArrayLike) -> tuple[Observations, float, bool, bool, dict[str, float]]:
        """Hold `action` for one control period.

        Raises
        ------
        ValueError
            The action is not finite or has the wrong shape.
        gymnasium.error.ResetNeeded
            There is no episode, or it has terminated.
        """
        return self._native.step_one(as_actions(action, self._action_shape))

    def render(self) -> None:
        """Warn, as there is nothing to render with."""
        warn_of_rendering()


class StationKeepVectorEnv(StationKeepBase, gym.vector.VectorEnv[Observations, Actions, NDArray[Any]]):
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
        Taken for compatibility: all arrays returned are fresh, and the caller's own.
    render_mode : None
        There is nothing to render with.
    **options
        As `StationKeepEnv` has them.

    Raises
    ------
    ValueError, TypeError
        An argument is out of range or unknown.
    """

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
        refuse_rendering(render_mode)
        self.render_mode = render_mode
        self.copy = copy
        self.options = options
        self.num_envs = num_envs
        mode = AutoresetMode(autoreset_mode)
        self._native = native(options, num_envs=num_envs, autoreset=_MODES[mode], max_episode_steps=max_episode_steps)
        self._seeded = False
        self.metadata = {"render_modes": [], "render_fps": 1.0 / self._native.control_period, "autoreset_mode": mode}
        self.single_observation_space, self.single_action_space = self._spaces()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Start episodes of all instances, or of those in `options["reset_mask"]` (a bool array (N,)).

        Parameters
        ----------
        seed : int, sequence or None
            `seed + i` for instance i, or N seeds; where there is None the stream goes on.
        options : dict or None
            As `StationKeepEnv.reset`, each for all instances or with N rows, and `reset_mask`. It is not changed.

        Raises
        ------
        ValueError, TypeError
            An unknown option, an impossible start, or a mask that is none; all episodes go on then.
        """
        given = starts(options, "reset_mask")
        mask = given.pop("reset_mask", None)
        self._check_mask(mask)
        if seed is None or isinstance(seed, (int, np.integer)):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = [None if s is None else int(s) for s in seed]
            if len(seeds) != self.num_envs:
                raise ValueError(f"{len(seeds)} seeds were given for num_envs={self.num_envs}")
        if any(s is not None and s < 0 for s in seeds):
            raise ValueError(f"seeds must not be negative: {seed}")
        super().reset(seed=int(seed) if isinstance(seed, (int, np.integer)) else None)
        if not self._seeded and None in seeds:
            first = cast(int, self.np_random_seed)
            seeds = [first + i if s is None else s for i, s in enumerate(seeds)]
        observations, info = self._native.reset([None if s is None else s % _SEEDS for s in seeds], mask, **given)
        self._seeded = True
        return observations, self._infos(info, np.ones(self.num_envs, dtype=np.bool_) if mask is None else mask)

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Hold `actions` (N, a) for one control period.

        Raises
        ------
        ValueError
            An action is not finite or there is a wrong shape; nothing has changed then.
        gymnasium.error.ResetNeeded
            There is no episode, or autoreset is disabled and one is over.
        """
        given = as_actions(actions, (self.num_envs, *self._action_shape))
        observations, rewards, terminated, truncated, info, finals = self._native.step(given)
        infos = self._infos(info, np.ones(self.num_envs, dtype=np.bool_))
        if finals is not None:
            where, last, measures = finals
            ended = np.zeros(self.num_envs, dtype=np.bool_)
            ended[where] = True
            infos["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for i, observation in zip(where.tolist(), last, strict=True):
                infos["final_obs"][i] = observation
            spread = np.zeros((len(INFO), self.num_envs))
            spread[:, where] = measures
            infos["final_info"] = self._infos(spread, ended)
            infos["_final_obs"], infos["_final_info"] = ended, ended.copy()
        return observations, rewards, terminated, truncated, infos

    def render(self) -> tuple[Any, ...]:
        """Warn, as there is nothing to render with."""
        warn_of_rendering()
        return (None,) * self.num_envs

    def _infos(self, info: NDArray[np.float64], mask: NDArray[np.bool_]) -> dict[str, Any]:
        """Measures (18, N) of the instances in `mask`, by name, each with a mask of its own."""
        if not mask.all():
            info[:, ~mask] = 0.0
        masks = np.repeat(mask[None], len(INFO), axis=0)
        return dict(zip(INFO, info, strict=True)) | dict(zip(_MASKS, masks, strict=True))

    def _check_mask(self, mask: Any) -> None:
        """Check as SyncVectorEnv does."""
        if mask is None:
            return
        if not isinstance(mask, np.ndarray):
            raise TypeError(f"options['reset_mask'] must be a numpy array, not {type(mask).__name__}")
        if mask.dtype != np.bool_:
            raise TypeError(f"options['reset_mask'] must have dtype bool, not {mask.dtype}")
        if mask.shape != (self.num_envs,):
            raise ValueError(f"options['reset_mask'] must have shape ({self.num_envs},), not {mask.shape}")
        if not mask.any():
            raise ValueError("options['reset_mask'] must pick at least one instance")
