"""Proximal policy optimisation with an asymmetric critic and paired episodes. [Sch17], [Pin17], [Mao18]"""

import itertools
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from uvms_gym.training.episodes import Episodes
from uvms_gym.training.learner import ActorCriticParameters, Learner, step
from uvms_gym.training.networks import Actor
from uvms_gym.training.run import Settings

#: Bounds on the actor's learning rate, factor of its adaptation, and maximum norm of gradients.
RATES, ADAPTATION, NORM = (1e-5, 3e-3), 1.5, 0.5
#: Epochs of the critic in the first iteration.
FIRST_EPOCHS = 10


@dataclass(frozen=True)
class AsymmetricPPOParameters(ActorCriticParameters):
    """Hyperparameters of PPO with an asymmetric critic."""

    replicas: int
    """Episodes with the same seed, an even number: their noise on actions differs, in pairs by its sign."""
    log_std: float
    """Logarithm of the initial standard deviation of actions."""
    target_kl: float
    """Divergence of the actor in an iteration, which its learning rate follows; it falls linearly to a tenth."""
    gae_lambda: float
    """Discount of generalised advantage estimation."""
    clip_range: float
    """Range of the ratio of densities."""
    n_epochs: int
    """Epochs per iteration."""
    batch_size: int
    """Time steps in a gradient step."""


class AsymmetricPPO(Learner):
    """PPO whose critic sees perfect observations, on paired episodes.

    Episodes with the same seed meet the same disturbances. The mean over them of the advantages at a time step is
    subtracted: what no action could have changed, such as pushes, cancels. Errors as of `Learner`.
    """

    def __init__(self, settings: Settings) -> None:
        given = self.parameters = AsymmetricPPOParameters.read(settings.hyperparameters)
        self.replicas = given.replicas
        super().__init__(settings, given, given.log_std, given.critic_arch)
        if self.replicas % 2 or self.num_envs % self.replicas:
            raise ValueError(f"replicas is {self.replicas}, but must be even and divide n_envs ({self.num_envs})")
        self._adam = torch.optim.Adam(self.actor.parameters(), lr=given.learning_rate, fused=True)
        self._critic_adam = torch.optim.Adam(self.critic.parameters(), lr=given.critic_learning_rate, fused=True)
        self.optimizers = {"actor": self._adam, "critic": self._critic_adam}

    def collect(self, actor: Actor, iteration: int, steps: int) -> tuple[Episodes, Tensor]:
        """Run episodes with noise on the actions; returns the logarithms of the actions' densities (n, T), too."""
        shape = (self.num_envs // 2, steps, self.envs.actions)
        half = torch.randn(shape, generator=self.generator(iteration, "collect"))
        unit, log_std = torch.stack([half, -half], dim=1).flatten(0, 1), actor.log_std.detach()
        network = actor.network()
        episodes = self.envs.run(self.seeds(iteration), network, unit * log_std.exp())
        return episodes, -(0.5 * unit**2 + log_std).sum(dim=-1)

    def update(self, episodes: Episodes, more: Tensor, generator: torch.Generator) -> None:
        """Fit the critic, and improve the actor."""
        given, alive = self.parameters, episodes.alive
        advantages, returns = self.estimate(episodes)
        instances, times = alive.nonzero().T
        critic_epochs = FIRST_EPOCHS if self.iteration == 1 else given.n_epochs
        batches = [
            torch.split(torch.randperm(len(times), generator=generator), given.batch_size)
            for _ in range(max(critic_epochs, given.n_epochs))
        ]
        fit = self._threads.submit(self._fit, episodes.perfect, returns, instances, times, batches[:critic_epochs])
        divergences: list[Tensor] = []
        for epoch in range(given.n_epochs):
            for batch in batches[epoch]:
                i, t = instances[batch], times[batch]
                actions, advantage = episodes.actions[i, t], advantages[i, t]
                log_ratio = self.actor.log_prob(self.actor(episodes.select(i, t)), actions) - more[i, t]
                ratio = log_ratio.exp()
                clipped = ratio.clamp(1.0 - given.clip_range, 1.0 + given.clip_range)
                step(self._adam, -torch.min(ratio * advantage, clipped * advantage).mean(), NORM)
                if epoch == given.n_epochs - 1:
                    divergences.append((ratio - 1.0 - log_ratio).detach().mean())
        fit.result()
        self._adapt(float(torch.stack(divergences).mean()))

    def _fit(self, perfect: Tensor, returns: Tensor, instances: Tensor, times: Tensor, epochs: list[Any]) -> None:
        """Fit the critic to the returns (n, T), epochs of batches of time steps."""
        steps = perfect.shape[1]
        observations = perfect.flatten(0, 1)
        for batch in itertools.chain.from_iterable(epochs):
            i, t = instances[batch], times[batch]
            values = self.critic(observations.index_select(0, i * steps + t))
            step(self._critic_adam, ((values - returns[i, t]) ** 2).mean())

    def estimate(self, episodes: Episodes) -> tuple[Tensor, Tensor]:
        """Normalised advantages, minus their mean over episodes of a seed, and returns (n, T)."""
        alive = episodes.alive
        with torch.no_grad():
            values = self.critic(episodes.perfect)
            advantages = self._advantages(values, episodes)
            returns = advantages + values[:, :-1]
            groups = (advantages * alive).view(-1, self.replicas, alive.shape[1])
            members = alive.view(groups.shape).sum(dim=1, keepdim=True).clamp(min=1)
            advantages = (groups - groups.sum(dim=1, keepdim=True) / members).flatten(0, 1)
            return advantages / (advantages[alive].std() + 1e-8), returns

    def _advantages(self, values: Tensor, episodes: Episodes) -> Tensor:
        """Generalised advantage estimation, (n, T); a time limit does not end an episode."""
        given, goes_on = self.parameters, (~episodes.terminated).float()
        differences = episodes.rewards + given.gamma * goes_on * values[:, 1:] - values[:, :-1]
        advantages, last = torch.zeros_like(differences), torch.zeros(len(values))
        for t in reversed(range(differences.shape[1])):
            last = differences[:, t] + given.gamma * given.gae_lambda * goes_on[:, t] * last
            advantages[:, t] = last
        return advantages

    def _adapt(self, divergence: float) -> None:
        target = self.parameters.target_kl * (0.1 + 0.9 * self.left)
        by = 1.0 / ADAPTATION if divergence > 2.0 * target else ADAPTATION if divergence < 0.5 * target else 1.0
        for group in self._adam.param_groups:
            group["lr"] = min(max(group["lr"] * by, RATES[0]), RATES[1])
