"""Another observation and reward on the same physics, without touching Rust: stay level and swim with the water.

```python
env = OwnTask(gymnasium.make("UVMS-StationKeep-v0"))
envs = OwnTasks(gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=64))
venv = NativeVecEnv(OwnTasks(gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=64, autoreset_mode="Disabled")))
```

`unwrapped.snapshot()` is a copy of the true state, one row per instance, and `info` has the shipped reward's terms. Both
functions below take many instances or one. To wrap a native vector environment mind the ends of episodes: with
`SameStep` the simulator has gone on to the next episode when the step returns, so take `NextStep` or `Disabled`.
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


def look(simulator: uvms_gym.Simulator) -> np.ndarray:
    """What the agent sees, (N, 9): direction of gravity, water's velocity past the vehicle, turning; body axes.

    The state of a run that has diverged may hold NaN; 0 stands for it. (Such a run has ended: it is `terminated`.)
    """
    rotation, twist = np.nan_to_num(simulator.rotation), np.nan_to_num(simulator.twist)
    current = (rotation * simulator.current[:, :, None]).sum(axis=1)
    seen = np.hstack([-rotation[:, 2], current - twist[:, :3], twist[:, 3:]])
    return np.clip(seen, SPACE.low, SPACE.high).astype(np.float32)


def judge(simulator: uvms_gym.Simulator, info: Mapping[str, Any]) -> np.ndarray:
    """Rewards (N,): less for tilt and speed through the water; the shipped terms of effort stay, thrice as heavy, and
    what divergence costs.
    """
    seen = look(simulator).astype(np.float64)
    tilt, speed = 1.0 + seen[:, 2], (seen[:, 3:6] ** 2).sum(axis=1)
    return -tilt - speed + 3.0 * info["reward_effort"] + info["reward_rate"] + info["reward_diverged"]


class OwnTask(gymnasium.Wrapper, RecordConstructorArgs):
    """The single environment."""

    def __init__(self, env: gymnasium.Env) -> None:
        # So that its spec can tell how it was made.
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        self.observation_space = SPACE

    def reset(self, **kwargs: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode."""
        _, info = self.env.reset(**kwargs)
        return look(self.unwrapped.snapshot())[0], info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One control period."""
        _, _, terminated, truncated, info = self.env.step(action)
        simulator = self.unwrapped.snapshot()
        return look(simulator)[0], float(judge(simulator, info)[0]), terminated, truncated, info


class OwnTasks(gymnasium.vector.VectorWrapper):
    """The vector environment; its numbers are those of single ones."""

    def __init__(self, envs: gymnasium.vector.VectorEnv) -> None:
        super().__init__(envs)
        self._mode = envs.metadata["autoreset_mode"]
        if self._mode is AutoresetMode.SAME_STEP:
            raise ValueError("with autoreset_mode='SameStep' the state at an episode's end is gone; take another")
        self.single_observation_space = SPACE
        self.observation_space = batch_space(SPACE, envs.num_envs)
        self._over = np.zeros(envs.num_envs, dtype=np.bool_)

    def reset(self, **kwargs: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """Start episodes."""
        _, infos = self.env.reset(**kwargs)
        mask = (kwargs.get("options") or {}).get("reset_mask")
        self._over[slice(None) if mask is None else mask] = False
        return look(self.unwrapped.snapshot()), infos

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One control period."""
        _, _, terminated, truncated, infos = self.env.step(actions)
        simulator = self.unwrapped.snapshot()
        rewards = judge(simulator, infos)
        # With NextStep these have just started an episode.
        rewards[self._over] = 0.0
        self._over = terminated | truncated
        return look(simulator), rewards, terminated, truncated, infos
