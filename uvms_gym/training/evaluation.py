"""Evaluation of controllers on held-out episodes."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from uvms_gym import Rollout
from uvms_gym.controllers import Controller
from uvms_gym.rollouts import RolloutStats
from uvms_gym.studies.comparison.metrics import pose_rms
from uvms_gym.studies.comparison.statistics import interquartile_mean

#: Tasks that an episode completes or not.
ENDING = ("dock", "button", "valve")
#: First seed of evaluation episodes; seeds of training are larger.
SEED = 2_000_000


def episode_steps(env: str, env_kwargs: Mapping[str, Any]) -> int:
    """Steps of an episode.

    Raises
    ------
    ValueError
        The environment has no limit.
    """
    steps = env_kwargs.get("max_episode_steps", gymnasium.spec(env).max_episode_steps)
    if not steps:
        raise ValueError(f"{env} has no limit of steps; give one: max_episode_steps")
    return int(steps)


def run_episodes(envs: Any, controller: Controller, seed: int, steps: int) -> RolloutStats:
    """Run an episode of every seed from `seed` on, natively."""
    envs.reset(seed=seed)
    rollout = Rollout(envs, controller)
    rollout.run(steps)
    return rollout.pop_stats()


def evaluate(
    env: str, env_kwargs: Mapping[str, Any], controller: Controller, episodes: int, seed: int = SEED
) -> dict[str, float]:
    """Run an episode of every seed from `seed` on, natively.

    Returns
    -------
    dict
        Root mean squares over an episode's steps, as interquartile means over episodes: `position` (m), `attitude`
        (rad), `end_effector` (m), and `pose` (m), sqrt(position^2 + (0.5 m * attitude)^2) of the vehicle, or of the end
        effector in tracking; `pose_95`, its 95th percentile; means of `effort` and `variation` of commands; shares of
        `diverged` episodes and, in docking, button and valve, of those with `success`.
    """
    envs = gymnasium.make_vec(env, num_envs=episodes, **env_kwargs)
    stats = run_episodes(envs, controller, seed, episode_steps(env, env_kwargs))
    task: str = envs.unwrapped.task  # type: ignore[attr-defined]
    pose = pose_rms(stats, task)
    envs.close()
    success = {"success": float(stats.last["success"].mean())} if task in ENDING else {}
    return {
        "pose": interquartile_mean(pose),
        "pose_95": float(np.quantile(pose, 0.95)),
        "position": interquartile_mean(stats.rms("position_error")),
        "attitude": interquartile_mean(stats.rms("attitude_error")),
        "end_effector": interquartile_mean(stats.rms("end_effector_position_error")),
        "effort": float(stats.mean("power").mean()),
        "variation": float(stats.mean("action_rate").mean()),
        "diverged": float(stats.terminated.mean()),
        **success,
    }
