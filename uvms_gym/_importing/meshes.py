"""Meshes (STL, OBJ, COLLADA) by trimesh, of the extra `import`: volume, its centre and moments, a box; triangles."""

import contextlib
import io
import re
import warnings
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym import _files
from uvms_gym._rotations import Floats, from_rpy, matrices, rpy_of

#: Maximum size of a mesh's file, bytes, and maximum number of its triangles.
MOST_BYTES, MOST_TRIANGLES = 100_000_000, 1_000_000

#: Maximum number of triangles of a file in pictures; larger meshes are simplified.
MOST_DRAWN = 20_000

#: Ratio of the volumes of a box along the principal axes and of the mesh's own box from which it replaces it.
_SMALLER = 0.8

#: Ratio of the volume of a convex hull and the cube of its length below which it is flat.
_FLAT = 1e-9

#: Maximum edge of a mesh's box, m: larger ones are in another unit.
_HUGE = 100.0

#: Folders above the robot's file that are searched for packages.
_LEVELS = 8

_KINDS = {".stl": "stl", ".obj": "obj", ".dae": "dae"}


class MeshError(ValueError):
    """A mesh that cannot be measured; the message is the reason, without the file."""


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """No warnings of trimesh and numpy about degenerate triangles: measures are checked here."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


@_quiet()
def measure(robot: dict[str, Any]) -> None:
    """Add the measures of its meshes to a robot, in place, and notes on meshes that could not be measured.

    Of each link, collision meshes are read; visual meshes only where there is no other geometry. Paths are sought
    beside the robot's file; `package://NAME/`, `model://NAME/` and `$(find NAME)/` also in the folders above it.

    Parameters
    ----------
    robot : dict
        As of `read_robot`. Each measured mesh gets `volume` (m3), `center` (m) and `inertia` (m5, about `center`, at
        density 1) of its volume, and the corners `lower` and `upper` (m) of its box, all in the mesh's axes after
        scaling. A mesh that is not closed is measured by its convex hull. Where a box along the principal axes is
        clearly smaller, `rpy` turns to these axes. `drawing` is the file, with scale and pose, of each visual
        mesh, or of each collision mesh of a link without visual ones.
    """
    folder, known = Path(robot["source"]).absolute().parent, dict[str, Any]()
    failed, open_ones = defaultdict[str, list[str]](list), defaultdict[str, list[str]](list)
    for link in robot["links"]:
        _find_drawings(link, folder, failed)
        meshes = [mesh for mesh in link["meshes"] if mesh.get("volume") is None]
        done = bool(link["shapes"]) or len(meshes) < len(link["meshes"])
        for visual in (False, True):
            for mesh in (mesh for mesh in meshes if mesh["visual"] == visual and not (visual and done)):
                name = mesh["file"]
                if name not in known:
                    known[name] = _load_or_reason(name, folder)
                if isinstance(known[name], str):
                    failed[known[name]].append(link["name"])
                    continue
                try:
                    measures, closed = measures_of(known[name], np.asarray(mesh["scale"], dtype=np.float64))
                except MeshError as error:
                    failed[f"{name} {error}"].append(link["name"])
                    continue
                own = matrices(from_rpy(np.array([mesh["rpy"]], dtype=np.float64)))[0]
                turn = measures.pop("turn")
                mesh.update(measures, **({} if turn is None else {"rpy": rpy_of(own @ turn).tolist()}))
                done = True
                if not closed:
                    open_ones[name].append(link["name"])
    for reason, links in failed.items():
        robot["notes"].append(f"{', '.join(dict.fromkeys(links))}: mesh not read: {reason}")
    for name, links in open_ones.items():
        robot["notes"].append(
            f"{', '.join(dict.fromkeys(links))}: mesh {name} is not closed: its convex hull is measured"
        )


def _find_drawings(link: dict[str, Any], folder: Path, failed: dict[str, list[str]]) -> None:
    if any("drawing" in mesh for mesh in link["meshes"]):
        return
    for mesh in [mesh for mesh in link["meshes"] if mesh["visual"]] or link["meshes"]:
        path, pose = locate(mesh["file"], folder), {key: mesh[key] for key in ("scale", "position", "rpy")}
        if path is None:
            # Named all the same, so that the body is drawn without meshes until the file is there.
            path = folder / re.sub(r"^\w+://", "", mesh["file"].strip().removeprefix("file://"))
            failed[_not_found(mesh["file"])].append(link["name"])
        mesh["drawing"] = {"file": str(path), **pose}


def locate(name: str, folder: Path) -> Path | None:
    """File of a mesh that a robot's file in `folder` names; None if there is none."""
    name = name.strip().replace("\\", "/").removeprefix("file://")
    found = re.fullmatch(r"(?:package|model)://([^/]+)/(.+)|\$\(find ([^)]+)\)/(.+)", name)
    if found is None:
        path = folder / name
        return path if path.is_file() else None
    package, rest = found[1] or found[3], found[2] or found[4]
    for level in [folder, *folder.parents][:_LEVELS]:
        for path in (level / package / rest, level / rest):
            if path.is_file():
                return path
    return None


