"""Terms of a scene that a file of another program cannot express, one line each."""

import re
from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from uvms_gym._scene import bodies, surroundings
from uvms_gym.export.tree import Link

#: Effects of a thruster without an element in any of the formats, by key.
_THRUSTER = {
    "dead_band": "dead band",
    "map": "map from command to thrust",
    "ambient_flow": "loss of thrust by inflow",
}


def water_and_vehicle(scene: dict[str, Any]) -> list[str]:
    """Terms of the water and the vehicle, which neither MJCF nor URDF expresses."""
    vehicle, found = scene["vehicle"], bodies(scene)

    def of(*keys: str) -> str:
        """Names of the bodies with a number other than 0 under these keys."""
        named = []
        for name, body in found:
            value: Any = body
            for key in keys:
                value = (value or {}).get(key)
            if value is not None and np.any(value):
                named.append(name)
        return "of all bodies" if len(named) == len(found) > 1 else f"of {', '.join(named)}" if named else ""

    terms: dict[str, tuple[str, ...]] = {"added mass": ("added_mass",)}
    terms |= {f"{kind} damping": ("damping", kind) for kind in ("linear", "quadratic")}
    lines = [f"{term} {names}" for term, keys in terms.items() if (names := of(*keys))]
    if any(scene["water"]["current"]):
        lines.append(f"current of {_numbers(scene['water']['current'])} m/s")
    if vehicle.get("forward_damping"):
        lines.append("damping by forward speed")
    if fins := vehicle.get("fins"):
        lines.append(f"fins: {_names(fins)}")
    if vehicle.get("tether"):
        lines.append("tether")
    lines += [f"{key}: {_names(tables)}" for key, tables in surroundings(scene).items() if tables]
    if vehicle.get("servo"):
        lines.append("gains of the vehicle's servo")
    for key, text in _THRUSTER.items():
        if with_key := [thruster for thruster in vehicle["thrusters"] if thruster.get(key)]:
            lines.append(f"{text}: {_names(with_key)}")
    return lines


def joints(links: Iterable[Link], **texts: str) -> list[str]:
    """Terms of joints by key, with a text for each; a key with two parts, "limits__damping", is a table and its key."""
    lines = []
    for key, text in texts.items():
        table, _, inner = key.partition("__")
        named = []
        for link in links:
            value = (link.joint or {}).get(table)
            if value and (not inner or value.get(inner)):
                named.append(link.name)
        if named:
            lines.append(f"{text}: {', '.join(named)}")
    return lines


def text_of(root: ET.Element, scene: dict[str, Any], language: str, lines: list[str]) -> str:
    """Text of a document, with comments at the top that list what it leaves out."""
    comments = [f"{scene['name']}, by uvms scenes export. SI units; x forward, y left, z up."]
    if lines:
        comments += [f"Left out, because {language} cannot express it:", *(f"- {line}" for line in lines)]
    # Two hyphens end a comment.
    root.insert(0, ET.Comment("\n    ".join(["", *comments]).replace("--", "- -") + "\n  "))
    ET.indent(root)
    # XML has no escape for control characters.
    return re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f]", "?", ET.tostring(root, encoding="unicode")) + "\n"


def _names(tables: Iterable[dict[str, Any]]) -> str:
    return ", ".join(table["name"] for table in tables)


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:g}" for value in values)
