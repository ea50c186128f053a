"""Short-horizon actor-critic: policy gradients through the simulator, along recorded episodes. [Xu22], [Hee15]"""

import copy
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from uvms_gym.training.episodes import Episodes
from uvms_gym.training.learner import ActorCriticParameters, Learner, step
from uvms_gym.training.networks import Actor
from uvms_gym.training.return_gradient import ReturnGradient, Windows, forward
from uvms_gym.training.run import Settings

#: Bounds on the actor's learning rate and on its factor in an iteration, and maximum norm of gradients.
RATES, FACTORS, NORM = (1e-5, 5e-3), (0.8, 1.25), 1.0
#: Time steps at which the change of the actor is measured.
PROBES = 1024


@dataclass(frozen=True)
class ShacParameters(ActorCriticParameters):
    """Hyperparameters of the short-horizon actor-critic."""

    horizon: int
    """Steps of a window, over which gradients are carried back."""
    noise: float
    """Standard deviation of the noise on actions while episodes are collected."""
    change: float
    """RMS change of actions by a gradient step, which the learning rate follows; it falls linearly to a twentieth."""
    td_lambda: float
    """Weight of rewards against values in the critic's targets."""
    batch_size: int
    """Windows in a gradient step."""
    posture: float
    """Price of the squares of observed joint coordinates, on top of the reward: far off home are the joints' stops."""
    priority: float
    """Exponent of an episode's mean cost in the probability of its windows; 0: all windows alike, once each."""


