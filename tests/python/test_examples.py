"""The examples do what they say."""

import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from helpers import assert_parity, module_of, same, small, task_ids

import uvms_gym

own_task = module_of(Path(__file__).parents[2] / "training" / "own_task.py")

# Random torques hurl an arm about.
pytestmark = [
    pytest.mark.parametrize("task", task_ids()),
    pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning"),
]


def options(task):
    return {"scene": small(task), "max_episode_steps": 5}


def test_an_own_task_keeps_the_contract(task):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", uvms_gym.StepWarning)
        # Gymnasium's checker wants no wrappers; they are meant here.
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version.*")
        check_env(own_task.OwnTask(gym.make(task, **options(task))))


@pytest.mark.parametrize("mode", ["NextStep", "Disabled"])
def test_own_tasks_keep_it_too_and_are_alike(task, mode):
    envs = own_task.OwnTasks(gym.make_vec(task, 3, autoreset_mode=mode, **options(task)))
    assert_parity(envs, lambda: own_task.OwnTask(gym.make(task, **options(task))), steps=14)


def test_an_own_task_is_another_one(task):
    env, plain = own_task.OwnTask(gym.make(task, **options(task))), gym.make(task, **options(task))
    assert env.reset(seed=0)[0].shape == (9,)
    assert same(env.unwrapped.get_state(), (plain.reset(seed=0), plain.unwrapped.get_state())[1])
    action = np.full(env.action_space.shape, 0.5, dtype=np.float32)
    got, expected = env.step(action), plain.step(action)
    assert got[1] != expected[1]
    assert same(got[4], expected[4])
    with pytest.raises(ValueError, match="SameStep"):
        own_task.OwnTasks(gym.make_vec(task, 2, autoreset_mode="SameStep"))


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_run_that_diverges_shows_nothing_but_numbers(task):
    envs = own_task.OwnTasks(gym.make_vec(task, 4, autoreset_mode="Disabled", dt=0.5, **options(task)))
    envs.reset(seed=0)
    envs.action_space.seed(0)
    lost = 0
    for _ in range(20):
        observations, rewards, ends, stops, infos = envs.step(np.sign(envs.action_space.sample()))
        assert envs.observation_space.contains(observations)
        assert np.isfinite(rewards).all()
        assert (rewards[ends] <= infos["reward_diverged"][ends]).all()
        gone = np.isnan(envs.unwrapped.snapshot().twist).any(axis=1)
        assert ends[gone].all()
        lost += gone.sum()
        if (ends | stops).any():
            envs.reset(options={"reset_mask": ends | stops})
    assert lost > 0


@pytest.mark.learning
def test_own_tasks_train(task):
    sb3 = pytest.importorskip("stable_baselines3")
    from uvms_gym.sb3 import NativeVecEnv

    venv = NativeVecEnv(own_task.OwnTasks(gym.make_vec(task, 4, autoreset_mode="Disabled", **options(task))))
    model = sb3.PPO("MlpPolicy", venv, n_steps=16, batch_size=32, n_epochs=1, seed=0, device="cpu").learn(64)
    assert len(model.ep_info_buffer) > 0