def _load_or_reason(name: str, folder: Path) -> Any:
    """The mesh, or the reason why it cannot be read."""
    path = locate(name, folder)
    if path is None:
        return _not_found(name)
    try:
        return load(path)
    except MeshError as error:
        return f"{name} {error}"


def _not_found(name: str) -> str:
    where = "in the folders above" if "://" in name or "$(" in name else "beside"
    return f"{name}: not found {where} the robot's file"


def load(path: Path) -> Any:
    """Read a mesh: a `trimesh.Trimesh` in metres (COLLADA files state their unit), with merged vertices.

    `face_attributes["colour"]` (n, 3) is the colour of each triangle's material, 0 to 1; NaN without one.

    Raises
    ------
    MeshError
        The file cannot be read, is too large, or is no mesh; or trimesh is not installed.
    """
    kind = _KINDS.get(path.suffix.lower())
    if kind is None:
        raise MeshError(f"is a {path.suffix or 'nameless'} file, but {', '.join(_KINDS)} are read")
    try:
        data = _files.read(path, MOST_BYTES)
    except OSError as error:
        raise MeshError(f"cannot be read: {error.strerror}") from None
    if kind == "stl" and not data.lstrip().startswith(b"solid") and len(data) >= 84:
        _few(int.from_bytes(data[80:84], "little"))
    if kind == "obj":
        _few(data.count(b"\nf "))
    unit = 1.0
    if kind == "dae":
        if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
            raise MeshError("has an XML document type, which is not read")
        stated = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']*)[\"']", data)
        unit = float(stated[1]) if stated and re.fullmatch(rb"[0-9.eE+-]+", stated[1]) else 1.0
    mesh = _parse(data, kind)
    _few(len(mesh.faces))
    if len(mesh.faces) == 0 or not np.all(np.isfinite(mesh.vertices)):
        raise MeshError(f"has no triangles: it may be no {kind.upper()} file")
    if unit != 1.0:
        mesh.apply_scale(unit)
    mesh.merge_vertices()
    return mesh


def _few(triangles: int) -> None:
    if triangles > MOST_TRIANGLES:
        raise MeshError(f"has {triangles} triangles, but at most {MOST_TRIANGLES} are read: simplify it")


def _parse(data: bytes, kind: str) -> Any:
    try:
        import trimesh

        # Without a resolver, no other file is opened: materials and textures are not needed.
        scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=None)
        mesh, parts = scene.to_mesh(), [part for part in scene.dump() if hasattr(part, "faces")]
        materials = [getattr(part.visual, "material", None) for part in parts]
        colours = [np.full(3, np.nan) if m is None else m.main_color[:3] / 255.0 for m in materials]
        mesh.face_attributes["colour"] = np.repeat(colours, [len(part.faces) for part in parts], axis=0)
        return mesh
    except ModuleNotFoundError as error:
        raise MeshError(f"needs {error.name}: pip install 'uvms-gym[import]'") from None
    except Exception as error:  # Parsers of broken files raise anything.
        reason = " ".join(str(error).split())[:100]
        raise MeshError(f"is no readable {kind.upper()} file ({reason or type(error).__name__})") from None


