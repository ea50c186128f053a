"""Single and vector environments of any task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from uvms_gym._task.arguments import Actions, as_actions, starts
from uvms_gym._task.base import EPISODE_STEPS, TaskBase
from uvms_gym._task.jacobians import period_jacobians
from uvms_gym._task.options import TaskOptions
from uvms_gym.envs.rendering import RENDER_MODES, SINGLE_MODES, Picture, Pictures, Rendering
from uvms_gym.envs.window import Window

Observations = NDArray[np.float32]

#: Observations, rewards, terminated, truncated and metrics (k, N) of a step.
StepArrays = tuple[Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float64]]


def _key(seed: int) -> int:
    """Key of the episodes of a seed: the seed itself, or 64 bits of a hash of a larger one."""
    if seed < 2**64:
        return seed
    return int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0])


class TaskEnv(TaskBase, Rendering, gym.Env[Observations, Actions]):
    """One instance of a task.

    Parameters
    ----------
    options : TaskOptions or None
        Options of the task; None: the defaults.
    render_mode : str or None
        `"rgb_array"`: `render` draws a picture. `"human"`: every reset and step shows one in a window, in real time.
    **kwargs
        Fields of `options` by name; they take precedence.

    Raises
    ------
    ValueError, TypeError
        An option is unknown or out of range; the message names it and what is allowed.
    gymnasium.error.DependencyNotInstalled
        pygame, for a window, is not installed.
    """

    metadata: dict[str, Any] = {"render_modes": list(SINGLE_MODES), "render_fps": 20.0}  # noqa: RUF012
    _window: Window | None = None

    def __init__(self, options: TaskOptions | None = None, *, render_mode: str | None = None, **kwargs: Any) -> None:
        self._set_render_mode(render_mode, SINGLE_MODES)
        if render_mode == "human":
            self._window = Window(type(self).__name__)
        self.observation_space, self.action_space = self._make(options, kwargs)
        # `check_env` opens a window for the mode "human", which not every machine has: it is listed where it is used.
        modes = RENDER_MODES if self._window is None else SINGLE_MODES
        self.metadata = {"render_modes": list(modes), "render_fps": 1.0 / self._native.control_period}
        self._seeded = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Start an episode: the first of `seed`, or without a seed the next of the stream.

        Raises
        ------
        ValueError, TypeError
            Unknown option (the message lists the known ones), or impossible start; the running episode continues then.
        """
        given = starts(options)
        super().reset(seed=seed)
        if seed is None and not self._seeded:
            seed = self.np_random_seed
        observations, info = self._native.reset([None if seed is None else _key(seed)], **given)
        self._seeded = True
        named: dict[str, Any] = dict(zip(self.metric_names, info[:, 0].tolist(), strict=True))
        self._add_requested(named)
        if self._window is not None:
            self.render()
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
            result = None  # Not a float32 array. It is converted outside of this block, so that errors are not chained.
        if result is None:
            result = self._native.step_one(as_actions(action, self._action_shape))
        self._add_requested(result[4])
        if self._window is not None:
            self.render()
        return result

    def forces(self, action: ArrayLike, observation: Observations | None = None) -> NDArray[np.float64]:
        """Forces (f,) of an action (a,), as of `TaskVectorEnv.forces`.

        Raises
        ------
        ValueError
            The shape is wrong, the action is not finite, or a residual action lacks the present `observation` (d,).
        gymnasium.error.ResetNeeded
            There is no episode.
        """
        given = as_actions(action, self._action_shape)[None]
        forces = self._forces(given, None if observation is None else observation[None])
        return np.asarray(forces[0])

    def _add_requested(self, info: dict[str, Any]) -> None:
        if self.options.privileged:
            info["privileged"] = self._native.privileged()[0]
        if self.options.error_estimate:
            info["error_estimate"] = self._errors()[0]

    def render(self) -> Picture | None:
        """Draw a picture (480, 640, 3), uint8.

        The mode `"human"` shows it in the window and returns None. Without a render mode warn and return None.
        """
        pictures = self._pictures()
        if pictures is None or self._window is None:
            return None if pictures is None else pictures[0]
        self._window.show(pictures[0], self.metadata["render_fps"])
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()


