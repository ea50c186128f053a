"""Chain of rigid bodies of a scene for other programs: joints, masses and inertias, without hydrodynamics."""

import copy
from typing import Any, NamedTuple

import numpy as np

from uvms_gym._rotations import from_rpy, matrices
from uvms_gym.studies.numerics import Floats, bodies, buoyancy_of, joints, matrix_of


class Link(NamedTuple):
    """A moving body with all bodies fixed to it, and its joint (None: the vehicle).

    `placement` (4, 4) is the body's frame in the one before it, its joint at zero; `axis` (3,) a unit vector.
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
        """True for a prismatic joint."""
        return self.joint is not None and self.joint["kind"] == "prismatic"


def chain(scene: dict[str, Any]) -> list[Link]:
    """Moving bodies of a scene as `load_scene` gives it, rigidly connected ones merged; the vehicle comes first."""
    frames: list[tuple[dict[str, Any] | None, Floats]] = [(None, np.eye(4))]
    parts: list[list[tuple[Floats, dict[str, Any]]]] = [[(np.eye(4), scene["vehicle"]["body"])]]
    here = np.eye(4)

    def add(joint: dict[str, Any]) -> Floats:
        frames.append((joint, here @ transform(joint.get("frame"))))
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
    return [_link(*frame, bodies, scene["water"]) for frame, bodies in zip(frames, parts, strict=True)]


def transform(frame: dict[str, Any] | None) -> Floats:
    """Homogeneous transform (4, 4) of a frame with `position` and `rpy`, R = Rz Ry Rx."""
    result = np.eye(4)
    if frame is not None:
        result[:3, :3] = matrices(from_rpy(np.array(frame["rpy"])))
        result[:3, 3] = frame["position"]
    return result


def dry(scene: dict[str, Any]) -> dict[str, Any]:
    """Copy of a scene in a vacuum, under its gravity, as rigid-body programs model it. Viscous friction remains."""
    result = copy.deepcopy(scene)
    result["provenance"] = {}
    result["water"] = {"density": 0.0, "gravity": scene["water"]["gravity"]}
    for body in bodies(result):
        for key in ("added_mass", "damping", "volume", "buoyancy"):
            body.pop(key, None)
    for joint in joints(result):
        joint.pop("limits", None)
        joint.pop("effort", None)
        joint["friction"] = {"viscous": joint.get("friction", {}).get("viscous", 0.0)}
    return result


def _point_inertia(mass: float, offset: Floats) -> Floats:
    """Inertia (3, 3) of a point mass at `offset`, for the parallel-axis theorem."""
    return mass * ((offset @ offset) * np.eye(3) - np.outer(offset, offset))


def _link(
    joint: dict[str, Any] | None, placement: Floats, parts: list[tuple[Floats, dict[str, Any]]], water: dict[str, Any]
) -> Link:
    masses = np.array([body["mass"] for _, body in parts])
    centers = np.array([place[:3, :3] @ body["center_of_mass"] + place[:3, 3] for place, body in parts])
    center = masses @ centers / masses.sum()
    inertia = np.zeros((3, 3))
    for (place, body), mass, offset in zip(parts, masses, centers - center, strict=True):
        own = matrix_of(body["inertia"])
        if body.get("inertia_at") == "origin":
            own = own - _point_inertia(mass, np.array(body["center_of_mass"]))
        inertia += place[:3, :3] @ own @ place[:3, :3].T + _point_inertia(mass, offset)
    axis = np.zeros(3) if joint is None else np.array(joint["axis"]) / np.linalg.norm(joint["axis"])
    buoyancy = sum(buoyancy_of(body, water) for _, body in parts)
    return Link(joint, placement, axis, float(masses.sum()), center, inertia, buoyancy)
