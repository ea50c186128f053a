"""What all environments have in common: spaces, state, reset and step; single and vector."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from uvms_gym._core import Simulator, Task
from uvms_gym.envs import EPISODE_STEPS
from uvms_gym.envs._arguments import Actions, as_actions, starts
from uvms_gym.envs._options import Options, check_count, native
from uvms_gym.envs.rendering import RENDER_MODES, Picture, Pictures, Rendering, check_mode

Observations = NDArray[np.float32]

INFO = tuple(Task.INFO)
_MASKS = tuple(f"_{name}" for name in INFO)
_SEEDS = 2**64
_MODES = {
    AutoresetMode.NEXT_STEP: "next_step",
    AutoresetMode.SAME_STEP: "same_step",
    AutoresetMode.DISABLED: "disabled",
}


class TaskBase(Rendering):
    """Spaces, state and read access."""

    #: Name of the task.
    task: ClassVar[str]

    _native: Task
    _privileged: bool
    options: Options

    _action_shape: tuple[int, ...]

    def _spaces(self) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
        """Spaces of one instance's observation and action."""
        bound = self._native.observation_bound
        action = np.ones(len(self._native.action_layout), dtype=np.float32)
        self._action_shape = action.shape
        return spaces.Box(-bound, bound, dtype=np.float32), spaces.Box(-action, action, dtype=np.float32)

    @property
    def simulator(self) -> Simulator:
        """A copy of the physics at this instant: the true state to read, and a simulator to look ahead with."""
        return self._native.simulator

    @property
    def layout(self) -> Sequence[Mapping[str, Any]]:
        """Blocks of an observation: name, offset, scale, bound, unit, description."""
        return self._native.layout

    @property
    def action_layout(self) -> list[tuple[str, list[float], str]]:
        """Entries of an action: name, what -1 and +1 ask for, unit."""
        return self._native.action_layout

    @property
    def privileged_layout(self) -> list[tuple[str, int]]:
        """Names and lengths of the parts of `info["privileged"]`."""
        return self._native.privileged_layout

    @property
    def episode(self) -> dict[str, NDArray[Any]]:
        """What the running episodes drew, and where their references are; one row per instance."""
        return self._native.episodes()

    def disturbance(self, instance: int = 0, steps: int = EPISODE_STEPS) -> dict[str, NDArray[np.float64]]:
        """What will disturb an instance in its next `steps` control periods, if it stays where it is.

        Called after `reset` it tells of the whole episode. Waves, tether and pushes depend on where the vehicle is, a
        little; all else is exact.

        Returns
        -------
        dict of numpy.ndarray
            time (T,), s since the episode's start; current (T, 3), m/s, and its acceleration (T, 3), m/s^2, world axes;
            wrench (T, 6), N and N m, body axes, thrusters excluded; gains (T, thrusters), what is left of each
            thruster's thrust; payload (T,), kg.

        Raises
        ------
        IndexError, ValueError, gymnasium.error.ResetNeeded
            There is no such instance, `steps` is out of range, or there is no episode.
        """
        check_count("instance", instance, least=0)
        check_count("steps", steps, least=0)
        return self._native.disturbance(instance, steps)

    def get_state(self) -> dict[str, NDArray[np.float64]]:
        """Everything that makes the environment go on as if it had not been interrupted."""
        physics, episodes = self._native.__getstate__()
        return {"physics": physics, "episodes": episodes}

    def set_state(self, state: Mapping[str, ArrayLike]) -> None:
        """Continue, bit for bit, from what `get_state` of an environment with the same arguments gave.

        Raises
        ------
        ValueError, TypeError
            The state is not one of such an environment; nothing has changed then.
        """
        if not isinstance(state, Mapping):
            raise TypeError(f"state must be a dict as get_state gives it, not {type(state).__name__}")
        for part in ("physics", "episodes"):
            if part not in state:
                raise ValueError(f"state lacks {part!r}, which get_state gives")
        self._native.__setstate__((state["physics"], state["episodes"]))


