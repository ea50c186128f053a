"""Scenes as files for other programs: MJCF and URDF.

`tree` (a scene's links, joints, masses and inertias), `mjcf`, `urdf`, `omissions` (terms of a scene without an element
in a format).
"""

from os import PathLike
from typing import Any

from uvms_gym import _core
from uvms_gym.export import mjcf, urdf


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
