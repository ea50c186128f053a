"""Controllers with the signature of Stable-Baselines3's policies. They run natively."""

from uvms_gym.controllers.base import Controller, StateWarning
from uvms_gym.controllers.blend import Blend
from uvms_gym.controllers.feedback import PD, PID, DockPD, NoControl, PDRestoring
from uvms_gym.controllers.mlp import MLP, Residual
from uvms_gym.controllers.model_based import (
    DOB,
    MPC,
    NMPC,
    AdaptiveDOB,
    AdaptiveResolvedMotion,
    ComputedTorque,
    ResolvedMotion,
)

__all__ = [
    "DOB",
    "MLP",
    "MPC",
    "NMPC",
    "PD",
    "PID",
    "AdaptiveDOB",
    "AdaptiveResolvedMotion",
    "Blend",
    "ComputedTorque",
    "Controller",
    "DockPD",
    "NoControl",
    "PDRestoring",
    "Residual",
    "ResolvedMotion",
    "StateWarning",
]
