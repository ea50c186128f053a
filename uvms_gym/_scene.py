"""Parts of scenes as `load_scene` gives them."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from uvms_gym._rotations import Floats


def bodies(scene: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Names and bodies of a scene: vehicle, base, links, payload."""
    arm = scene.get("arm") or {}
    named = [("vehicle", scene["vehicle"]["body"]), ("base", arm.get("base"))]
    named += [(link["name"], link.get("body")) for link in arm.get("links", [])]
    named.append(("payload", (scene.get("payload") or {}).get("body")))
    return [(name, body) for name, body in named if body]


def joints(scene: dict[str, Any]) -> list[dict[str, Any]]:
    """All joints of a scene that move, in the order of every joint array."""
    arm = scene.get("arm") or {}
    mount = [arm["mount"]["joint"]] if arm.get("mount", {}).get("joint") else []
    return mount + [link["joint"] for link in arm.get("links", []) if link["joint"]["kind"] != "fixed"]


def surroundings(scene: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """Spheres on the robot, shapes and fixtures of a scene by these names; empty lists where it has none."""
    contact = scene.get("contact") or {}
    lists = {"spheres": contact.get("spheres"), "shapes": contact.get("shapes"), "fixtures": scene.get("fixtures")}
    return {key: tables or [] for key, tables in lists.items()}


def matrix_of(values: ArrayLike) -> Floats:
    """Matrix (n, n) that a scene gives in full or by its diagonal (n,)."""
    given = np.asarray(values, dtype=np.float64)
    return np.diag(given) if given.ndim == 1 else given


def buoyancy_of(body: dict[str, Any], water: dict[str, Any]) -> float:
    """Buoyancy of a body, N: as given, or of its volume."""
    if (given := body.get("buoyancy")) is not None:
        return float(given)
    return float(water["density"] * math.hypot(*water["gravity"]) * (body.get("volume") or 0.0))
