"""Episodes for training, with observations of real and of perfect sensors."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch
from torch import Tensor

from uvms_gym.envs import TaskVectorEnv
from uvms_gym.training.evaluation import episode_steps

#: Actions (n, a) for the time step, stacked observations (n, h d) and perfect observations (n, d).
Act = Callable[[int, Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class Episodes:
    """The first T steps of an episode of every instance: n instances, observations of d entries, actions of a."""

    observations: Tensor
    """Observations (n, h - 1 + T, d) after h - 1 rows of zeros."""
    clean: Tensor
    """Perfect observations (n, T + 1, d), that after the last step included."""
    actions: Tensor
    """Actions (n, T, a), not clipped."""
    rewards: Tensor
    """Rewards (n, T)."""
    alive: Tensor
    """True for steps up to the end of the episode (n, T)."""
    terminated: Tensor
    """True for the step that ended it, other than by its time limit (n, T)."""
    history: int
    """Number of stacked observations h."""

    @property
    def inputs(self) -> Tensor:
        """Stacked observations (n, T, h d), oldest first: a view."""
        n, rows, d = self.observations.shape
        shape, strides = (n, rows - self.history + 1, self.history * d), (rows * d, d, 1)
        return self.observations.as_strided(shape, strides)

    def select(self, instances: Tensor, times: Tensor) -> Tensor:
        """Stacked observations (k, h d) of instances (k,) at times (k,)."""
        n, rows, d = self.observations.shape
        # Rows of this view reach across instances, too; those are not selected.
        stacks = self.observations.as_strided((n * rows - self.history + 1, self.history * d), (d, 1))
        return stacks.index_select(0, instances * rows + times)


class TrainingEnvs:
    """Instances of an environment, whose episodes are run with perfect observations beside those of the sensors.

    Parameters
    ----------
    env : str
        Gymnasium's id of a UVMS environment.
    env_kwargs : mapping
        Arguments of the environment.
    num_envs : int
        Number of instances n.
    history : int
        Number of stacked observations h.

    Raises
    ------
    ValueError, TypeError, gymnasium.error.Error
        An argument is unknown or out of range, or the environment is not one of uvms_gym.
    """

    def __init__(self, env: str, env_kwargs: Mapping[str, Any], num_envs: int, history: int) -> None:
        self.steps = episode_steps(env, env_kwargs)
        self.env, self.history = gymnasium.make_vec(env, num_envs=num_envs, **env_kwargs), history
        inner = self.env.unwrapped
        if not isinstance(inner, TaskVectorEnv):
            raise ValueError(f"{env} is no environment of uvms_gym")
        self.inner = inner
        (self.size,) = inner.single_observation_space.shape or ()
        (self.actions,) = inner.single_action_space.shape or ()

    @torch.no_grad()
    def run(self, seeds: Sequence[int], act: Act, steps: int | None = None) -> Episodes:
        """Run the first `steps` of an episode (None: all) of every instance."""
        n, h, d = self.inner.num_envs, self.history, self.size
        steps = self.steps if steps is None else steps
        rows = Episodes(
            observations=torch.zeros(n, h - 1 + steps, d),
            clean=torch.zeros(n, steps + 1, d),
            actions=torch.zeros(n, steps, self.actions),
            rewards=torch.zeros(n, steps),
            alive=torch.zeros(n, steps, dtype=torch.bool),
            terminated=torch.zeros(n, steps, dtype=torch.bool),
            history=h,
        )
        inputs, alive = rows.inputs, np.ones(n, dtype=np.bool_)
        given: Any = list(seeds)
        seen, _ = self.env.reset(seed=given)
        for t in range(steps):
            rows.observations[:, h - 1 + t] = torch.from_numpy(seen)
            rows.clean[:, t] = torch.from_numpy(self.inner.perfect_observations())
            rows.actions[:, t] = act(t, inputs[:, t], rows.clean[:, t])
            seen, rewards, terminated, _, _ = self.env.step(rows.actions[:, t].numpy())
            rows.rewards[:, t] = torch.from_numpy(rewards)
            rows.alive[:, t], rows.terminated[:, t] = torch.from_numpy(alive), torch.from_numpy(alive & terminated)
            alive = alive & ~terminated
        rows.clean[:, steps] = torch.from_numpy(self.inner.perfect_observations())
        return rows

    def close(self) -> None:
        """Close the environment."""
        self.env.close()