class TaskVectorEnv(TaskBase, Rendering, gym.vector.VectorEnv[Observations, Actions, NDArray[Any]]):
    """N instances of a task, stepped together in one native call.

    The numbers equal a `SyncVectorEnv` of single environments, bit for bit, for any number of instances and
    threads.

    Parameters
    ----------
    num_envs : int
        Number of instances N.
    options : TaskOptions or None
        Options of the task; None: the defaults.
    autoreset_mode : AutoresetMode or str
        Autoreset mode of Gymnasium; `NEXT_STEP` is the default. `DISABLED` takes `reset(options={"reset_mask": mask})`.
    max_episode_steps : int or None
        Length at which episodes are truncated, control periods; None or 0: never.
    copy : bool
        True: every step returns new arrays. False: every step returns the same arrays of observations, rewards, flags
        and metrics, with new contents, which saves their allocation.
    render_mode : str or None
        `"rgb_array"`: `render()` returns a sequence of N pictures, each drawn at its first access.
    **kwargs
        Fields of `options` by name; they take precedence.

    Raises
    ------
    ValueError, TypeError
        An argument is unknown or out of range; the message names it and what is allowed.
    """

    def __init__(
        self,
        num_envs: int = 1,
        options: TaskOptions | None = None,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = EPISODE_STEPS,
        copy: bool = True,
        render_mode: str | None = None,
        **kwargs: Any,
    ) -> None:
        self._set_render_mode(render_mode)
        self.num_envs, self.copy = num_envs, copy
        mode = AutoresetMode(autoreset_mode)
        self.single_observation_space, self.single_action_space = self._make(
            options, kwargs, num_envs=num_envs, autoreset=mode.name.lower(), max_episode_steps=max_episode_steps
        )
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._observation_shape = (num_envs, len(self._native.observation_bound))
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._arrays: StepArrays | None = None
        self._metrics = self.metric_names
        self._masks = tuple(f"_{name}" for name in self._metrics)
        self._seeded = False
        self.metadata = {
            "render_modes": list(RENDER_MODES),
            "render_fps": 1.0 / self._native.control_period,
            "autoreset_mode": mode,
        }

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Start episodes of all instances, or of those in `options["reset_mask"]` (a bool array (N,)).

        Parameters
        ----------
        seed : int, sequence or None
            `seed + i` for instance i, or N seeds; None continues the stream.
        options : dict or None
            Options of the single environment, each for all instances or with N rows, and `reset_mask`. The dict is not
            changed.

        Raises
        ------
        ValueError, TypeError
            Unknown option, impossible start or invalid mask; all episodes continue then.
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
        observations, info = self._native.reset([None if s is None else _key(s) for s in seeds], mask, **given)
        self._seeded = True
        return observations, self._infos(info, mask)

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Hold `actions` (N, a) for one control period.

        Raises
        ------
        ValueError
            An action is not finite, or the shape is wrong; nothing has changed then.
        gymnasium.error.ResetNeeded
            There is no episode, or autoreset is disabled and an episode is over.
        """
        given = as_actions(actions, (self.num_envs, *self._action_shape))
        arrays = self._step_arrays()
        finals = self._native.step(given, arrays)
        observations, rewards, terminated, truncated, info = arrays
        infos = self._infos(info)
        if finals is not None:
            where, last, measures, truth = finals
            ended = np.zeros(self.num_envs, dtype=np.bool_)
            ended[where] = True
            infos["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for i, observation in zip(where.tolist(), last, strict=True):
                infos["final_obs"][i] = observation
            spread = np.zeros((len(self._metrics), self.num_envs))
            spread[:, where] = measures
            truths = np.zeros((self.num_envs, truth.shape[1]))
            truths[where] = truth
            infos["final_info"] = self._infos(spread, ended, truths)
            infos["_final_obs"], infos["_final_info"] = ended, ended.copy()
        return observations, rewards, terminated, truncated, infos

    def perfect_observations(self) -> Observations:
        """Observations (N, d) of the true, present state, for asymmetric critics and teachers.

        The sensors have neither noise nor delay; the integral of errors comes from the measured ones.

        Raises
        ------
        gymnasium.error.ResetNeeded
            There is no episode.
        """
        return self._native.perfect_observations()

    def forces(self, actions: ArrayLike, observations: Observations | None = None) -> NDArray[np.float64]:
        """Forces (N, f) of actions (N, a): thrusts, N, then torques of joints that the action drives, N m or N.

        Residual actions correct a controller on the present `observations` (N, d).

        Raises
        ------
        ValueError
            The shape is wrong, an action is not finite, or residual actions lack `observations`.
        gymnasium.error.ResetNeeded
            There is no episode.
        """
        return self._forces(as_actions(actions, (self.num_envs, *self._action_shape)), observations)

    def jacobians(
        self, actions: ArrayLike, observations: Observations | None = None
    ) -> dict[str, dict[str, NDArray[np.float64]]]:
        """Jacobians of the coming control period under `actions` (N, a), without the physics between its start and end.

        The environment is not stepped. `snapshot().step_jacobians` has the physics: docs/gradients.md.

        Parameters
        ----------
        actions : array_like (N, a)
        observations : numpy.ndarray (N, d) or None
            Present observations; needed with residual actions.

        Returns
        -------
        dict of dict of numpy.ndarray
            (N, outputs, inputs) by output and input. Outputs: "force" (f) of `forces`; "observation" (d) and "reward"
            (1) after the period; "measurement" (w), the measured quantities in that state: errors of position and
            attitude, twist, joint coordinates and rates, and where observed the direction against gravity; "memory"
            (c): previous action, its squared change, three means over actuators, the integral of both errors, and rows
            of the task. Inputs: "state" (12 + 2 n) after the period, in the coordinates of `step_jacobians`;
            "measurement" (w), where late sensors measure an earlier state; "action" (a); with residual actions "base"
            (a), the base controller's action; "memory" (c) before the period. Forces depend on action, base and memory
            alone.

        Raises
        ------
        ValueError
            The shape is wrong, an action is not finite, or residual actions lack `observations`.
        gymnasium.error.ResetNeeded
            There is no episode, or one is over.
        """
        given = as_actions(actions, (self.num_envs, *self._action_shape))
        return period_jacobians(self._native, given, self._base(observations))

    def render(self) -> Pictures | tuple[None, ...]:  # type: ignore[override]
        """Sequence of N pictures, each drawn at its first access; without a render mode a warning and N times None."""
        pictures = self._pictures()
        return (None,) * self.num_envs if pictures is None else pictures

    def _step_arrays(self) -> StepArrays:
        """Arrays for the results of a step: new ones, or without `copy` always the same."""
        if self._arrays is not None:
            return self._arrays
        n, empty = self.num_envs, np.empty
        arrays = (
            empty(self._observation_shape, np.float32),
            empty(n),
            empty(n, np.bool_),
            empty(n, np.bool_),
            empty((len(self._metrics), n)),
        )
        if not self.copy:
            self._arrays = arrays
        return arrays

    def _infos(
        self, info: NDArray[np.float64], mask: NDArray[np.bool_] | None = None, truth: NDArray[np.float64] | None = None
    ) -> dict[str, Any]:
        """Metrics (k, N) by name, each with its mask, and the privileged information (N, m); 0 outside of `mask`."""
        ended = truth is not None
        masks = np.ones((len(self._metrics), self.num_envs), dtype=np.bool_)
        if mask is not None:
            masks[:] = mask
            info[:, ~mask] = 0.0
        infos: dict[str, Any] = dict(zip(self._metrics, info, strict=True))
        infos.update(zip(self._masks, masks, strict=True))
        if self.options.privileged:
            truth = self._native.privileged() if truth is None else truth
            if mask is not None:
                truth[~mask] = 0.0
            infos["privileged"], infos["_privileged"] = truth, masks[0].copy()
        if self.options.error_estimate and not ended:
            errors = self._errors()
            errors[~masks[0]] = 0.0
            infos["error_estimate"], infos["_error_estimate"] = errors, masks[0].copy()
        return infos

    def _check_mask(self, mask: Any) -> None:
        """Check as SyncVectorEnv does."""
        if mask is None:
            return
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            kind = getattr(mask, "dtype", type(mask).__name__)
            raise TypeError(f"options['reset_mask'] must be a numpy array of dtype bool, not {kind}")
        if mask.shape != (self.num_envs,):
            raise ValueError(f"options['reset_mask'] must have shape ({self.num_envs},), not {mask.shape}")
        if not mask.any():
            raise ValueError("options['reset_mask'] must pick at least one instance")
