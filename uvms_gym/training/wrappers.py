"""Wrappers of Stable-Baselines3 vector environments for training."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecFrameStack
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from uvms_gym.controllers import Controller


class StaggeredStart(VecEnvWrapper):
    """Episodes out of phase: after `reset` the instances are at different times of their episodes.

    Instances are reset once more, group by group, while the others continue under zero actions. Otherwise a learner
    sees the same part of all episodes at once, and forgets the others.

    Parameters
    ----------
    venv : VecEnv
        With `env_method("reset", indices=...)`, like `uvms_gym.sb3.NativeVecEnv`.
    steps : int
        Steps of an episode.
    groups : int
        Maximum number of different times.
    """

    def __init__(self, venv: VecEnv, steps: int, groups: int = 8) -> None:
        super().__init__(venv)
        self._pause = steps // groups
        self._groups = groups

    def reset(self) -> Any:
        """Start episodes, and bring them out of phase; returns the observations after that."""
        observations: Any = self.venv.reset()
        still = np.zeros((self.num_envs, *(self.action_space.shape or ())), dtype=np.float32)
        for group in range(1, self._groups):
            for _ in range(self._pause):
                observations = self.venv.step(still)[0]
            members = list(range(group, self.num_envs, self._groups))
            if members:
                again = self.venv.env_method("reset", indices=members)
                observations[members] = [observation for observation, _ in again]
        return observations

    def step_wait(self) -> VecEnvStepReturn:
        """Step the environment."""
        return self.venv.step_wait()


class ResidualVecEnv(VecEnvWrapper):
    """Actions as corrections of a controller: `clip(base + limit * clip(action))`, each clip to [-1, 1].

    Observations are extended by the controller's action (a,). Its state is separate for each instance, and reset at the
    end of episodes. `uvms_gym.Residual` is the same in a closed loop.

    Parameters
    ----------
    venv : VecEnv
        With observations for the controller.
    base : uvms_gym.controllers.Controller
        Corrected controller.
    limit : float
        Maximum correction of an entry of the action, in [0, 1].

    Raises
    ------
    ValueError
        The limit is out of range.
    """

    def __init__(self, venv: VecEnv, base: Controller, limit: float = 0.3) -> None:
        if not 0.0 <= limit <= 1.0:
            raise ValueError(f"limit is {limit}, but must be in [0, 1]")
        seen, action = venv.observation_space, venv.action_space
        assert isinstance(seen, spaces.Box) and isinstance(action, spaces.Box)
        low, high = (np.concatenate(pair) for pair in ((seen.low, action.low), (seen.high, action.high)))
        super().__init__(venv, observation_space=spaces.Box(low, high, dtype=np.float32))
        self.base, self.limit = base, np.float32(limit)
        self._memory: Any = None
        self._base_actions = np.zeros((self.num_envs, *action.shape), dtype=np.float32)

    def reset(self) -> NDArray[np.float32]:
        """Start episodes."""
        self._memory = None
        observations: Any = self.venv.reset()
        return self._extended(observations, np.ones(self.num_envs, dtype=np.bool_))

    def step_async(self, actions: NDArray[Any]) -> None:
        """Start a step with corrections (n, a)."""
        corrections = np.clip(actions, -1.0, 1.0).astype(np.float32, copy=False)
        self.venv.step_async(np.clip(self._base_actions + self.limit * corrections, -1.0, 1.0))

    def step_wait(self) -> VecEnvStepReturn:
        """Complete the step; final observations of episodes are extended, too."""
        given, rewards, dones, infos = self.venv.step_wait()
        observations: Any = given
        if (where := np.flatnonzero(dones)).size:
            finals = np.stack([infos[i]["terminal_observation"] for i in where])
            actions, _ = self.base.predict(finals, None if self._memory is None else self._memory[where])
            for i, final, action in zip(where.tolist(), finals, actions, strict=True):
                infos[i]["terminal_observation"] = np.concatenate([final, action])
        return self._extended(observations, dones), rewards, dones, infos

    def get_state(self) -> dict[str, NDArray[Any]]:
        """State that resumes the run bit-identically."""
        memory = {} if self._memory is None else {"base_memory": self._memory.copy()}
        return {**self.venv.get_state(), "base_actions": self._base_actions.copy(), **memory}  # type: ignore[attr-defined]

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Continue from a state of `get_state`."""
        self.venv.set_state(state)  # type: ignore[attr-defined]
        self._base_actions = np.array(state["base_actions"])
        self._memory = np.array(state["base_memory"]) if "base_memory" in state else None

    def _extended(self, observations: NDArray[np.float32], starts: NDArray[np.bool_]) -> NDArray[np.float32]:
        self._base_actions, self._memory = self.base.predict(observations, self._memory, starts)
        return np.hstack([observations, self._base_actions])


class History(VecFrameStack):
    """The last observations (flat) side by side, oldest first, zeros before an episode's start; with `get_state`."""

    stacked_obs: Any

    def get_state(self) -> dict[str, NDArray[Any]]:
        """State that resumes the run bit-identically."""
        return {**self.venv.get_state(), "history": self.stacked_obs.stacked_obs.copy()}  # type: ignore[attr-defined]

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Continue from a state of `get_state`."""
        self.venv.set_state(state)  # type: ignore[attr-defined]
        self.stacked_obs.stacked_obs = np.array(state["history"])