class TaskEnv(TaskBase, gym.Env[Observations, Actions]):
    """One instance of a task."""

    metadata: dict[str, Any] = {  # noqa: RUF012 (as gym.Env declares it)
        "render_modes": list(RENDER_MODES),
        "render_fps": 20.0,
    }

    def __init__(self, options: Options, render_mode: str | None) -> None:
        check_mode(render_mode)
        self.render_mode = render_mode
        self.options = options
        self._native = native({**options, "task": self.task})
        self._privileged = bool(options.get("privileged"))
        self._seeded = False
        self.metadata = {"render_modes": list(RENDER_MODES), "render_fps": 1.0 / self._native.control_period}
        self.observation_space, self.action_space = self._spaces()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
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
        named: dict[str, Any] = dict(zip(INFO, info[:, 0].tolist(), strict=True))
        if self._privileged:
            self._tell_truth(named)
        return observations[0], named

    def step(self, action: ArrayLike) -> tuple[Observations, float, bool, bool, dict[str, Any]]:
        """Hold `action` for one control period.

        Raises
        ------
        ValueError
            The action is not finite or has the wrong shape.
        gymnasium.error.ResetNeeded
            There is no episode, or it has terminated.
        """
        try:
            result = self._native.step_one(action)  # type: ignore[arg-type]
        except TypeError:
            result = None  # No array as policies give them: made one here, so that no error of that shows this one.
        if result is None:
            result = self._native.step_one(as_actions(action, self._action_shape))
        if self._privileged:
            self._tell_truth(result[4])
        return result

    def _tell_truth(self, info: dict[str, Any]) -> None:
        info["privileged"] = self._native.privileged()[0]

    def render(self) -> Picture | None:
        """Draw (480, 640, 3) uint8; without a render mode warn and return None."""
        pictures = self._pictures()
        return None if pictures is None else pictures[0]


class TaskVectorEnv(TaskBase, gym.vector.VectorEnv[Observations, Actions, NDArray[Any]]):
    """Many instances of a task."""

    def __init__(
        self,
        num_envs: int,
        autoreset_mode: AutoresetMode | str,
        max_episode_steps: int | None,
        copy: bool,
        render_mode: str | None,
        options: Options,
    ) -> None:
        check_mode(render_mode)
        self.render_mode = render_mode
        self.copy = copy
        self.options = options
        self.num_envs = num_envs
        mode = AutoresetMode(autoreset_mode)
        self._native = native(
            {**options, "task": self.task},
            num_envs=num_envs,
            autoreset=_MODES[mode],
            max_episode_steps=max_episode_steps,
        )
        self._privileged = bool(options.get("privileged"))
        self._seeded = False
        self.metadata = {
            "render_modes": list(RENDER_MODES),
            "render_fps": 1.0 / self._native.control_period,
            "autoreset_mode": mode,
        }
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
            As that of the single environment, each for all instances or with N rows, and `reset_mask`. It is not
            changed.

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
        return observations, self._infos(info, mask)

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
        infos = self._infos(info)
        if finals is not None:
            where, last, measures, truth = finals
            ended = np.zeros(self.num_envs, dtype=np.bool_)
            ended[where] = True
            infos["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for i, observation in zip(where.tolist(), last, strict=True):
                infos["final_obs"][i] = observation
            spread = np.zeros((len(INFO), self.num_envs))
            spread[:, where] = measures
            truths = np.zeros((self.num_envs, truth.shape[1]))
            truths[where] = truth
            infos["final_info"] = self._infos(spread, ended, truths)
            infos["_final_obs"], infos["_final_info"] = ended, ended.copy()
        return observations, rewards, terminated, truncated, infos

    def render(self) -> Pictures | tuple[None, ...]:  # type: ignore[override]
        """Give N pictures, each drawn when first looked at; without a render mode warn, and N times None."""
        pictures = self._pictures()
        return (None,) * self.num_envs if pictures is None else pictures

    def _infos(
        self, info: NDArray[np.float64], mask: NDArray[np.bool_] | None = None, truth: NDArray[np.float64] | None = None
    ) -> dict[str, Any]:
        """Measures (k, N) by name, each with a mask of its own, and the truth (N, m): of all, or of those in `mask`."""
        masks = np.ones((len(INFO), self.num_envs), dtype=np.bool_)
        if mask is not None:
            masks[:] = mask
            info[:, ~mask] = 0.0
        infos: dict[str, Any] = dict(zip(INFO, info, strict=True))
        infos.update(zip(_MASKS, masks, strict=True))
        if self._privileged:
            truth = self._native.privileged() if truth is None else truth
            if mask is not None:
                truth[~mask] = 0.0
            infos["privileged"], infos["_privileged"] = truth, masks[0].copy()
        return infos

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
