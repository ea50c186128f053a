"""Gymnasium environments."""


def register_envs() -> None:
    """Register the environments with Gymnasium; importing `uvms_gym` does so."""
