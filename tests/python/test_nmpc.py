"""Nonlinear model-predictive control: convergence, feedback near rest, limits, rows, gains."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import uvms_gym
from uvms_gym import NMPC

TASKS = ["UVMS-StationKeep", "UVMS-EETrack"]


def run(env: Any, controller: Any, steps: int, seed: int = 1) -> tuple[Any, Any, Any]:
    """Last observations, state of the controller and info."""
    observations, info = env.reset(seed=seed)
    state = None
    for _ in range(steps):
        actions, state = controller.predict(observations, state)
        assert (np.abs(actions) <= 1.0).all()
        observations, _, _, _, info = env.step(actions)
    return observations, state, info


@pytest.mark.parametrize("task", TASKS)
def test_with_a_perfect_model_the_target_is_reached(task: str) -> None:
    still = {"disturbance": {"arm": {"amplitude": 0.0}}} if task == TASKS[0] else {"disturbance": {}}
    more = {} if task == TASKS[0] else {"reference": "point"}
    env = gym.make_vec(f"{task}-v0", num_envs=2, max_episode_steps=None, **still, **more)
    _, _, info = run(env, NMPC(env), 400)
    assert info["position_error"].max() < 5e-3
    assert info["attitude_error"].max() < 1e-2


@pytest.mark.parametrize("task", TASKS)
def test_the_plan_is_within_the_limits(task: str) -> None:
    env = gym.make_vec(f"{task}-Storm-v0", num_envs=4)
    controller = NMPC(env, effort=[1e-7] * 3, change=[0.0, 0.0])
    _, state, _ = run(env, controller, 10)
    plan = state[:, controller.memory_layout["plan"]]
    assert np.abs(plan).max() == 1.0


@pytest.mark.parametrize("task", TASKS)
def test_gains_are_checked(task: str) -> None:
    env = gym.make(f"{task}-Storm-v0")
    with pytest.raises(ValueError, match=r"gain effort\[1\] = -1"):
        NMPC(env, effort=[1.0, -1.0, 1.0])
    with pytest.raises(ValueError, match="gain posture"):
        NMPC(env, posture=float("nan"))
    with pytest.raises(ValueError, match=r"gain velocity is \[1.0\], but must be 3 numbers"):
        NMPC(env, velocity=[1.0])
    with pytest.raises(ValueError, match="delay"):
        NMPC(env, delay=11)


def test_a_dock_is_refused() -> None:
    with pytest.raises(ValueError, match="not for UVMS-Dock; controllers of UVMS-Dock: NoControl, DockPD"):
        NMPC(gym.make("UVMS-Dock-v0"))
    assert {"station-keep", "ee-track"} == set(uvms_gym.controllers.families.CONTROLLERS["nmpc"].tasks)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("value", [1e15, -1e25, 3e38])
def test_a_huge_observation_gives_an_action_and_leaves_other_rows_as_they_are(task: str, value: float) -> None:
    env = gym.make_vec(f"{task}-v0", num_envs=2)
    controller, begun = NMPC(env), np.ones(2, dtype=bool)
    observations, _ = env.reset(seed=0)
    usual, state = controller.predict(observations)
    for entry in range(observations.shape[1]):
        changed = observations.copy()
        changed[0, entry] = value
        actions, memory = controller.predict(changed, episode_start=begun)
        assert np.all(np.abs(actions) <= 1.0) and np.all(np.isfinite(memory))
        assert actions[1].tobytes() == usual[1].tobytes() and memory[1].tobytes() == state[1].tobytes()