def measures_of(mesh: Any, scale: Floats) -> tuple[dict[str, Any], bool]:
    """Measures of a mesh after scaling (3,), as `measure` adds them, and whether it is closed.

    They are in the principal axes if `turn` is a matrix (3, 3) of these, in columns; else it is None.

    Raises
    ------
    MeshError
        The mesh encloses no volume.
    """
    mesh = mesh.copy()
    mesh.apply_transform(np.diag([*scale, 1.0]))
    lower, upper = mesh.bounds
    if not (length := np.max(upper - lower)) <= _HUGE:
        limit = f"is {length:.3g} m long, but at most {_HUGE:g} m are read"
        raise MeshError(f"{limit}: is it in millimetres (scale 0.001)?")
    closed = bool(mesh.is_watertight and mesh.is_winding_consistent)
    # More than its box: parts are counted twice.
    closed = closed and 0.0 < abs(mesh.volume) <= np.prod(upper - lower) * (1.0 + 1e-6)
    if not closed:
        try:
            mesh = mesh.convex_hull
        except ModuleNotFoundError as error:
            raise MeshError(f"needs {error.name}: pip install 'uvms-gym[import]'") from None
        except Exception:  # from Qhull
            raise MeshError("is not closed and has no convex hull: it is flat") from None
        if not mesh.volume > _FLAT * np.max(upper - lower) ** 3:
            raise MeshError("is not closed and its convex hull is flat")
    elif mesh.volume < 0.0:
        mesh.invert()
    centre, inertia, turn = mesh.center_mass, np.asarray(mesh.moment_inertia), None
    axes = np.linalg.eigh(inertia)[1]
    axes[:, 0] *= np.linalg.det(axes)
    along = mesh.vertices @ axes
    if np.prod(np.ptp(along, axis=0)) < _SMALLER * np.prod(upper - lower):
        turn, centre, inertia = axes, centre @ axes, axes.T @ inertia @ axes
        lower, upper = along.min(axis=0), along.max(axis=0)
    measures = {
        "volume": float(mesh.volume),
        "center": centre.tolist(),
        "inertia": ((inertia + inertia.T) / 2.0).tolist(),
        "lower": lower.tolist(),
        "upper": upper.tolist(),
        "turn": turn,
    }
    return measures, closed


def missing(scene: dict[str, Any]) -> list[str]:
    """Warnings about the mesh files of a scene that are not there, one each."""
    found = [(file, who) for file, who in _carriers(scene).items() if not Path(file).is_file()]
    return [f"{who}: mesh file {file} does not exist: drawn without meshes" for file, who in found]


def _carriers(scene: dict[str, Any]) -> dict[str, str]:
    """Vehicle, base or links that each mesh file of a scene draws, by the files' names."""
    arm, names = scene.get("arm") or {}, defaultdict[str, list[str]](list)
    links = [(f"link {link['name']}", link) for link in arm.get("links", ())]
    for name, part in [("vehicle", scene["vehicle"]), ("base", arm), *links]:
        for mesh in part.get("meshes", ()):
            names[mesh["file"]].append(name)
    return {file: ", ".join(dict.fromkeys(bodies)) for file, bodies in names.items()}


def facets(scene: dict[str, Any]) -> dict[str, NDArray[np.float32]]:
    """Triangles of the mesh files of a scene, in metres and in the files' axes, by the files' names.

    Returns
    -------
    dict of str to numpy.ndarray (n, 12)
        Of each triangle three corners, counterclockwise as seen from outside, and red, green and blue, 0 to 1, or NaN.
        A mesh that is not closed has both sides. Without files that cannot be read, for which there is a warning.
    """
    found = dict[str, NDArray[np.float32]]()
    for file, who in _carriers(scene).items():
        try:
            found[file] = _facets(load(Path(file)))
        except MeshError as error:
            warnings.warn(f"{who}: drawn without meshes: {file} {error}", stacklevel=2)
    return found


def _facets(mesh: Any) -> NDArray[np.float32]:
    """Rows of `facets` of one mesh, at most `MOST_DRAWN` of each side."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    colours, cells = mesh.face_attributes["colour"], 512.0
    closed = mesh.is_watertight and mesh.is_winding_consistent
    while len(faces) > MOST_DRAWN:
        # Vertices in a cell of a grid become their mean, and triangles within two cells vanish.
        steps = (mesh.vertices - mesh.bounds[0]) * (cells / (np.max(mesh.extents) or 1.0))
        cell = np.unique(steps.astype(np.int64) @ [1, 1 << 20, 1 << 40], return_inverse=True)[1]
        vertices = np.stack([np.bincount(cell, x) for x in mesh.vertices.T], axis=1) / np.bincount(cell)[:, None]
        corners = np.sort(cell[mesh.faces], axis=1)
        kept = np.unique(corners, axis=0, return_index=True)[1]
        kept = kept[np.all(np.diff(corners[kept]) > 0, axis=1)]
        faces, colours, cells = cell[mesh.faces[kept]], mesh.face_attributes["colour"][kept], 0.8 * cells
    if closed and mesh.volume < 0.0:
        faces = faces[:, ::-1]
    sides = [faces] if closed else [faces, faces[:, ::-1]]
    rows = [np.concatenate([vertices[side].reshape(-1, 9), colours], axis=1) for side in sides]
    return np.concatenate(rows).astype(np.float32)
