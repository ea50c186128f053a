"""Underwater vehicle-manipulator systems on SE(3): a batched simulator with Gymnasium environments."""

from uvms_gym._core import SceneError, __version__
from uvms_gym.envs import register_envs

__all__ = ["SceneError", "__version__"]

register_envs()
