"""Random actions in every environment, scene, kind of action and disturbance.

`UVMS_SOAK=1e8 pytest tests/python/test_soak.py -m nightly` takes so many steps of environments in all.
"""

import itertools
import math
import os
import resource
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from helpers import choices, scenes_with_thrusters, task_ids

import uvms_gym

STEPS = float(os.environ.get("UVMS_SOAK", "1e7"))
INSTANCES = 256
#: Each in another of both precisions and two numbers of substeps.
ROUNDS = 4
#: Growth of memory after the first round that counts as noise of the allocator, bytes.
SLACK = 64 * 2**20


def resident() -> int:
    """Bytes of memory in use."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def step_at_random(task: str, steps: int, seed: int, **options: str) -> None:
    random = np.random.default_rng([seed, *map(ord, "".join([task, *options.values()]))])
    precision = {"dtype": ("float64", "float32")[seed % 2], "substeps": (5, 2)[seed // 2 % 2]}
    envs = gymnasium.make_vec(task, INSTANCES, **options, **precision)
    envs.reset(seed=seed)
    for call in range(math.ceil(steps / INSTANCES)):
        if call % 10 == 0:
            # From timid to bang-bang, for a while so that vehicles get somewhere.
            actions = random.normal(size=envs.action_space.shape) * random.choice([0.1, 0.5, 3.0])
        observations, rewards, *_, infos = envs.step(np.clip(actions, -1, 1).astype(np.float32))
        where = task, options, precision, call
        assert (np.abs(observations) <= envs.observation_space.high).all(), where
        assert np.isfinite(rewards).all(), where
        for name, values in infos.items():
            assert values.dtype != np.float64 or np.isfinite(values).all(), (*where, name)
    envs.close()


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
def test_random_actions_leave_all_numbers_finite_and_memory_as_it_was() -> None:
    levels, memory = list(uvms_gym.disturbance_levels()), []
    cases = [
        (task, {"scene": scene, "action": action, "disturbance": level})
        for task in task_ids()
        for scene, action, level in itertools.product(scenes_with_thrusters(), choices(task, "action"), levels)
    ]
    for seed in range(ROUNDS):
        for task, options in cases:
            step_at_random(task, math.ceil(STEPS / len(cases) / ROUNDS), seed, **options)
        memory.append(resident())
    assert memory[-1] - memory[0] <= SLACK
