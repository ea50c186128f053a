"""Short-horizon actor-critic beside PPO: pose error over time, and the quality of their gradients.

    python tests/bench/policy_gradients.py [--seeds 3] [--share 1.0]

Both learn station keeping in the storm from scratch with their shipped hyperparameters, in turns, an eighth of a run
each time; evaluations are not timed. Then, at an error of at most 40 mm, the cosine between gradients of independent
batches, and the time of the parts of a gradient step.
"""

import argparse
import itertools
import statistics
import time
import warnings
from collections import defaultdict
from typing import Any

import torch

from uvms_gym import StepWarning
from uvms_gym.training.asymmetric_ppo import AsymmetricPPO
from uvms_gym.training.evaluation import evaluate
from uvms_gym.training.hyperparameters import read_hyperparameters
from uvms_gym.training.learner import Learner
from uvms_gym.training.native import make_learner
from uvms_gym.training.return_gradient import forward
from uvms_gym.training.run import Settings
from uvms_gym.training.shac import Shac

ENV, ALGORITHMS = "UVMS-StationKeep-Storm-v0", ("shac", "asymmetric-ppo")
#: Parts of a run between evaluations; errors whose times are reported, mm; episodes of an evaluation.
PARTS, ERRORS, EPISODES = 8, (50.0, 40.0, 35.0, 28.5, 26.0, 24.0, 22.5), 256
#: Independent batches of gradients.
BATCHES = 8


class Run:
    """A learner with its time and its errors so far."""

    def __init__(self, algo: str, seed: int, share: float) -> None:
        found = read_hyperparameters(ENV, algo=algo)
        found["n_timesteps"] = int(share * found["n_timesteps"])
        self.settings = Settings(ENV, found, seed=seed, algo=algo)
        begun, used = time.perf_counter(), time.process_time()
        self.learner = make_learner(self.settings)
        self.wall, self.processor = time.perf_counter() - begun, time.process_time() - used
        #: Wall time and time of processors, s; error, mm; variation of commands.
        self.curve: list[tuple[float, float, float, float]] = []

    def advance(self) -> None:
        """Learn a part, and evaluate the policy."""
        learner, begun, used = self.learner, time.perf_counter(), time.process_time()
        until = learner.steps + self.settings.steps / PARTS
        while learner.steps < until and learner.left > 0.0:
            learner.iterate()
        if learner._pending is not None:
            learner._pending.result()
        self.wall += time.perf_counter() - begun
        self.processor += time.process_time() - used
        policy = learner.actor.policy(learner.envs.inner)
        found = evaluate(ENV, self.settings.kwargs, policy, EPISODES)
        self.curve.append((self.wall, self.processor, 1e3 * found["pose"], found["variation"]))

    def first(self, error: float, column: int) -> float:
        """Time at which the error is reached first, s; infinite if it is not."""
        return next((point[column] for point in self.curve if point[2] <= error), float("inf"))


def gradient(learner: Learner, number: int) -> tuple[torch.Tensor, int]:
    """The actor's gradient from a batch of new episodes, and its number of time steps."""
    parameters = list(learner.actor.layers.parameters())
    episodes, more = learner.collect(learner.actor, 10_000 + number, learner.horizon)
    generator = torch.Generator().manual_seed(number)
    if isinstance(learner, Shac):
        size = learner.parameters.horizon
        instances, starts = episodes.alive[:, ::size].nonzero().T
        some = torch.randperm(len(starts), generator=generator)[: learner.parameters.batch_size]
        windows = learner._windows(episodes, more, instances[some], size * starts[some], learner.critic)
        mean, pull = forward(learner.actor, windows.inputs)
        objective = (mean * learner.gradient(windows, pull).detach()).sum()
        count = int(windows.alive.sum())
    else:
        assert isinstance(learner, AsymmetricPPO)
        count = int(episodes.alive.sum())
        density = learner.actor.log_prob(learner.actor(episodes.inputs), episodes.actions)
        objective = (density * learner.estimate(episodes)[0] * episodes.alive).sum()
    return torch.cat([part.flatten() for part in torch.autograd.grad(objective, parameters)]), count


