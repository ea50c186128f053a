"""Gymnasium's and Stable-Baselines3's own checkers on every id, scene, action and disturbance, warnings as errors."""

import contextlib
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from helpers import choices, scenes_with_thrusters, small, task_ids

import uvms_gym


def cases():
    """Every task with every scene and action, and with every disturbance."""
    for task in task_ids():
        for scene in scenes_with_thrusters():
            for action in choices(task, "action"):
                yield task, {"scene": scene, "action": action}
        for disturbance in uvms_gym.disturbance_levels():
            yield task, {"scene": small(task), "disturbance": disturbance}


CASES = [pytest.param(task, kwargs, id="-".join([task, *kwargs.values()])) for task, kwargs in cases()]


@contextlib.contextmanager
def checked(task, kwargs):
    """An environment with seeds for episodes and actions, in a context in which warnings are errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if "EETrack" in task:
            # Random torques hurl a light arm about faster than its steps resolve, which is told rightly.
            warnings.simplefilter("ignore", uvms_gym.StepWarning)
        env = gym.make(task, **kwargs)
        env.reset(seed=0)
        env.action_space.seed(0)
        yield env


@pytest.mark.parametrize(("task", "kwargs"), CASES)
def test_gymnasium_is_content(task, kwargs):
    with checked(task, kwargs) as env:
        check_env(env.unwrapped)


@pytest.mark.learning
@pytest.mark.parametrize(("task", "kwargs"), CASES)
def test_stable_baselines3_is_content(task, kwargs):
    from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

    with checked(task, kwargs) as env:
        check_env_for_sb3(env)


def test_all_that_is_shipped_is_checked():
    seen = [param.values for param in CASES]
    assert {"petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy", "rexrov"} <= {k["scene"] for _, k in seen}
    assert {"wrench", "thrusters"} <= {k.get("action") for _, k in seen}
    assert {task for task, _ in seen} == set(task_ids()) >= {"UVMS-StationKeep-v0"}


def test_warnings_count_as_errors():
    class Careless(gym.Env):
        observation_space = action_space = gym.spaces.Box(-np.inf, np.inf, (2,), np.float32)

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            return np.zeros(2, np.float32), {}

        def step(self, action):
            return np.zeros(2, np.float32), 0.0, False, False, {}

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(UserWarning, match="infinity"):
            check_env(Careless())
