"""Rigid bodies of a scene, as MuJoCo and Pinocchio model them: without water."""

import copy
from collections.abc import Iterable
from typing import Any

from uvms_gym._scene import bodies, joints
from uvms_gym.export.tree import Link, merged, tree


def rigid_bodies(scene: dict[str, Any]) -> list[Link]:
    """Moving bodies of a scene as `load_scene` gives it, rigidly connected links merged; the vehicle comes first.

    The name of each ends with the index of its joint in every joint array.
    """
    return [link._replace(name=f"joint {link.coordinate}") for link in merged(tree(scene))]


def joint_order(names: Iterable[str]) -> list[int]:
    """Indices in joint arrays of the joints with these names."""
    return [int(name.split()[1]) for name in names]


def dry(scene: dict[str, Any]) -> dict[str, Any]:
    """Copy of a scene in a vacuum, under its gravity, as rigid-body programs model it. Viscous friction remains."""
    result = copy.deepcopy(scene)
    result["provenance"] = {}
    result["water"] = {"density": 0.0, "gravity": scene["water"]["gravity"]}
    for _, body in bodies(result):
        for key in ("added_mass", "damping", "volume", "buoyancy"):
            body.pop(key, None)
    for joint in joints(result):
        joint.pop("limits", None)
        joint.pop("effort", None)
        joint["friction"] = {"viscous": joint.get("friction", {}).get("viscous", 0.0)}
    return result
