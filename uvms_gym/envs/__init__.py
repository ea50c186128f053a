"""Gymnasium environments."""

from typing import Any

import gymnasium

from uvms_gym import _core
from uvms_gym._task.base import EPISODE_STEPS, INFO, Block
from uvms_gym._task.options import Preview, RewardWeights, TaskOptions, Tolerance
from uvms_gym.envs.base import TaskEnv, TaskVectorEnv
from uvms_gym.envs.button import ButtonEnv, ButtonOptions, ButtonVectorEnv
from uvms_gym.envs.dock import DockEnv, DockOptions, DockVectorEnv
from uvms_gym.envs.ee_track import EETrackEnv, EETrackOptions, EETrackVectorEnv
from uvms_gym.envs.navigation import NavigationObservation
from uvms_gym.envs.station_keep import StationKeepEnv, StationKeepOptions, StationKeepVectorEnv
from uvms_gym.envs.valve import ValveEnv, ValveOptions, ValveVectorEnv

__all__ = [
    "EPISODE_STEPS",
    "INFO",
    "Block",
    "ButtonEnv",
    "ButtonOptions",
    "ButtonVectorEnv",
    "DockEnv",
    "DockOptions",
    "DockVectorEnv",
    "EETrackEnv",
    "EETrackOptions",
    "EETrackVectorEnv",
    "NavigationObservation",
    "Preview",
    "RewardWeights",
    "StationKeepEnv",
    "StationKeepOptions",
    "StationKeepVectorEnv",
    "TaskEnv",
    "TaskOptions",
    "TaskVectorEnv",
    "Tolerance",
    "ValveEnv",
    "ValveOptions",
    "ValveVectorEnv",
    "register_envs",
]

#: Levels of disturbances in which controllers are compared, by the variant of the environments' names.
VARIANTS = {"-Storm": "storm", "-Wide": "storm-wide"}
#: Control period there, s, and the thrusters' lag, s.
_PERIOD, _LAG = 0.1, 0.1


def register_envs() -> None:
    """Register the environments with Gymnasium; importing `uvms_gym` does so."""
    for task, _ in _core.tasks():
        options = TaskOptions.by_task[task]
        name = options.__name__.removesuffix("Options")
        reward = {"effort": 0.05, "action_rate": options.storm_action_rate}
        defaults, time = _core.task_defaults(task), options.episode_time
        common = {"thruster_lag": _LAG, "substeps": round(_PERIOD / defaults["dt"]), "reward": reward, **options.storm}
        steps, storm_steps = round(time / (defaults["dt"] * defaults["substeps"])), round(time / _PERIOD)
        variants: dict[str, tuple[int, dict[str, Any]]] = {"": (steps, {})}
        variants |= {variant: (storm_steps, {"disturbance": level, **common}) for variant, level in VARIANTS.items()}
        for variant, (steps, arguments) in variants.items():
            if f"UVMS-{name}{variant}-v0" not in gymnasium.registry:
                gymnasium.register(
                    id=f"UVMS-{name}{variant}-v0",
                    entry_point=f"uvms_gym.envs:{name}Env",
                    vector_entry_point=f"uvms_gym.envs:{name}VectorEnv",
                    max_episode_steps=steps,
                    kwargs=arguments,
                )
