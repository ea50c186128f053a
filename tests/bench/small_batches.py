"""Processor time of a step of few environments, and of a control period of a controller in a closed loop.

Prints the shortest of several repetitions in microseconds, as JSON: `python tests/bench/small_batches.py`. Two builds
are compared by runs in turns, with `PYTHONPATH` of each. Needs the extra `train`.
"""

import json
import time
import warnings
from collections.abc import Callable

import gymnasium
import numpy as np

import uvms_gym
from uvms_gym.sb3 import make_vec_env

ENV, STORM, PERIODS = "UVMS-StationKeep-v0", "UVMS-StationKeep-Storm-v0", 150


def shortest(call: Callable[[], object], calls: int, repetitions: int = 5) -> float:
    """Processor time of a call, us: the shortest mean of some repetitions."""
    times = []
    for _ in range(repetitions):
        start = time.process_time()
        for _ in range(calls):
            call()
        times.append((time.process_time() - start) / calls)
    return 1e6 * min(times)


def main() -> None:
    """Print all times."""
    warnings.simplefilter("ignore")
    found = {}
    env = gymnasium.make(ENV)
    env.reset(seed=0)

    def step() -> None:
        if any(env.step(np.zeros(6, np.float32))[2:4]):
            env.reset()

    found["gymnasium.make"] = shortest(step, 2000)
    for count in (8, 64):
        envs, actions = gymnasium.make_vec(ENV, num_envs=count), np.zeros((count, 6), np.float32)
        envs.reset(seed=0)
        found[f"make_vec, {count}"] = shortest(lambda envs=envs, actions=actions: envs.step(actions), 500)
    venv = make_vec_env(ENV, 64)
    venv.reset()
    found["Stable-Baselines3, 64"] = shortest(lambda: venv.step(np.zeros((64, 6), np.float32)), 500)
    storm = gymnasium.make_vec(STORM, num_envs=1)
    for name in ("mpc", "nmpc", "dob-adaptive"):
        controller = uvms_gym.make_controller(name, storm)

        def episode(controller: uvms_gym.controllers.Controller = controller) -> None:
            storm.reset(seed=0)
            uvms_gym.Rollout(storm, controller).run(PERIODS)

        found[f"control period, {name}"] = shortest(episode, 4) / PERIODS
    print(json.dumps({name: round(value, 1) for name, value in found.items()}))


if __name__ == "__main__":
    main()
