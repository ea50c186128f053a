"""What training puts about a vector environment of Stable-Baselines3."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecFrameStack
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from uvms_gym.controllers import Controller


class StaggeredStart(VecEnvWrapper):
    """Episodes that do not all end together: `reset` leaves the instances at different times of theirs.

    Instances are reset once more, group by group, while the others go on under zero actions. Otherwise a learner sees
    the same part of all episodes at once, and forgets the others.

    Parameters
    ----------
    venv : VecEnv
        One whose `env_method("reset", indices=...)` works, such as `uvms_gym.sb3.NativeVecEnv`.
    steps : int
        Steps of an episode.
    groups : int
        How many different times there are at most.
    """

    def __init__(self, venv: VecEnv, steps: int, groups: int = 8) -> None:
        super().__init__(venv)
        self._pause = steps // groups
        self._groups = groups

    def reset(self) -> Any:
        """Start episodes, and let them run apart; the observations after that."""
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
        """Step as the environment does."""
        return self.venv.step_wait()


class ResidualVecEnv(VecEnvWrapper):
    """Actions that correct a controller's: `clip(base + limit * clip(action))`, each clip to [-1, 1].

    The controller's action (a,) comes after the observation. What it remembers is its own for each instance, and
    forgotten where an episode ends. `uvms_gym.Residual` is the same in a closed loop.

    Parameters
    ----------
    venv : VecEnv
        Whose observations the controller reads.
    base : uvms_gym.controllers.Controller
        What is corrected.
    limit : float
        Greatest correction of an entry of the action, in [0, 1].

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
        """Take the corrections (n, a) of the next step."""
        corrections = np.clip(actions, -1.0, 1.0).astype(np.float32, copy=False)
        self.venv.step_async(np.clip(self._base_actions + self.limit * corrections, -1.0, 1.0))

    def step_wait(self) -> VecEnvStepReturn:
        """Step; last observations of episodes are extended, too."""
        given, rewards, dones, infos = self.venv.step_wait()
        observations: Any = given
        if (where := np.flatnonzero(dones)).size:
            finals = np.stack([infos[i]["terminal_observation"] for i in where])
            actions, _ = self.base.predict(finals, None if self._memory is None else self._memory[where])
            for i, final, action in zip(where.tolist(), finals, actions, strict=True):
                infos[i]["terminal_observation"] = np.concatenate([final, action])
        return self._extended(observations, dones), rewards, dones, infos

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Everything that makes it go on as if it had not been interrupted."""
        memory = {} if self._memory is None else {"base_memory": self._memory.copy()}
        return {**self.venv.get_state(), "base_actions": self._base_actions.copy(), **memory}  # type: ignore[attr-defined]

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Continue from what `get_state` gave."""
        self.venv.set_state(state)  # type: ignore[attr-defined]
        self._base_actions = np.array(state["base_actions"])
        self._memory = np.array(state["base_memory"]) if "base_memory" in state else None

    def _extended(self, observations: NDArray[np.float32], starts: NDArray[np.bool_]) -> NDArray[np.float32]:
        self._base_actions, self._memory = self.base.predict(observations, self._memory, starts)
        return np.hstack([observations, self._base_actions])


class History(VecFrameStack):
    """The last observations side by side, oldest first, and zeros before an episode's first; its state can be kept.

    Parameters
    ----------
    venv : VecEnv
        With a flat observation.
    observations : int
        How many.
    """

    def __init__(self, venv: VecEnv, observations: int) -> None:
        super().__init__(venv, observations)

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Everything that makes it go on as if it had not been interrupted."""
        stacked: Any = self.stacked_obs
        return {**self.venv.get_state(), "history": stacked.stacked_obs.copy()}  # type: ignore[attr-defined]

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Continue from what `get_state` gave."""
        self.venv.set_state(state)  # type: ignore[attr-defined]
        stacked: Any = self.stacked_obs
        stacked.stacked_obs = np.array(state["history"])
