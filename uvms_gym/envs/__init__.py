"""Gymnasium environments."""

import gymnasium

EPISODE_STEPS = 400


def register_envs() -> None:
    """Register the environments with Gymnasium; importing `uvms_gym` does so."""
    for name, module in (("StationKeep", "station_keep"), ("EETrack", "ee_track")):
        if f"UVMS-{name}-v0" not in gymnasium.registry:
            gymnasium.register(
                id=f"UVMS-{name}-v0",
                entry_point=f"uvms_gym.envs.{module}:{name}Env",
                vector_entry_point=f"uvms_gym.envs.{module}:{name}VectorEnv",
                max_episode_steps=EPISODE_STEPS,
            )
