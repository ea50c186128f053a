"""Training of a policy for any vehicle on drawn vehicles: imitation of MPC, then gradients of all their returns."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from torch import Tensor, nn

from uvms_gym import StepWarning
from uvms_gym.controllers import Controller
from uvms_gym.controllers.plant import Floats, Plant, plant
from uvms_gym.controllers.registry import ControllerWarning, make_controller
from uvms_gym.controllers.universal import UniversalPolicy
from uvms_gym.rollouts import RolloutStats
from uvms_gym.training.episodes import Episodes, TrainingEnvs
from uvms_gym.training.evaluation import SEED, run_episodes
from uvms_gym.training.learner import step
from uvms_gym.training.recommended import priced
from uvms_gym.training.return_gradient import ReturnGradient
from uvms_gym.training.run import SEED_STRIDE
from uvms_gym.training.universal import Sizes, UniversalNet, action_gradient, averages, forward
from uvms_gym.training.vehicles import DELAYS, LAG, NOISE, authority, draw_vehicle

ENV, TEACHER = "UVMS-StationKeep-Storm-v0", "mpc"
#: The certified step.
STEP = {"dtype": "float32", "dt": 0.025, "substeps": 4, "threads": 1}
#: Acceleration from which on prices are full, m/s^2: thrust that moves a vehicle little is to be cheap.
CHEAP = 2.0
#: Stream of the vehicles that no training sees, relative to the training seed, and episodes of each in evaluations.
HELD_OUT, EVALUATED = 1_000_000, 64
#: Imitation: rounds of episodes, gradient steps after each, vehicles and time steps of each in a step, learning rate.
ROUNDS, UPDATES, IMITATED, IMITATION_RATE = 4, 400, (12, 192), 2e-3
#: Improvement: vehicles in an iteration, windows in a gradient step, steps of a window, discount, last rate's share.
GROUP, ROWS, HORIZON, GAMMA, LAST = 8, 32, 25, 0.95, 0.03
#: Noise on actions over the deviation of the teacher's, and maximum gradient of a vehicle over the group's median.
EXPLORATION, OUTLYING, NORM = 0.3, 2.0, 1.0


@dataclass(frozen=True)
class FleetSettings:
    """Settings, which determine a run bit for bit."""

    frames: int
    """Control periods of the improvement."""
    seed: int = 0
    vehicles: int = 80
    """Number of drawn vehicles."""
    episodes: int = 8
    """Episodes of a vehicle in an iteration."""
    spans: tuple[int, ...] = Sizes().spans
    """Number of successive observations in each average of the policy's input, oldest first."""
    effort: float = 0.08
    """Cost of the teacher's effort relative to that of its pose error; less for vehicles of little authority."""
    action_rate: float = 0.012
    """Cost of its changes of the action."""
    rate: float = 1e-3
    """Initial learning rate of the improvement, which falls linearly."""
    start: str | None = None
    """File of the policy to begin with; None: imitation."""


class DrawnVehicle:
    """A drawn vehicle in training: environment, physics, and gradient of the return.

    Parameters
    ----------
    stream, number : int
        See `draw_vehicle`.
    settings : FleetSettings
    reward : dict or None
        Weights of the reward; None: by the costs of the teacher on this vehicle.
    """

    def __init__(
        self, stream: int, number: int, settings: FleetSettings, reward: Mapping[str, float] | None = None
    ) -> None:
        kwargs: dict[str, Any] = {**STEP, **draw_vehicle(stream, number).env_kwargs}
        if reward is None:
            share = min(1.0, authority(draw_vehicle(stream, number).scene) / CHEAP)
            prices = {"effort": share * settings.effort, "action_rate": share * settings.action_rate}
            reward = priced(ENV, kwargs, reference=TEACHER, **prices)
        self.kwargs = {**kwargs, "reward": dict(reward)}
        self.envs = TrainingEnvs(ENV, self.kwargs, settings.episodes, sum(settings.spans))
        noise = kwargs["disturbance"]["noise"]
        self.plant: Plant = plant(self.envs.inner._native, kwargs["thruster_lag"], noise)
        self.gradient = ReturnGradient(self.envs.inner, ROWS, GAMMA)
        #: Standard deviation of the teacher's actions, by entry.
        self.spread = torch.full((6,), 0.1)

    def run(self, net: UniversalNet, seeds: list[int], noise: Tensor, **more: Any) -> Episodes:
        """Run an episode of every seed with noise (n, T, 6) in units of `spread`."""
        with quiet():
            return self.envs.run(seeds, net.network(self.plant, self.envs.inner), noise * self.spread, **more)

    def imitation(self, net: UniversalNet, seeds: list[int], noise: Tensor | None) -> tuple[Tensor, Tensor]:
        """Averages (k, s, f, 6) of episodes, and accelerations (k, 6) of the teacher with perfect sensors.

        The teacher acts where there is no noise, else the policy.
        """
        with quiet():
            teacher: Any = make_controller(TEACHER, self.envs.inner)
        teacher = type(teacher)(self.envs.inner, **{**teacher.gains, "delay": 0})
        given = torch.zeros((len(seeds), self.envs.steps, 6)) if noise is None else noise
        episodes = self.run(net, seeds, given, teacher=teacher, teacher_acts=noise is None)
        assert episodes.targets is not None
        targets = episodes.targets[episodes.alive]
        if noise is None:
            self.spread = targets.std(dim=0).clamp_min(0.005)
        acted = torch.from_numpy(self.plant.acted.astype(np.float32))
        seen = averages(episodes.observations, self.plant, net.spans)[episodes.alive]
        return seen, torch.linalg.solve(acted, targets.T).T

    def score(self, controller: Controller) -> RolloutStats:
        """Statistics of episodes that no training sees."""
        with quiet():
            envs = gymnasium.make_vec(ENV, num_envs=EVALUATED, **self.kwargs)
            stats = run_episodes(envs, controller, SEED, self.envs.steps)
            envs.close()
        return stats


