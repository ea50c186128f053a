"""Robots of every format that is read, in one form, that of `uvms_gym._core.read_robot`."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uvms_gym import _core, _files
from uvms_gym._importing import meshes, mjcf, parameters


@dataclass(frozen=True)
class Format:
    """A format: its name, how its files are known, and its reader."""

    name: str
    suffixes: tuple[str, ...]
    #: Name of the outermost XML element; "" for other text.
    element: str
    read: Callable[[Path], dict[str, Any]]


#: All formats. The native reader knows URDF and SDF, and names others in its refusal.
FORMATS = (
    Format("URDF", (".urdf", ".xml"), "robot", _core.read_robot),
    Format("SDF", (".sdf", ".world"), "sdf", _core.read_robot),
    Format("MJCF", (".xml", ".mjcf"), "mujoco", mjcf.read),
    Format("YAML", (".yaml", ".yml"), "", parameters.read),
)

#: Suffixes of further formats, which are refused by name.
_OTHERS = {
    ".toml": "a TOML file: a scene needs no import",
    ".m": "a MATLAB file: write its numbers as YAML, one key a line",
    ".scn": "a Stonefish scenario",
    ".usd": "a USD file",
    ".usda": "a USD file",
    ".usdc": "a USD file",
    ".stl": "a mesh, which has no masses and joints",
    ".obj": "a mesh, which has no masses and joints",
    ".dae": "a mesh, which has no masses and joints",
}


def read_robot(path: Path) -> dict[str, Any]:
    """Read a robot, with measured meshes; the format follows from the outermost element, else from the suffix.

    Raises
    ------
    SceneError
        The message names file, line or element, and what is allowed.
    """
    element = _element(path)
    known = [format for format in FORMATS if element and format.element == element]
    if not known and not element:
        known = [format for format in FORMATS if not format.element and path.suffix.lower() in format.suffixes]
    suffix, suffixes = path.suffix.lower(), {suffix for format in FORMATS for suffix in format.suffixes}
    other = "" if element or suffix in suffixes or not path.is_file() else "no XML"
    if not known and (what := _OTHERS.get(suffix, other)):
        names = ", ".join(f"{format.name} ({', '.join(format.suffixes)})" for format in FORMATS)
        raise _core.SceneError(f"{path}: is {what}; {names} are read")
    robot: dict[str, Any] = _stated(known[0].read(path) if known else _core.read_robot(path))
    meshes.measure(robot)
    return robot


def _stated(value: Any) -> Any:
    """Plain data without keys that are None: the native form has none."""
    if isinstance(value, dict):
        return {key: _stated(entry) for key, entry in value.items() if entry is not None}
    return [_stated(entry) for entry in value] if isinstance(value, list) else value


def _element(path: Path) -> str:
    """Name of the outermost XML element; "" where the file is no XML, or cannot be read."""
    try:
        head = _files.read(path)[:100_000].decode("utf-8", errors="replace")
    except OSError:
        return ""
    head = re.sub(r"<!--.*?-->|<\?.*?\?>", "", head.lstrip("\ufeff"), flags=re.DOTALL)
    head = re.sub(r"^\s*<!DOCTYPE[^>\[]*(\[.*?\]\s*)?>", "", head, flags=re.DOTALL)
    found = re.match(r"\s*<([A-Za-z_][\w.:-]*)", head)
    return found[1] if found else ""
