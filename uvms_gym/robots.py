"""Scenes from URDF files."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from uvms_gym import _core


def import_urdf(
    path: str | PathLike[str],
    vehicle: str | PathLike[str] | dict[str, Any] = "bluerov2-heavy",
    *,
    mount: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    base: str | None = None,
    tip: str | None = None,
) -> dict[str, Any]:
    """Make a scene of a vehicle and the arm of a URDF file.

    Joint frames, axes, limits, effort, speed, damping, friction and inertias come from the file; bodies on fixed
    joints and side branches are merged into the links that carry them. Volume, added mass and damping are estimated
    from the collision geometry, or from the visual geometry (see `estimate`). Meshes are not read: such a link has
    the hydrodynamics of the homogeneous ellipsoid of its mass and moments. Servos and end stops follow from the
    inertia that each joint carries. Integrator and step are those of `recommend_integration`. The scene's
    provenance names the source of every number.

    Parameters
    ----------
    path : str or os.PathLike
        URDF file; expand xacro files first.
    vehicle : str, os.PathLike or dict
        Scene of the water and the vehicle; its arm and payload are left out.
    mount : sequence of 6 floats
        Base link in the vehicle frame: x, y, z (m), roll, pitch, yaw (rad).
    base, tip : str, optional
        First and last link of the chain; needed where the file has several roots or ends. The tip's frame is the end
        effector's.

    Returns
    -------
    dict
        The scene, as of `load_scene`; `dump_scene` converts it to TOML text.

    Raises
    ------
    SceneError
        The message names file, line and element.
    """
    return import_with_notes(path, vehicle, mount=mount, base=base, tip=tip)[0]


def import_with_notes(
    path: str | PathLike[str],
    vehicle: str | PathLike[str] | dict[str, Any],
    *,
    mount: Sequence[float],
    **chain: str | None,
) -> tuple[dict[str, Any], list[str]]:
    """Scene, and notes on merged, estimated and missing parts; `chain` is `base` and `tip`."""
    if len(mount) != 6:
        raise _core.SceneError(f"mount must be 6 numbers (x, y, z, roll, pitch, yaw), but has {len(mount)}")
    file = Path(path)
    if file.suffix == ".toml":
        raise _core.SceneError(f"{file}: is a TOML file, but must be a URDF file")
    scene, notes = _core.import_urdf(path, vehicle=vehicle, position=mount[:3], rpy=mount[3:], **chain)
    return with_integration(scene, notes)


def with_integration(scene: dict[str, Any], notes: Sequence[str] = ()) -> tuple[dict[str, Any], list[str]]:
    """Scene that states the recommended integrator and step, and notes with the reason."""
    advice = _core.recommend_integration(scene)
    stated = {"integrator": advice["integrator"], "step": advice["step"]}
    note = f"integration: {stated['integrator']} at {stated['step']} s: {advice['reason']}"
    return {**scene, "integration": stated}, [*notes, note]