class Fleet:
    """Training on drawn vehicles.

    An iteration has episodes of a group of vehicles, and gradient steps on windows of all of these. Seeds and random
    numbers follow from the training seed and the number of the iteration, so that a run does not depend on stops.

    Parameters
    ----------
    settings : FleetSettings
    state : mapping or None
        State of `state` to go on from.

    Raises
    ------
    ValueError, OSError
        The initial policy does not fit, or cannot be read.
    """

    def __init__(self, settings: FleetSettings, state: Mapping[str, Any] | None = None) -> None:
        self.settings, self.iteration, self.steps = settings, 0, 0
        self.net = UniversalNet(Sizes(spans=settings.spans), settings.seed)
        seen: list[Floats] = []
        if settings.start is not None:
            start = UniversalPolicy.load(Path(settings.start))
            self.net.load(start)
            seen.append(start.limits)
        rewards = state["rewards"] if state else [None] * settings.vehicles
        self.vehicles = [DrawnVehicle(settings.seed, k, settings, reward) for k, reward in enumerate(rewards)]
        seen += [vehicle.plant.features for vehicle in self.vehicles]
        #: Least and largest features of all vehicles (2, p), those of the initial policy's training included.
        self.limits: Floats = np.stack([np.concatenate(seen).min(axis=0), np.concatenate(seen).max(axis=0)])
        self._adam = torch.optim.Adam(self.net.parameters(), lr=settings.rate, betas=(0.9, 0.95))
        if state is not None:
            self.iteration, self.steps = state["iteration"], state["steps"]
            self.net.load_state_dict(state["net"])
            self._adam.load_state_dict(state["adam"])
            for vehicle, spread in zip(self.vehicles, state["spread"], strict=True):
                vehicle.spread = spread

    def state(self) -> dict[str, Any]:
        """State that resumes the run bit-identically."""
        return {
            "iteration": self.iteration,
            "steps": self.steps,
            "net": self.net.state_dict(),
            "adam": self._adam.state_dict(),
            "rewards": [vehicle.kwargs["reward"] for vehicle in self.vehicles],
            "spread": [vehicle.spread for vehicle in self.vehicles],
        }

    @property
    def left(self) -> float:
        """Share of the run that is left, 1 to 0."""
        return max(0.0, 1.0 - self.steps / self.settings.frames)

    def imitate(self) -> Iterator[float]:
        """Learn the teacher's actions, in rounds; yields the mean squared error of each, over the actions' variance.

        With an initial policy the teacher's actions are measured only.
        """
        adam = torch.optim.Adam(self.net.parameters(), lr=IMITATION_RATE, betas=(0.9, 0.95))
        data: list[list[tuple[Tensor, Tensor]]] = [[] for _ in self.vehicles]
        rounds = ROUNDS if self.settings.start is None else 1
        for k in range(rounds):
            generator, total = self._generator(k, 0), 0.0
            for vehicle, own in zip(self.vehicles, data, strict=True):
                noise = EXPLORATION * self._noise(vehicle, generator)
                own.append(vehicle.imitation(self.net, self._seeds(-ROUNDS + k), noise if k else None))
            if self.settings.start is not None:
                return
            for i in range(UPDATES):
                adam.param_groups[0]["lr"] = IMITATION_RATE * max(1.0 - (k + i / UPDATES) / rounds, 0.02)
                loss = self._imitation_loss(data, generator)
                step(adam, loss, NORM)
                total += float(loss.detach()) / UPDATES
            yield total

    def _imitation_loss(self, data: list[list[tuple[Tensor, Tensor]]], generator: torch.Generator) -> Tensor:
        loss, (count, rows) = torch.zeros(()), IMITATED
        for n in torch.randperm(len(data), generator=generator)[:count].tolist():
            seen, targets = data[n][int(torch.randint(len(data[n]), (1,), generator=generator))]
            some = torch.randint(len(seen), (rows,), generator=generator)
            features = torch.from_numpy(self.vehicles[n].plant.features.astype(np.float32))
            out, _ = forward(self.net.weights(features), seen[some])
            loss = loss + ((out - targets[some]) / targets.std(dim=0).mean()).square().mean() / count
        return loss

    def iterate(self) -> float:
        """Improve the policy by episodes of a group of vehicles; returns their mean cost of a control period."""
        generator, given = self._generator(self.iteration, 1), self.settings
        group, cost, parts = self._group(), 0.0, []
        for vehicle in group:
            noise = EXPLORATION * self._noise(vehicle, generator)
            episodes = vehicle.run(self.net, self._seeds(self.iteration), noise, frames=True)
            factors = vehicle.gradient.factors(vehicle.envs.inner)
            windows = episodes.alive[:, : vehicle.envs.steps // HORIZON * HORIZON : HORIZON].nonzero()
            windows = windows[torch.randperm(len(windows), generator=generator)]
            seen = averages(episodes.observations, vehicle.plant, self.net.spans)
            parts.append((vehicle, episodes, factors, seen, windows))
            self.steps += int(episodes.alive.sum())
            cost -= float(episodes.rewards[episodes.alive].mean()) / len(group)
        self._adam.param_groups[0]["lr"] = given.rate * (LAST + (1.0 - LAST) * self.left)
        for first in range(0, min(len(windows) for *_, windows in parts) - ROWS + 1, ROWS):
            found = []
            for vehicle, episodes, factors, seen, windows in parts:
                instances, starts = windows[first : first + ROWS].T
                at = instances, HORIZON * starts
                found.append(
                    action_gradient(self.net, vehicle.plant, vehicle.gradient, episodes, factors, seen, at, HORIZON)
                )
            most = OUTLYING * float(np.median([one.size for one in found]))
            self._adam.zero_grad(set_to_none=True)
            for one in found:
                one.backward(min(1.0, most / max(one.size, 1e-30)) / len(found))
            nn.utils.clip_grad_norm_(self.net.parameters(), NORM)
            self._adam.step()
        self.iteration += 1
        return cost

    @property
    def conditions(self) -> dict[str, Any]:
        """Ranges of delay (control periods), lag (s) and noise (over the storm's)."""
        return {"delay": [min(DELAYS), max(DELAYS)], "lag": list(LAG), "noise": list(NOISE)}

    def _group(self) -> list[DrawnVehicle]:
        """Vehicles of the iteration: all of them in turn, in a random order."""
        each = max(1, len(self.vehicles) // GROUP)
        order = np.random.default_rng([self.settings.seed, self.iteration // each]).permutation(len(self.vehicles))
        first = self.iteration % each * GROUP
        return [self.vehicles[k] for k in order[first : first + GROUP]]

    def _seeds(self, iteration: int) -> list[int]:
        first = SEED_STRIDE * (1 + self.settings.seed) + (ROUNDS + iteration) * self.settings.episodes
        return list(range(first, first + self.settings.episodes))

    def _noise(self, vehicle: DrawnVehicle, generator: torch.Generator) -> Tensor:
        return torch.randn((self.settings.episodes, vehicle.envs.steps, 6), generator=generator)

    def _generator(self, iteration: int, purpose: int) -> torch.Generator:
        return torch.Generator().manual_seed((self.settings.seed * 1_000_003 + iteration) * 2 + purpose)


@contextmanager
def quiet() -> Iterator[None]:
    """Gains and steps that are not for a drawn vehicle serve it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ControllerWarning)
        warnings.simplefilter("ignore", StepWarning)
        yield
