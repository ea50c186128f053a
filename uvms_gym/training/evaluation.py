"""How good a controller is on held-out episodes."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from uvms_gym import Rollout
from uvms_gym.controllers import Controller

#: First seed of the episodes that tell during training how it goes; training's own begin above.
SEED = 2_000_000
#: An attitude's share in the pose error, m per rad.
LEVER = 0.5


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


def evaluate(
    env: str, env_kwargs: Mapping[str, Any], controller: Controller, episodes: int, seed: int = SEED
) -> dict[str, float]:
    """Run an episode of every seed from `seed` on, natively.

    Returns
    -------
    dict
        Root mean squares over an episode's steps, as interquartile means over episodes: position (m), attitude (rad),
        end_effector (m), and pose (m), which is sqrt(position^2 + (0.5 m * attitude)^2) of the vehicle, or of the end
        effector if that is to track; pose_95, its 95th percentile; means of effort and command variation; share of
        episodes that diverged.
    """
    # The weight makes the term tell the variation; the rest of the reward does not matter here.
    envs = gymnasium.make_vec(env, num_envs=episodes, **{**env_kwargs, "reward": {"rate": 1.0}})
    envs.reset(seed=seed)
    rollout = Rollout(envs, controller)
    rollout.run(episode_steps(env, env_kwargs))
    tally = rollout.take()
    tracks: bool = envs.unwrapped.task == "ee-track"  # type: ignore[attr-defined]
    envs.close()
    rms = {name: np.sqrt(squares / tally.steps) for name, squares in tally.squares.items()}
    of = "end_effector_" if tracks else ""
    pose = np.hypot(rms[f"{of}position_error"], LEVER * rms[f"{of}attitude_error"])
    return {
        "pose": interquartile_mean(pose),
        "pose_95": float(np.quantile(pose, 0.95)),
        "position": interquartile_mean(rms["position_error"]),
        "attitude": interquartile_mean(rms["attitude_error"]),
        "end_effector": interquartile_mean(rms["end_effector_position_error"]),
        "effort": float((tally.sums["effort"] / tally.steps).mean()),
        "variation": float((-tally.sums["reward_rate"] / tally.steps).mean()),
        "diverged": float(tally.terminated.mean()),
    }


def interquartile_mean(values: NDArray[np.float64]) -> float:
    """Mean of the middle half."""
    cut = len(values) // 4
    return float(np.sort(values)[cut : len(values) - cut].mean())
