"""Gymnasium environments."""

from typing import Any

import gymnasium

EPISODE_STEPS = 400

#: What controllers are compared in: all disturbances at once, late sensors and slow thrusters, acted on every 0.1 s.
_STORM: dict[str, Any] = {"disturbance": "storm", "thruster_lag": 0.1, "substeps": 10}
#: What a change of the action costs there, so that commands are about as calm as a PD's.
_STORM_RATE = {"StationKeep": 0.8, "EETrack": 0.2}
_STORM_STEPS = 200


def register_envs() -> None:
    """Register the environments with Gymnasium; importing `uvms_gym` does so."""
    for name, module in (("StationKeep", "station_keep"), ("EETrack", "ee_track")):
        storm = {**_STORM, "reward": {"effort": 0.05, "rate": _STORM_RATE[name]}}
        for variant, steps, arguments in (("", EPISODE_STEPS, {}), ("-Storm", _STORM_STEPS, storm)):
            if f"UVMS-{name}{variant}-v0" not in gymnasium.registry:
                gymnasium.register(
                    id=f"UVMS-{name}{variant}-v0",
                    entry_point=f"uvms_gym.envs.{module}:{name}Env",
                    vector_entry_point=f"uvms_gym.envs.{module}:{name}VectorEnv",
                    max_episode_steps=steps,
                    kwargs=arguments,
                )
