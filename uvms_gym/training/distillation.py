"""Distillation of a controller with perfect sensors into a policy with real ones (DAgger). [Ros11]"""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from uvms_gym.controllers.families import MLP_PREFIX, TEACHERS, canonical, is_learned, names
from uvms_gym.controllers.registry import ControllerWarning, make_controller
from uvms_gym.training.episodes import Episodes
from uvms_gym.training.learner import Hyperparameters, Learner, step
from uvms_gym.training.networks import Actor
from uvms_gym.training.run import Settings


@dataclass(frozen=True)
class DistillationParameters(Hyperparameters):
    """Hyperparameters of distillation."""

    learning_rate: float
    """Learning rate of Adam at the start; it falls linearly to a fiftieth."""
    n_updates: int
    """Gradient steps per iteration."""
    batch_size: int
    """Pairs of successive time steps in a gradient step."""
    noise: float
    """Standard deviation of the noise on actions while episodes are collected."""
    action_rate: float
    """Price of the squared change between successive actions, relative to the squared error."""


class Distillation(Learner):
    """Regression of the actor, which acts on the environment's observations, onto a teacher's actions.

    The teacher sees the perfect observations. It is a classical controller with its tuned gains, without compensation
    of a delay that they do not have, or a policy (`mlp:FILE`) that was trained on such observations. It acts in the
    first iteration, the actor in all others. Errors as of `Learner`; any other teacher is a `ValueError`.
    """

    def __init__(self, settings: Settings) -> None:
        self.parameters = DistillationParameters.read(settings.hyperparameters)
        super().__init__(settings, self.parameters, 0.0)
        self._adam = torch.optim.Adam(self.actor.layers.parameters(), lr=self.parameters.learning_rate, fused=True)
        self.optimizers = {"actor": self._adam}
        inner = self.envs.inner
        self.teacher_name = canonical(settings.teacher or TEACHERS[inner.task], task=inner.task)
        learned = self.teacher_name.startswith(MLP_PREFIX)
        if not learned and is_learned(self.teacher_name):
            known = ", ".join(names(inner.task, learned=False))
            raise ValueError(f"teacher is {self.teacher_name!r}, but must be {MLP_PREFIX}FILE or classical: {known}")
        with warnings.catch_warnings():
            # Its delay is removed below.
            warnings.simplefilter("ignore", ControllerWarning)
            teacher: Any = make_controller(self.teacher_name, inner)
        if not learned and teacher.gains.get("delay"):
            teacher = type(teacher)(inner, **{**teacher.gains, "delay": 0})
        self.teacher = teacher

    def collect(self, actor: Actor, iteration: int, steps: int) -> tuple[Episodes, Tensor]:
        """Run episodes; returns the teacher's actions (n, T, a), too."""
        first, network = iteration == 0, actor.network()
        shape = (self.num_envs, steps, self.envs.actions)
        noise = torch.randn(shape, generator=self.generator(iteration, "collect"))
        noise *= 0.0 if first else self.parameters.noise
        episodes = self.envs.run(self.seeds(iteration), network, noise, self.teacher, teacher_acts=first)
        assert episodes.targets is not None
        return episodes, episodes.targets

    def update(self, episodes: Episodes, more: Tensor, generator: torch.Generator) -> None:
        """Regress the actor onto the teacher's actions in pairs of successive steps."""
        given, targets = self.parameters, more
        for group in self._adam.param_groups:
            # Not 0 in the last iteration.
            group["lr"] = given.learning_rate * max(self.left, 0.02)
        pairs = (episodes.alive[:, 1:]).nonzero()
        for _ in range(given.n_updates):
            i, t = pairs[torch.randint(len(pairs), (given.batch_size,), generator=generator)].T
            before, now = self.actor(episodes.select(i, t)), self.actor(episodes.select(i, t + 1))
            error = (before - targets[i, t]) ** 2 + (now - targets[i, t + 1]) ** 2
            step(self._adam, (0.5 * error + given.action_rate * (now - before) ** 2).mean())

    def notes(self) -> dict[str, str]:
        """Teacher."""
        return {"teacher": Path(self.teacher_name.removeprefix(MLP_PREFIX)).name}