class Shac(Learner):
    """Actor that follows the gradient of its return over windows of episodes, with a critic's value at their end.

    Episodes run in the environment. Their states and actions are recorded, and the gradient is carried
    backwards along them by `ReturnGradient`. The size of a step follows the change of actions: an actor that changes
    too fast begins to oscillate, and gradients through an oscillation say little. Errors as of `Learner`.
    """

    def __init__(self, settings: Settings) -> None:
        given = self.parameters = ShacParameters.read(settings.hyperparameters)
        super().__init__(settings, given, 0.0, given.critic_arch)
        self.gradient = ReturnGradient(self.envs.inner, given.batch_size, given.gamma, given.posture)
        if not given.priority >= 0.0:
            raise ValueError(f"priority is {given.priority:g}, but must be at least 0")
        if self.envs.steps < given.horizon:
            raise ValueError(f"horizon is {given.horizon}, but episodes have {self.envs.steps} steps")
        layers = self.actor.layers.parameters()
        self._adam = torch.optim.Adam(layers, lr=given.learning_rate, betas=(0.9, 0.95), fused=True)
        self._critic_adam = torch.optim.Adam(self.critic.parameters(), lr=given.critic_learning_rate, fused=True)
        self.optimizers = {"actor": self._adam, "critic": self._critic_adam}

    @property
    def horizon(self) -> int:
        """Steps of each episode in the next iteration: complete windows."""
        window = self.parameters.horizon
        return max(super().horizon // window, 1) * window

    def collect(self, actor: Actor, iteration: int, steps: int) -> tuple[Episodes, Tensor]:
        """Run episodes with noise on the actions; returns the drawn factors (n, k) on parameters, too."""
        shape = (self.num_envs, steps, self.envs.actions)
        noise = self.parameters.noise * torch.randn(shape, generator=self.generator(iteration, "collect"))
        episodes = self.envs.run(self.seeds(iteration), actor.network(), noise, frames=True)
        return episodes, self.gradient.factors(self.envs.inner)

    def update(self, episodes: Episodes, more: Tensor, generator: torch.Generator) -> None:
        """Fit the critic, and improve the actor by all windows."""
        given, alive = self.parameters, episodes.alive
        critic = copy.deepcopy(self.critic)
        batches = _batches(int(alive.sum()), given.batch_size * given.horizon, generator)
        fit = self._threads.submit(self._fit, episodes, self._returns(episodes), alive.nonzero().T, batches)
        instances, starts = alive[:, :: given.horizon].nonzero().T
        updates = _batches(len(starts), given.batch_size, generator)
        if given.priority > 0.0:
            costs = -(episodes.rewards * alive).sum(dim=1) / alive.sum(dim=1)
            updates = _prioritized(costs[instances], given.priority, updates.shape, generator)
        for chosen in updates:
            places = instances[chosen], given.horizon * starts[chosen]
            self._improve(self._windows(episodes, more, *places, critic))
        fit.result()
        self._adapt(episodes, len(updates), generator)

    def _improve(self, windows: Windows) -> None:
        mean, pull = forward(self.actor, windows.inputs)
        with torch.no_grad():
            gradient = self.gradient(windows, pull)
        self._adam.zero_grad(set_to_none=True)
        mean.backward(gradient / -windows.alive.sum())  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.actor.layers.parameters(), NORM)
        self._adam.step()

    def _windows(
        self,
        episodes: Episodes,
        factors: Tensor,
        instances: Tensor,
        first: Tensor,
        critic: nn.Module,
    ) -> Windows:
        assert episodes.states is not None and episodes.memories is not None
        steps = first + torch.arange(self.parameters.horizon + 1)[:, None]
        now = steps[:-1]
        perfect = episodes.perfect[instances, steps]
        last = perfect[-1].clone().requires_grad_()
        (by_end,) = torch.autograd.grad(critic(last).sum(), last)
        return Windows(
            inputs=episodes.select(instances.expand_as(now).flatten(), now.flatten()).view(*now.shape, -1),
            perfect=perfect,
            actions=episodes.actions[instances, now],
            alive=episodes.alive[instances, now],
            states=episodes.states[instances, steps],
            memories=episodes.memories[instances, steps],
            factors=factors[instances],
            by_end=by_end * ~episodes.terminated[instances, now[-1]][:, None],
        )

    def _fit(self, episodes: Episodes, returns: Tensor, places: Tensor, batches: Tensor) -> None:
        """Fit the critic to the returns (n, T) at places (2, k): instances and times."""
        for i, t in (places[:, batch] for batch in batches):
            step(self._critic_adam, ((self.critic(episodes.perfect[i, t]) - returns[i, t]) ** 2).mean())

    def _returns(self, episodes: Episodes) -> Tensor:
        """Targets of the critic (n, T), by TD(lambda); a time limit does not end an episode."""
        given, goes_on = self.parameters, (~episodes.terminated).float()
        with torch.no_grad():
            values = self.critic(episodes.perfect)
        rewards = episodes.rewards - self.gradient.posture_costs(episodes.perfect)
        returns, last = torch.empty_like(rewards), values[:, -1]
        for t in reversed(range(returns.shape[1])):
            beyond = torch.lerp(values[:, t + 1], last, given.td_lambda)
            last = returns[:, t] = rewards[:, t] + given.gamma * goes_on[:, t] * beyond
        return returns

    def _adapt(self, episodes: Episodes, updates: int, generator: torch.Generator) -> None:
        instances, times = episodes.alive.nonzero().T
        some = torch.randint(len(times), (PROBES,), generator=generator)
        inputs = episodes.select(instances[some], times[some])
        with torch.no_grad():
            change = self.actor(inputs).clamp(-1.0, 1.0) - self.behaviour(inputs).clamp(-1.0, 1.0)
        # Gradient steps go nearly as a random walk.
        size = float(change.square().mean().sqrt()) / updates**0.5
        wanted = self.parameters.change * (0.05 + 0.95 * self.left)
        by = min(max(wanted / (size + 1e-9), FACTORS[0]), FACTORS[1])
        for group in self._adam.param_groups:
            group["lr"] = min(max(group["lr"] * by, RATES[0]), RATES[1])


def _batches(count: int, size: int, generator: torch.Generator) -> Tensor:
    """Batches (k, size) of all of `count` places in random order; the last one is filled up with places from before."""
    order = torch.randperm(count, generator=generator)
    number = -(-count // size)
    return order.repeat(-(-number * size // count))[: number * size].view(number, size)


def _prioritized(costs: Tensor, exponent: float, shape: torch.Size, generator: torch.Generator) -> Tensor:
    """Batches of places, each drawn with a probability in proportion to a power of its cost."""
    weights = (costs / costs.max()).clamp_min(1e-6) ** exponent
    return torch.multinomial(weights, shape.numel(), replacement=True, generator=generator).view(shape)
