"""Gymnasium environments."""

from typing import Any

import gymnasium

from uvms_gym._task.base import EPISODE_STEPS, INFO, Block
from uvms_gym._task.options import Preview, RewardWeights, TaskOptions, Tolerance
from uvms_gym.envs.base import TaskEnv, TaskVectorEnv
from uvms_gym.envs.dock import DockEnv, DockOptions, DockVectorEnv
from uvms_gym.envs.ee_track import EETrackEnv, EETrackOptions, EETrackVectorEnv
from uvms_gym.envs.station_keep import StationKeepEnv, StationKeepOptions, StationKeepVectorEnv

__all__ = [
    "EPISODE_STEPS",
    "INFO",
    "Block",
    "DockEnv",
    "DockOptions",
    "DockVectorEnv",
    "EETrackEnv",
    "EETrackOptions",
    "EETrackVectorEnv",
    "Preview",
    "RewardWeights",
    "StationKeepEnv",
    "StationKeepOptions",
    "StationKeepVectorEnv",
    "TaskEnv",
    "TaskOptions",
    "TaskVectorEnv",
    "Tolerance",
    "register_envs",
]

#: Conditions in which controllers are compared: all disturbances, late sensors, slow thrusters, 0.1 s per action.
_STORM: dict[str, Any] = {"disturbance": "storm", "thruster_lag": 0.1, "substeps": 10}
#: Reward weight on changes of the action there, for commands about as calm as a PD's.
_STORM_RATE = {"StationKeep": 0.8, "EETrack": 0.2, "Dock": 0.2}
_STORM_STEPS = 200


def register_envs() -> None:
    """Register the environments with Gymnasium; importing `uvms_gym` does so."""
    for name, rate in _STORM_RATE.items():
        storm = {**_STORM, "reward": {"effort": 0.05, "action_rate": rate}}
        for variant, steps, arguments in (("", EPISODE_STEPS, {}), ("-Storm", _STORM_STEPS, storm)):
            if f"UVMS-{name}{variant}-v0" not in gymnasium.registry:
                gymnasium.register(
                    id=f"UVMS-{name}{variant}-v0",
                    entry_point=f"uvms_gym.envs:{name}Env",
                    vector_entry_point=f"uvms_gym.envs:{name}VectorEnv",
                    max_episode_steps=steps,
                    kwargs=arguments,
                )
