"""Task with another observation and reward on the same physics: stay level and drift with the flow.

```python
env = OwnTask(gymnasium.make("UVMS-StationKeep-v0"))
envs = OwnTasks(gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=64))
envs = gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=64, autoreset_mode="Disabled")
venv = NativeVecEnv(OwnTasks(envs))
```

`unwrapped.snapshot()` is a copy of the true state, one row per instance, and `info` the terms of
the shipped reward. Both functions below accept any number of instances. Vector environments must be
in `NextStep` or `Disabled` mode: with `SameStep` the simulator is already in the next episode when
the step returns.
"""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

import uvms_gym

SPACE = gymnasium.spaces.Box(-100.0, 100.0, (9,), np.float32)


def observe(simulator: uvms_gym.Simulator) -> np.ndarray:
    """Observations (N, 9), body axes: direction of gravity, relative velocity of the water, rates.

    NaN in the state of a diverged run, which is `terminated`, becomes 0.
    """
    rotation, twist = np.nan_to_num(simulator.rotation), np.nan_to_num(simulator.twist)
    current = (rotation * simulator.current[:, :, None]).sum(axis=1)
    seen = np.hstack([-rotation[:, 2], current - twist[:, :3], twist[:, 3:]])
    return np.clip(seen, SPACE.low, SPACE.high).astype(np.float32)


def reward(simulator: uvms_gym.Simulator, info: Mapping[str, Any]) -> np.ndarray:
    """Rewards (N,): minus tilt and squared speed through the water, plus the shipped terms of
    effort (three times), action rate and divergence.
    """
    seen = observe(simulator).astype(np.float64)
    tilt, speed = 1.0 + seen[:, 2], (seen[:, 3:6] ** 2).sum(axis=1)
    shipped = 3.0 * info["reward_effort"] + info["reward_action_rate"] + info["reward_diverged"]
    return shipped - tilt - speed


class OwnTask(gymnasium.Wrapper, RecordConstructorArgs):
    """The single environment."""

    def __init__(self, env: gymnasium.Env) -> None:
        # The spec records the arguments.
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        self.observation_space = SPACE

    def reset(self, **kwargs: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode."""
        _, info = self.env.reset(**kwargs)
        return observe(self.unwrapped.snapshot())[0], info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One control period."""
        _, _, terminated, truncated, info = self.env.step(action)
        simulator = self.unwrapped.snapshot()
        return observe(simulator)[0], float(reward(simulator, info)[0]), terminated, truncated, info


class OwnTasks(gymnasium.vector.VectorWrapper):
    """The vector environment, bit-identical to single ones."""

    def __init__(self, envs: gymnasium.vector.VectorEnv) -> None:
        super().__init__(envs)
        self._mode = envs.metadata["autoreset_mode"]
        if self._mode is AutoresetMode.SAME_STEP:
            raise ValueError("autoreset_mode is 'SameStep', but must be 'NextStep' or 'Disabled'")
        self.single_observation_space = SPACE
        self.observation_space = batch_space(SPACE, envs.num_envs)
        self._over = np.zeros(envs.num_envs, dtype=np.bool_)

    def reset(self, **kwargs: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """Start episodes."""
        _, infos = self.env.reset(**kwargs)
        mask = (kwargs.get("options") or {}).get("reset_mask")
        self._over[slice(None) if mask is None else mask] = False
        return observe(self.unwrapped.snapshot()), infos

    def step(self, actions: np.ndarray) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One control period."""
        _, _, terminated, truncated, infos = self.env.step(actions)
        simulator = self.unwrapped.snapshot()
        rewards = reward(simulator, infos)
        # With NextStep these instances have just started an episode.
        rewards[self._over] = 0.0
        self._over = terminated | truncated
        return observe(simulator), rewards, terminated, truncated, infos
