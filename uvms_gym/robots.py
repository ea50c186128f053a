"""Scenes from robots' files."""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

from uvms_gym import _core
from uvms_gym._importing import read_robot

_Density: TypeAlias = float | Mapping[str, float] | Sequence[tuple[str | None, float]] | None


def import_robot(
    path: str | PathLike[str],
    *,
    vehicle: str | PathLike[str] | dict[str, Any] | None = None,
    thrusters: str | PathLike[str] | dict[str, Any] | None = None,
    mount: Sequence[float] | None = None,
    base: str | None = None,
    tip: str | Sequence[str] | Mapping[str, str] | None = None,
    lock: Sequence[str] = (),
    keep: Sequence[str] = (),
    density: float | Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """Make a scene of a robot's file: a vehicle with its thrusters and arms, a vehicle alone, or an arm on a vehicle.

    Joint frames, axes, limits, effort, speed, damping, friction, springs and inertias come from the file. All joints
    that move become joints of one tree, fingers among them; links on fixed joints are merged into their carriers.
    The first link is the hull of a vehicle if it carries thrusters or propellers, if the file states its
    hydrodynamics, if it is on a floating joint, if nothing moves on it, if it outweighs all that moves on it, or if
    the robot's name says so; else it is the base of an arm, mounted on `vehicle`. A vehicle whose file states no
    thrusters gets assumed ones. Volume, added mass and damping that the file does not state are
    estimated from the collision geometry, or from the visual geometry (see `estimate`); a link without either has the
    hydrodynamics of the homogeneous ellipsoid of its mass and moments. Servos and end stops follow from the inertia
    and the weight that each joint carries. Integrator and step are those of `recommend_integration`. The scene's
    provenance names the source of every number.

    Parameters
    ----------
    path : str or os.PathLike
        URDF (expand xacro files first), SDF, MJCF, or YAML of a vehicle's parameters. Meshes, MJCF and YAML need the
        extra `import`; without it meshes are left out, with a note.
    vehicle : str, os.PathLike or dict, optional
        Scene of the water and the vehicle, which take the place of the file's hull; its arm and payload are left out.
        An arm alone is mounted on `bluerov2-heavy` by default, and on `rexrov` if its mass is above a quarter of the
        former's, 3.4 kg.
    thrusters : {"file", "assumed"}, str, os.PathLike or dict, optional
        Thrusters of a vehicle in the file: the file's alone, assumed ones, or the ones of a scene's vehicle, at their
        places there. Assumed are eight ideal thrusters at the edges of the hull's box, four vectored and four
        vertical, which together push as much as the robot weighs. Default: the file's; assumed if it states none.
    mount : sequence of 6 floats, optional
        First link in the frame of that vehicle: x, y, z (m), roll, pitch, yaw (rad). Default: at its origin.
    base : str, optional
        First link of the robot; needed where the file has several links without parent.
    tip : str, sequence of str or dict, optional
        End effectors, the default one first: links whose frames they have, "NAME=LINK", or a dict of links by names.
        Default: each end of the tree that is no finger, the longest arm's first.
    lock : sequence of str
        Joints to freeze, at 0 or the nearest limit.
    keep : sequence of str
        The only joints that move. Default: all but those locked, propellers and fins.
    density : float or dict, optional
        Density of all links without mass, or densities by links, kg/m3: masses follow from shapes.

    Returns
    -------
    dict
        The scene, as of `load_scene`; `dump_scene` converts it to TOML text.

    Raises
    ------
    SceneError
        The message names file, line and element, or the option.
    """
    chosen: dict[str, Any] = {"base": base, "tip": tip, "lock": lock, "keep": keep, "density": density}
    return import_with_notes(path, vehicle=vehicle, thrusters=thrusters, mount=mount, **chosen)[0]


def import_with_notes(
    path: str | PathLike[str],
    *,
    vehicle: str | PathLike[str] | dict[str, Any] | None = None,
    thrusters: str | PathLike[str] | dict[str, Any] | None = None,
    mount: Sequence[float] | None = None,
    base: str | None = None,
    tip: str | Sequence[str] | Mapping[str, str] | None = None,
    lock: Sequence[str] = (),
    keep: Sequence[str] = (),
    density: _Density = None,
) -> tuple[dict[str, Any], list[str]]:
    """Scene of `import_robot`, and notes: each part that was guessed, merged, frozen or left out."""
    pose = (0.0,) * 6 if mount is None else mount
    if len(pose) != 6:
        raise _core.SceneError(f"mount must be 6 numbers (x, y, z, roll, pitch, yaw), but has {len(pose)}")
    scene, notes = _core.assemble_robot(
        read_robot(Path(path)),
        vehicle=vehicle,
        thrusters=thrusters,
        position=pose[:3],
        rpy=pose[3:],
        base=base,
        tips=_named(tip),
        lock=_names(lock),
        keep=_names(keep),
        density=_densities(density),
    )
    return with_integration(scene, notes)


def _names(given: str | Sequence[str]) -> list[str]:
    return [given] if isinstance(given, str) else list(given)


def _named(tip: str | Sequence[str] | Mapping[str, str] | None) -> list[tuple[str, str]]:
    """Names and links of end effectors."""
    if isinstance(tip, Mapping):
        return list(tip.items())
    parts = [text.partition("=") for text in _names(() if tip is None else tip)]
    return [(name, link if equals else name) for name, equals, link in parts]


def _densities(given: _Density) -> list[tuple[str | None, float]]:
    """Links, None for all without mass, and densities."""
    if isinstance(given, Mapping):
        return [(link, float(density)) for link, density in given.items()]
    if isinstance(given, Sequence):
        return list(given)
    return [] if given is None else [(None, float(given))]


def with_integration(scene: dict[str, Any], notes: Sequence[str] = ()) -> tuple[dict[str, Any], list[str]]:
    """Scene that states the recommended integrator and step, and notes with the reason."""
    advice = _core.recommend_integration(scene)
    stated = {"integrator": advice["integrator"], "step": advice["step"]}
    note = f"integration: {stated['integrator']} at {stated['step']} s: {advice['reason']}"
    return {**scene, "integration": stated}, [*notes, note]
