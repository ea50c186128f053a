"""Gymnasium environments."""

import gymnasium

EPISODE_STEPS = 400


def register_envs() -> None:
    """Register the environments with Gymnasium; importing `uvms_gym` does so."""
    if "UVMS-StationKeep-v0" not in gymnasium.registry:
        gymnasium.register(
            id="UVMS-StationKeep-v0",
            entry_point="uvms_gym.envs.station_keep:StationKeepEnv",
            vector_entry_point="uvms_gym.envs.station_keep:StationKeepVectorEnv",
            max_episode_steps=EPISODE_STEPS,
        )
