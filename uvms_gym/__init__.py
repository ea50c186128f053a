"""Underwater vehicle-manipulator systems on SE(3): a batched simulator with Gymnasium environments.

Importing it registers the environments with Gymnasium.
"""

from uvms_gym._core import Renderer, SceneError, Simulator, StepWarning, __version__, integrators, load_scene, scenes
from uvms_gym.controllers import MLP, PD, PID, ResolvedMotion
from uvms_gym.disturbances import disturbances
from uvms_gym.envs import register_envs
from uvms_gym.rollouts import Rollout

__all__ = [
    "MLP",
    "PD",
    "PID",
    "Renderer",
    "ResolvedMotion",
    "Rollout",
    "SceneError",
    "Simulator",
    "StepWarning",
    "__version__",
    "disturbances",
    "integrators",
    "load_scene",
    "scenes",
]

register_envs()
