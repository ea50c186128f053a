"""A scene as the chain of rigid bodies that other programs are given: joints, masses and inertias, nothing wet."""

import copy
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Link(NamedTuple):
    """A moving body with all that is fixed to it, and the joint that carries it (None: the vehicle).

    `placement` (4, 4) is the body's frame in that of the body before it, its joint at zero; `axis` (3,) a unit vector.
    `center_of_mass` (3,), m, and `inertia` (3, 3), kg m^2 about it, are in the body's frame; `buoyancy` in N.
    """

    joint: dict[str, Any] | None
    placement: Floats
    axis: Floats
    mass: float
    center_of_mass: Floats
    inertia: Floats
    buoyancy: float

    @property
    def prismatic(self) -> bool:
        """Whether the joint slides."""
        return self.joint is not None and self.joint["kind"] == "prismatic"


def chain(scene: dict[str, Any]) -> list[Link]:
    """Merge what is fixed to each other in a scene, as `load_scene` gives it; the vehicle comes first."""
    joints: list[tuple[dict[str, Any] | None, Floats]] = [(None, np.eye(4))]
    parts: list[list[tuple[Floats, dict[str, Any]]]] = [[(np.eye(4), scene["vehicle"]["body"])]]
    here = np.eye(4)

    def add(joint: dict[str, Any]) -> Floats:
        joints.append((joint, here @ transform(joint.get("frame"))))
        parts.append([])
        return np.eye(4)

    if arm := scene.get("arm"):
        mount = arm["mount"]
        here = transform(mount.get("frame"))
        if mount.get("joint"):
            here = add(mount["joint"])
        if arm.get("base"):
            parts[-1].append((here, arm["base"]))
        for link in arm.get("links", ()):
            here = add(link["joint"])
            parts[-1].append((here, link["body"]))
        here = here @ transform(arm.get("end_effector"))
    if payload := scene.get("payload"):
        parts[-1].append((here @ transform(payload.get("frame")), payload["body"]))
    return [_link(*joint, bodies, scene["water"]) for joint, bodies in zip(joints, parts, strict=True)]


def transform(frame: dict[str, Any] | None) -> Floats:
    """(4, 4) of a frame with `position` and `rpy`, R = Rz Ry Rx."""
    result = np.eye(4)
    if frame is not None:
        for axis in (2, 1, 0):
            result[:3, :3] = result[:3, :3] @ _turn(axis, frame["rpy"][axis])
        result[:3, 3] = frame["position"]
    return result


def dry(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene in a vacuum, under its gravity: what rigid-body programs compute. Viscous friction stays."""
    result = copy.deepcopy(scene)
    result["provenance"] = {}
    result["water"] = {"density": 0.0, "gravity": scene["water"]["gravity"]}
    arm = result.get("arm") or {}
    joints = [link["joint"] for link in arm.get("links", ())]
    bodies = [result["vehicle"]["body"], *(link["body"] for link in arm.get("links", ()))]
    if arm.get("base"):
        bodies.append(arm["base"])
    if arm.get("mount", {}).get("joint"):
        joints.append(arm["mount"]["joint"])
    if result.get("payload"):
        bodies.append(result["payload"]["body"])
    for body in bodies:
        for key in ("added_mass", "damping", "volume", "buoyancy"):
            body.pop(key, None)
    for joint in joints:
        joint.pop("limits", None)
        joint.pop("effort", None)
        joint["friction"] = {"viscous": joint.get("friction", {}).get("viscous", 0.0)}
    return result


def _turn(axis: int, angle: float) -> Floats:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    result = np.eye(3)
    result[i, i] = result[j, j] = np.cos(angle)
    result[j, i] = np.sin(angle)
    result[i, j] = -result[j, i]
    return result


def _away(mass: float, offset: Floats) -> Floats:
    """(3, 3) moments of a point mass at `offset`, which parallel axes differ by."""
    moments: Floats = mass * ((offset @ offset) * np.eye(3) - np.outer(offset, offset))
    return moments


def _link(
    joint: dict[str, Any] | None, placement: Floats, parts: list[tuple[Floats, dict[str, Any]]], water: dict[str, Any]
) -> Link:
    masses = np.array([body["mass"] for _, body in parts])
    centers = np.array([place[:3, :3] @ body["center_of_mass"] + place[:3, 3] for place, body in parts])
    center = masses @ centers / masses.sum()
    inertia = np.zeros((3, 3))
    for (place, body), mass, offset in zip(parts, masses, centers - center, strict=True):
        own = np.array(body["inertia"])
        own = np.diag(own) if own.ndim == 1 else own
        if body.get("inertia_at") == "origin":
            own = own - _away(mass, np.array(body["center_of_mass"]))
        inertia += place[:3, :3] @ own @ place[:3, :3].T + _away(mass, offset)
    axis = np.zeros(3) if joint is None else np.array(joint["axis"]) / np.linalg.norm(joint["axis"])
    buoyancy = sum(_buoyancy(body, water) for _, body in parts)
    return Link(joint, placement, axis, float(masses.sum()), center, inertia, buoyancy)


def _buoyancy(body: dict[str, Any], water: dict[str, Any]) -> float:
    if (given := body.get("buoyancy")) is not None:
        return float(given)
    return float(water["density"] * np.linalg.norm(water["gravity"]) * (body.get("volume") or 0.0))