def parts(learner: Shac) -> dict[str, float]:
    """Time of the parts of a gradient step per time step of an episode, us of this thread."""
    spent: dict[str, float] = defaultdict(float)

    def timed(name: str, call: Any) -> Any:
        def measured(*arguments: Any, **named: Any) -> Any:
            begun = time.thread_time()
            result = call(*arguments, **named)
            spent[name] += time.thread_time() - begun
            return result

        return measured

    class Timed:
        def __init__(self, simulator: Any) -> None:
            self.state_size, self.scale_parameters = simulator.state_size, simulator.scale_parameters
            self.set_state, self.step_vjp = (
                timed(f"simulator: {name}", getattr(simulator, name)) for name in ("set_state", "step_vjp")
            )

    episodes, factors = timed("episodes, in a thread of their own", learner.collect)(
        learner.actor, 20_000, learner.horizon
    )
    rows, size = torch.arange(learner.parameters.batch_size) % learner.num_envs, learner.parameters.horizon
    windows = timed("choice of windows", learner._windows)(episodes, factors, rows, 0 * rows, learner.critic)
    simulator, learner.gradient.simulator = learner.gradient.simulator, Timed(learner.gradient.simulator)  # type: ignore[assignment]
    timed("gradient step in all", learner._improve)(windows)
    mean, pull = timed("policy: forward", forward)(learner.actor, windows.inputs)
    timed("policy: backward", mean.backward)(torch.zeros_like(mean))
    learner.gradient(windows, timed("policy: back to inputs", pull))
    learner.gradient.simulator = simulator
    for name in spent:
        # The simulator's parts have run twice.
        steps = episodes.alive.numel() if name.startswith("episodes") else len(rows) * size
        spent[name] *= 1e6 / steps / (2 if name.startswith("simulator") else 1)
    return spent


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="number of training seeds, from 0 on")
    parser.add_argument("--share", type=float, default=1.0, help="share of the shipped numbers of steps")
    options = parser.parse_args()
    torch.set_num_threads(1)
    # Untrained policies tumble faster than the step can follow.
    warnings.simplefilter("ignore", StepWarning)
    # The first learner loads libraries.
    Run("shac", 0, 1.0).learner.close()
    runs: dict[str, list[Run]] = {algo: [] for algo in ALGORITHMS}
    for seed in range(options.seeds):
        pair = [Run(algo, seed, options.share) for algo in ALGORITHMS]
        for _, run in itertools.product(range(PARTS), pair):
            if run.learner.left == 0.0:
                continue
            run.advance()
            wall, processor, error, variation = run.curve[-1]
            line = f"seed {seed}  {run.learner.steps:8} steps  {wall:6.1f} s  {processor:6.1f} s of processors"
            print(f"{run.settings.algo:<16}{line}  {error:6.1f} mm  variation {variation:.3f}", flush=True)
        for run in pair:
            runs[run.settings.algo].append(run)
    print("\nmedian wall time, s, and time of processors, s, to a pose error")
    for error in ERRORS:
        cells = [statistics.median(run.first(error, k) for run in runs[algo]) for algo in ALGORITHMS for k in (0, 1)]
        print(f"{error:6.1f} mm" + "".join(f"{cell:10.1f}" for cell in cells))
    print("\ncosine between gradients of independent batches, and with the sum of the others")
    for algo in ALGORITHMS:
        run = Run(algo, 0, options.share)
        while run.learner.left > 0.0 and not (run.curve and run.curve[-1][2] <= 40.0):
            run.advance()
        found = [gradient(run.learner, number) for number in range(BATCHES)]
        pairs = [float(torch.cosine_similarity(a[0], b[0], dim=0)) for a, b in itertools.combinations(found, 2)]
        total = sum(vector for vector, _ in found)
        others = [float(torch.cosine_similarity(vector, total - vector, dim=0)) for vector, _ in found]
        figures = f"{statistics.mean(pairs):6.3f}  {statistics.mean(others):6.3f}"
        print(f"{algo:<16}{figures}  of {found[0][1]} time steps at {run.curve[-1][2]:.1f} mm")
        if isinstance(run.learner, Shac):
            repeats = [parts(run.learner) for _ in range(20)]
            print("\nus of a thread per time step")
            for name in repeats[0]:
                print(f"{name:<36}{min(repeat[name] for repeat in repeats):8.2f}")
            print()


if __name__ == "__main__":
    main()
