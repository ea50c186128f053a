"""Learners on episodes: collection of the next episodes beside the update on the last ones."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import torch
from torch import Tensor, nn

from uvms_gym import MLP
from uvms_gym.training.episodes import Episodes, TrainingEnvs
from uvms_gym.training.hyperparameters import count
from uvms_gym.training.networks import Actor, Critic
from uvms_gym.training.run import SEED_STRIDE, Settings

#: Hyperparameters of the run, not of the learner.
_OWN = ("n_timesteps", "n_envs", "env_kwargs", "frame_stack")
#: Share of a run in which the collected part of episodes grows. Early on a policy is soon far off.
GROWTH = 0.8


@dataclass(frozen=True)
class Hyperparameters:
    """Hyperparameters of a learner; a subclass names them."""

    net_arch: tuple[int, ...]
    """Hidden layers of the actor."""
    n_steps: int
    """Steps of each episode in the first iteration; they grow linearly, to all of it after `GROWTH` of the run."""

    @classmethod
    def read(cls, given: Mapping[str, Any]) -> Self:
        """Take the learner's part of a run's hyperparameters.

        Raises
        ------
        ValueError, TypeError
            A name is unknown, missing, or its value of another kind.
        """
        kinds = {field.name: field.type for field in fields(cls)}
        own = {name: value for name, value in given.items() if name not in _OWN}
        for name in own:
            if name not in kinds:
                raise ValueError(f"unknown hyperparameter {name!r}; known: {', '.join((*_OWN, *kinds))}")
        if missing := [name for name in kinds if name not in own]:
            raise ValueError(f"hyperparameter {missing[0]} is missing")
        return cls(**{name: _converted(name, kinds[name], value) for name, value in own.items()})


@dataclass(frozen=True)
class ActorCriticParameters(Hyperparameters):
    """Hyperparameters of a learner with a critic."""

    critic_arch: tuple[int, ...]
    """Hidden layers of the critic."""
    learning_rate: float
    """Initial learning rate of the actor, which is adapted in every iteration."""
    critic_learning_rate: float
    """Learning rate of the critic."""
    gamma: float
    """Discount."""


def _converted(name: str, kind: Any, value: Any) -> Any:
    """Number or tuple of counts; integers and sizes are positive."""
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if kind is int:
        return count({name: value}, name)
    if kind not in (int, float) and isinstance(value, list | tuple) and value:
        return tuple(count({name: size}, name) for size in value)
    raise ValueError(f"{name} is {value!r}, but must be a {'number' if kind is float else 'list of layer sizes'}")


class Learner(ABC):
    """Actor that improves by iterations: the start of an episode of every instance, and an update on all of them.

    While an update runs, a thread collects the episodes of the next iteration with the actor from before the update:
    the native environment releases the interpreter. Seeds of episodes and of random numbers follow from the training
    seed and the number of the iteration, so that a run depends neither on the timing of threads nor on stops.

    Parameters
    ----------
    settings : Settings
    parameters : Hyperparameters
    log_std : float
        Logarithm of the initial standard deviation of actions.
    critic_arch : tuple of int
        Hidden layers of a critic on perfect observations; empty: no critic.

    Raises
    ------
    ValueError, TypeError, OSError, gymnasium.error.Error
        A setting is unknown or out of range, or the initial policy does not fit.
    """

    #: Number of episodes with the same seed.
    replicas = 1
    #: Optimisers by name.
    optimizers: Mapping[str, torch.optim.Optimizer]

    def __init__(
        self, settings: Settings, parameters: Hyperparameters, log_std: float, critic_arch: tuple[int, ...] = ()
    ) -> None:
        self.settings, self.iteration, self.steps, self._first = settings, 0, 0, parameters.n_steps
        self.num_envs = count(settings.hyperparameters, "n_envs")
        self.envs = TrainingEnvs(settings.env, settings.kwargs, self.num_envs, settings.history)
        with torch.random.fork_rng(devices=()):
            torch.manual_seed(settings.seed)
            self.actor = Actor(settings.spans, [self.envs.size, *parameters.net_arch, self.envs.actions], log_std)
            self.modules: dict[str, nn.Module] = {"actor": self.actor}
            if critic_arch:
                self.modules["critic"] = self.critic = Critic(self.envs.size, critic_arch)
        if settings.start is not None:
            policy = MLP.load(Path(settings.start), self.envs.inner)
            try:
                self.actor.load(policy)
            except ValueError as error:
                raise ValueError(f"{settings.start}: {error}") from None
        self.behaviour = copy.deepcopy(self.actor)
        self._pending: Future[tuple[Episodes, Tensor]] | None = None
        self._threads = ThreadPoolExecutor(2)

    @abstractmethod
    def collect(self, actor: Actor, iteration: int, steps: int) -> tuple[Episodes, Tensor]:
        """Run the episodes of an iteration, in a thread of its own; returns what `update` needs besides, too."""

    @abstractmethod
    def update(self, episodes: Episodes, more: Tensor, generator: torch.Generator) -> None:
        """Improve the actor."""

    @property
    def horizon(self) -> int:
        """Steps of each episode in the next iteration."""
        complete = self.envs.steps
        first = min(self._first, complete)
        return round(first + (complete - first) * min(1.0, (1.0 - self.left) / GROWTH))

    @property
    def left(self) -> float:
        """Share of the run that is left, 1 to 0."""
        return max(0.0, 1.0 - self.steps / self.settings.steps)

    def iterate(self) -> None:
        """Collect and update."""
        pending = self._pending or self._begin()
        episodes, more = pending.result()
        self.iteration += 1
        self.steps += episodes.alive.numel()
        self.behaviour = copy.deepcopy(self.actor)
        self._pending = self._begin() if self.left > 0.0 else None
        self.update(episodes, more, self.generator(self.iteration, "update"))

    def generator(self, iteration: int, purpose: str) -> torch.Generator:
        """Random numbers of an iteration."""
        purposes = ("collect", "update")
        seed = (self.settings.seed * 1_000_003 + iteration) * len(purposes) + purposes.index(purpose)
        return torch.Generator().manual_seed(seed)

    def seeds(self, iteration: int) -> list[int]:
        """Seeds of an iteration's episodes."""
        each = self.num_envs // self.replicas
        first = SEED_STRIDE * (1 + self.settings.seed) + iteration * each
        return [first + i // self.replicas for i in range(self.num_envs)]

    def state(self) -> dict[str, Any]:
        """State that resumes the run bit-identically."""
        return {
            "iteration": self.iteration,
            "steps": self.steps,
            "behaviour": self.behaviour.state_dict(),
            "modules": {name: module.state_dict() for name, module in self.modules.items()},
            "optimizers": {name: optimizer.state_dict() for name, optimizer in self.optimizers.items()},
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Continue from a state of `state`."""
        self.iteration, self.steps = state["iteration"], state["steps"]
        self.behaviour.load_state_dict(state["behaviour"])
        for name, module in self.modules.items():
            module.load_state_dict(state["modules"][name])
        for name, optimizer in self.optimizers.items():
            optimizer.load_state_dict(state["optimizers"][name])

    def notes(self) -> dict[str, str]:
        """Further notes for the policy's file: the initial policy."""
        return {} if self.settings.start is None else {"start": Path(self.settings.start).name}

    def close(self) -> None:
        """Wait for the threads, and close the environments."""
        self._threads.shutdown()
        self.envs.close()

    def _begin(self) -> Future[tuple[Episodes, Tensor]]:
        return self._threads.submit(self.collect, self.behaviour, self.iteration, self.horizon)


def step(optimizer: torch.optim.Optimizer, loss: Tensor, limit: float | None = None) -> None:
    """Take a step of an optimiser, the norm of the gradient at most `limit`."""
    optimizer.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    if limit is not None:
        nn.utils.clip_grad_norm_([p for group in optimizer.param_groups for p in group["params"]], limit)
    optimizer.step()
