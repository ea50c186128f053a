"""Underwater vehicle-manipulator systems on SE(3): a batched simulator with Gymnasium environments.

Importing it registers the environments with Gymnasium.
"""

try:
    from uvms_gym._core import (
        ATTITUDE_LEVER,
        NavigationFilter,
        Renderer,
        SceneError,
        Sensors,
        Simulator,
        StepWarning,
        __version__,
        arm_names,
        assess_scene,
        dump_scene,
        estimate,
        integrators,
        lint_scene,
        load_scene,
        pulse_of,
        recommend_integration,
        scene_names,
        scene_template,
        thrust_of,
    )
except ModuleNotFoundError as error:
    if error.name != "uvms_gym._core":
        raise
    raise ModuleNotFoundError(
        f"native module missing in {__path__[0]}: run `make run` or `pip install -e .` in the source tree",
        name=error.name,
    ) from None

# Editors know a submodule as an attribute only where it is imported under its own name.
from uvms_gym import controllers as controllers
from uvms_gym import disturbances as disturbances
from uvms_gym import envs as envs
from uvms_gym import export as export
from uvms_gym import inputs as inputs
from uvms_gym import logs as logs
from uvms_gym import planning as planning
from uvms_gym import robots as robots
from uvms_gym import rollouts as rollouts
from uvms_gym.controllers import (
    DOB,
    MLP,
    MPC,
    NMPC,
    PD,
    PID,
    AdaptiveDOB,
    AdaptiveResolvedMotion,
    Blend,
    ComputedTorque,
    DockPD,
    PDRestoring,
    Residual,
    ResolvedMotion,
    StateWarning,
)
from uvms_gym.controllers.contract import check_contract, policy_contract
from uvms_gym.controllers.registry import ControllerWarning, make_controller
from uvms_gym.disturbances import disturbance_levels
from uvms_gym.envs import register_envs
from uvms_gym.export import export_mjcf, export_policy, export_urdf
from uvms_gym.inputs import StepInputs
from uvms_gym.logs import Log, LogError, LogMap
from uvms_gym.planning import Trajectory, optimize_trajectory
from uvms_gym.robots import import_robot
from uvms_gym.rollouts import Rollout

__all__ = [
    "ATTITUDE_LEVER",
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
    "ControllerWarning",
    "DockPD",
    "Log",
    "LogError",
    "LogMap",
    "NavigationFilter",
    "PDRestoring",
    "Renderer",
    "Residual",
    "ResolvedMotion",
    "Rollout",
    "SceneError",
    "Sensors",
    "Simulator",
    "StateWarning",
    "StepInputs",
    "StepWarning",
    "Trajectory",
    "__version__",
    "arm_names",
    "assess_scene",
    "check_contract",
    "disturbance_levels",
    "dump_scene",
    "estimate",
    "export_mjcf",
    "export_policy",
    "export_urdf",
    "import_robot",
    "integrators",
    "lint_scene",
    "load_scene",
    "make_controller",
    "optimize_trajectory",
    "policy_contract",
    "pulse_of",
    "recommend_integration",
    "scene_names",
    "scene_template",
    "thrust_of",
]

register_envs()
