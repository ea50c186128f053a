"""Scenes of hard cases: one body, or the links of an arm on it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

Scene = dict[str, Any]

#: Gravity, m/s^2, and density of water, kg/m^3.
GRAVITY, DENSITY = 9.81, 1000.0


def single_body(name: str, body: Scene, density: float = 0.0, gravity: float = 0.0) -> Scene:
    """Make the scene of one body, by default in a vacuum without gravity."""
    water = {"density": density, "gravity": [0.0, 0.0, -gravity]}
    return {"name": f"hard case {name}", "water": water, "vehicle": {"name": name, "body": body}}


def neutral(mass: float, inertia: float) -> Scene:
    """Make a neutrally buoyant body, both centres at its origin."""
    return {"mass": mass, "inertia": [inertia] * 3, "volume": mass / DENSITY}


def link(name: str, body: Scene, along: int = 2, position: Sequence[float] = (0.0, 0.0, 0.0), **joint: Any) -> Scene:
    """Make a link on a joint along x, y or z (0 to 2) through `position`; `joint` are further keys of the joint."""
    frame = {"position": list(position)}
    joint = {"kind": "revolute", "axis": np.eye(3)[along].tolist(), "frame": frame} | joint
    return {"name": name, "joint": joint, "body": body}


def with_arm(scene: Scene, *links: Scene, fixed: bool = False) -> Scene:
    """Scene with the links of an arm, on a vehicle that is free or fixed."""
    vehicle = scene["vehicle"] | {"fixed": fixed}
    return scene | {"vehicle": vehicle, "arm": {"name": "arm", "links": list(links)}}
