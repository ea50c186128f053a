"""Scenes and policies as files for other programs: MJCF and URDF, ONNX and C.

`tree` (a scene's links, joints, masses and inertias), `mjcf`, `urdf`, `omissions` (terms of a scene without an element
in a format); `policy` (a network with its scaling and memory), `c`, `onnx`.
"""

import json
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from uvms_gym import _core
from uvms_gym._files import write
from uvms_gym.controllers import Controller
from uvms_gym.export import c, mjcf, onnx, urdf
from uvms_gym.export.policy import policy_model


def export_mjcf(scene: str | PathLike[str] | dict[str, Any]) -> str:
    """MJCF text of a scene, for MuJoCo.

    Bodies, inertias, joints (armature, viscous friction, Coulomb friction as `frictionloss`, springs, ranges),
    thrusters as actuators at sites, joint servos or motors with their maximum torque, and the pose at the start as key
    "home". Buoyancy is `gravcomp`, which acts at the centre of mass. Units are SI, x forward, y left, z up. Comments at
    the top list what MJCF cannot express, first of all added mass and damping by the water.

    Parameters
    ----------
    scene : str, os.PathLike or dict
        As for `load_scene`.

    Returns
    -------
    str

    Raises
    ------
    SceneError
        As `load_scene`.
    """
    return mjcf.export(_core.load_scene(scene))[0]


def export_urdf(scene: str | PathLike[str] | dict[str, Any]) -> str:
    """URDF text of a scene.

    The link "vehicle" has a floating joint to the link "world" (a fixed joint if the vehicle is fixed); then follow the
    arm's base, its links, end effectors and payload with inertias, joint limits, maximum torques and speeds, friction,
    and boxes for pictures. Units are SI, x forward, y left, z up. Comments at the top list what URDF cannot express.

    Parameters
    ----------
    scene : str, os.PathLike or dict
        As for `load_scene`.

    Returns
    -------
    str

    Raises
    ------
    SceneError
        As `load_scene`.
    """
    return urdf.export(_core.load_scene(scene))[0]


def export_policy(
    policy: Controller, file: str | PathLike[str], env: Any = None, *, delay: int = 0, **options: Any
) -> Path:
    """Write a neural policy as C or ONNX, and its contract as JSON beside it.

    Scaling of the observation, history, last action, integral of the pose error and a further delay are in the file.
    Its input are the physical values of the observation up to `previous_action`; values that are not finite are
    missing, and their last values count.

    Parameters
    ----------
    policy : Controller
        An `MLP` that is not a residual policy.
    file : path
        Ends in .c (C99 without dependencies) or .onnx (needs the extra `onnx`); existing files are overwritten.
    env : UVMS environment or None
        Environment of the policy.
    delay : int
        Further delay of the measurements, control periods, 0 to 100: for a vehicle whose sensors are faster than in the
        training.
    **options
        Without `env`: arguments of its environment, and `task`.

    Returns
    -------
    pathlib.Path
        File of the contract: `policy_contract`'s, with the names of the `inputs`, the `policy` (digest of its file,
        sizes, activation, output, history) and the `further_delay`.

    Raises
    ------
    ValueError
        A controller that cannot be exported, another environment, an unknown ending, or a delay out of range.
    TypeError
        `env` is something else.
    ModuleNotFoundError
        The extra `onnx` is missing.
    OSError
        A file cannot be written.
    """
    path = Path(file)
    if path.suffix not in (".c", ".onnx"):
        raise ValueError(f"file is {fspath(file)!r}, but must end in .c or .onnx")
    model, contract = policy_model(policy, env, delay=delay, **options), contract_file(path)
    data = c.export(model, contract.name) if path.suffix == ".c" else onnx.export(model)
    write(path, data)
    write(contract, json.dumps(model.contract, indent=1) + "\n")
    return contract


def contract_file(file: Path) -> Path:
    """File of the contract of an exported policy."""
    return file.with_suffix(".contract.json")
