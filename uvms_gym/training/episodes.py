"""Episodes for training, with observations of real and of perfect sensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import torch
from torch import Tensor

from uvms_gym import MLP
from uvms_gym.controllers import Controller
from uvms_gym.envs import TaskVectorEnv
from uvms_gym.training.evaluation import episode_steps


@dataclass(frozen=True)
class Episodes:
    """The first T steps of an episode of every instance: n instances, observations of d entries, actions of a."""

    observations: Tensor
    """Observations (n, h - 1 + T, d) after h - 1 rows of zeros."""
    perfect: Tensor
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
    targets: Tensor | None = None
    """Actions of a teacher on the perfect observations (n, T, a)."""
    states: Tensor | None = None
    """States before each step and after the last (n, T + 1, .), for gradients of the return."""
    memories: Tensor | None = None
    """Memories of the task at these instants (n, T + 1, .)."""

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
    """Instances of an environment, whose episodes are run with perfect observations beside the sensors' observations.

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

    def run(
        self,
        seeds: Sequence[int],
        actor: MLP,
        noise: Tensor,
        teacher: Controller | None = None,
        teacher_acts: bool = False,
        frames: bool = False,
    ) -> Episodes:
        """Run the first T steps of an episode of every instance, natively.

        Parameters
        ----------
        seeds : sequence of int (n,)
        actor : MLP
            Policy; its actions are taken before they are clipped.
        noise : Tensor (n, T, a)
            Noise on the actions.
        teacher : Controller or None
            Controller on the perfect observations, whose actions become `targets`.
        teacher_acts : bool
            The teacher's actions are taken in place of the actor's.
        frames : bool
            States and memories are recorded, too.

        Raises
        ------
        ValueError
            The actor or the teacher is for other observations or actions.
        """
        given: Any = list(seeds)
        self.env.reset(seed=given)
        native = None if teacher is None else teacher.native
        rows = self.inner._native.record(actor.native, noise.numpy(), native, teacher_acts=teacher_acts, frames=frames)
        return Episodes(history=actor.history, **{name: torch.from_numpy(array) for name, array in rows.items()})

    def close(self) -> None:
        """Close the environment."""
        self.env.close()
