"""Worth of a policy's memory: python tests/bench/memories.py [EPISODES [STEPS]] (extra train; 15 minutes).

MPC keeps station in the storm, and networks learn by regression what MPC would do with perfect sensors, from what a
policy may see: stacked observations, averages of older ones, the state of MPC's observer (errors of the pose, twist,
wrenches and thrust), or all observations through gated recurrent units. Printed: the RMS error of actions in the last
quarter of the episodes, whose seeds no network has seen, over three training seeds, and the processor time of training.
"""

import sys
import time
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import torch
from torch import Tensor, nn

from uvms_gym import ControllerWarning, make_controller

ENV = "UVMS-StationKeep-Storm-v0"
#: First seed of the episodes, control periods of each, and those that are not counted while observers settle.
FIRST, PERIODS, SETTLING = 10_000_000, 200, 20
#: Averages over 70 observations, as in `frame_stack`.
AVERAGES = (32, 16, 8, 4, 4, 1, 1, 1, 1, 1, 1, 1)
BATCH, RATE, SEEDS = 1024, 2e-3, (0, 1, 2)
#: Periods of a window for the recurrent network, of which the first ones only fill its memory; windows of a batch.
WINDOW, FILLING, WINDOWS = 100, 20, 16


def record(episodes: int) -> tuple[Tensor, Tensor, Tensor]:
    """Observations (n, T, d), actions of MPC with perfect sensors (n, T, a), and the observer's state (n, T, e)."""
    envs = gymnasium.make_vec(ENV, num_envs=episodes, dtype="float32", dt=0.025, substeps=4)
    warnings.simplefilter("ignore", ControllerWarning)
    mpc = make_controller("mpc", envs)
    task: Any = envs.unwrapped
    teacher: Any = make_controller("mpc", envs)
    teacher = type(teacher)(task, **{**teacher.gains, "delay": 0})
    layout = mpc.memory_layout
    estimate = slice(layout["pose_error"].start, layout["arm"].start)
    seeds: Any = [FIRST + i for i in range(episodes)]
    observations, _ = envs.reset(seed=seeds)
    rows, state, taught = [], None, None
    for t in range(PERIODS):
        begins = np.full(episodes, t == 0)
        actions, state = mpc.predict(observations, state, episode_start=begins)
        wanted, taught = teacher.predict(task.perfect_observations(), taught, episode_start=begins)
        rows.append((observations.copy(), wanted, state[:, estimate].astype(np.float32)))
        observations = envs.step(actions)[0]
    seen, targets, known = (torch.from_numpy(np.stack(column, 1)) for column in zip(*rows, strict=True))
    return seen, targets, (known - known.mean((0, 1))) / known.std((0, 1)).clamp_min(1e-6)


def averages(observations: Tensor, spans: tuple[int, ...]) -> Tensor:
    """Averages over successive observations, oldest first; zeros before the first one."""
    n, periods, d = observations.shape
    sums = torch.cat([torch.zeros(n, sum(spans), d), observations], 1).cumsum(1)
    parts, first = [], 0
    for span in spans:
        parts.append((sums[:, first + span :][:, :periods] - sums[:, first:][:, :periods]) / span)
        first += span
    return torch.cat(parts, -1)


class Recurrent(nn.Module):
    """64 gated recurrent units, and a layer on them and the present observation."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.units = nn.GRU(inputs, 64, batch_first=True)
        self.out = nn.Sequential(nn.Linear(64 + inputs, 128), nn.Tanh(), nn.Linear(128, outputs))

    def forward(self, observations: Tensor) -> Tensor:
        """Actions (n, T, a)."""
        return self.out(torch.cat([self.units(observations)[0], observations], -1))  # type: ignore[no-any-return]


def fit(net: nn.Module, steps: int, batch: Callable[[], tuple[Tensor, Tensor]]) -> float:
    """Regress the last rows of outputs onto targets by Adam; returns the processor time, s."""
    start, adam = time.process_time(), torch.optim.Adam(net.parameters(), RATE)
    for step in range(steps):
        for group in adam.param_groups:
            group["lr"] = RATE * max(1.0 - step / steps, 0.02)
        x, target = batch()
        adam.zero_grad()
        ((net(x)[:, -target.shape[1] :] - target) ** 2).mean().backward()
        nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        adam.step()
    return time.process_time() - start


def main(episodes: int = 2048, steps: int = 5000) -> None:
    """Print the table."""
    torch.set_num_threads(1)
    seen, targets, known = record(episodes)
    learned, outputs = 3 * episodes // 4, targets.shape[-1]
    last_4, long = averages(seen, (1,) * 4), averages(seen, AVERAGES)
    inputs = {
        "4 observations": last_4,
        "10 observations": averages(seen, (1,) * 10),
        "averages over 70 observations": long,
        "1 observation and the observer's state": torch.cat([seen, known], -1),
        "4 observations and the observer's state": torch.cat([last_4, known], -1),
        "averages and the observer's state": torch.cat([long, known], -1),
        "all, by recurrent units": seen,
    }
    spread = float(targets[learned:, SETTLING:].square().mean().sqrt())
    print(f"RMS of the actions: {spread:.4f}; RMS errors by training seed, and processor time, s:")

    def rows(x: Tensor) -> tuple[Tensor, Tensor]:
        i, t = torch.randint(learned, (BATCH,)), torch.randint(PERIODS, (BATCH,))
        return x[i, t], targets[i, t]

    def windows() -> tuple[Tensor, Tensor]:
        i, t = torch.randint(learned, (WINDOWS,)), int(torch.randint(PERIODS - WINDOW + 1, ()))
        return seen[i, t : t + WINDOW], targets[i, t + FILLING : t + WINDOW]

    for name, x in inputs.items():
        errors, seconds = [], 0.0
        for seed in SEEDS:
            torch.manual_seed(seed)
            net: nn.Module
            if x is seen:
                net = Recurrent(x.shape[-1], outputs)
                seconds += fit(net, steps // 3, windows)
            else:
                net = nn.Sequential(
                    nn.Linear(x.shape[-1], 128), nn.Tanh(), nn.Linear(128, 128), nn.Tanh(), nn.Linear(128, outputs)
                )
                seconds += fit(net, steps, partial(rows, x))
            with torch.no_grad():
                error = net(x[learned:])[:, SETTLING:] - targets[learned:, SETTLING:]
            errors.append(float(error.square().mean().sqrt()))
        print(f"{name:<40}{', '.join(f'{error:.4f}' for error in errors)}  {seconds / len(SEEDS):5.0f}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
