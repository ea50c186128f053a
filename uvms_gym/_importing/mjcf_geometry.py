"""Geometry of MJCF: geoms as shapes of `uvms_gym.estimate` and as measured meshes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from uvms_gym._rotations import Floats, matrices, rpy_of


def geometry(model: Any, geom: int, offset: Floats, link: dict[str, Any], notes: list[str]) -> None:
    """Add a geom to a link whose frame is at `offset` (m) in its body; planes and height fields are left out."""
    from mujoco import mjtGeom

    size = model.geom_size[geom]
    pose = {
        "position": (model.geom_pos[geom] - offset).tolist(),
        "rpy": rpy_of(_matrix(model.geom_quat[geom])).tolist(),
    }
    kind = mjtGeom(model.geom_type[geom])
    shape: dict[str, Any] | None = None
    if kind == mjtGeom.mjGEOM_BOX:
        shape = {"box": (2.0 * size).tolist()}
    elif kind == mjtGeom.mjGEOM_SPHERE:
        shape = {"ellipsoid": [float(size[0])] * 3}
    elif kind == mjtGeom.mjGEOM_ELLIPSOID:
        shape = {"ellipsoid": size.tolist()}
    elif kind in (mjtGeom.mjGEOM_CAPSULE, mjtGeom.mjGEOM_CYLINDER):
        name = "capsule" if kind == mjtGeom.mjGEOM_CAPSULE else "cylinder"
        shape = {name: {"radius": float(size[0]), "length": 2.0 * float(size[1]), "axis": "z"}}
    if shape is not None:
        # Parts of a link are in a row: its ends join the next part.
        joined = {"ends": "joined"} if "ellipsoid" not in shape else {}
        link["shapes"].append(shape | pose | joined)
    elif kind == mjtGeom.mjGEOM_MESH:
        mesh, closed = _mesh(model, geom, pose)
        link["meshes"].append(mesh)
        if not closed:
            notes.append(f"{link['name']}: mesh {mesh['file']} is not closed: its convex hull is measured")


def drawings(model: Any, geoms: Sequence[int], offset: Floats) -> list[dict[str, Any]]:
    """Mesh files of geoms in the axes of the files, which draw a link whose frame is at `offset` (m) in its body."""
    found = []
    for geom in geoms:
        mesh = int(model.geom_dataid[geom])
        if mesh < 0 or model.mesh_pathadr[mesh] < 0:
            continue
        # MuJoCo has moved the vertices by the pose of the mesh.
        turn = _matrix(model.geom_quat[geom]) @ _matrix(model.mesh_quat[mesh]).T
        entry = {
            "file": model.paths[model.mesh_pathadr[mesh] :].split(b"\0")[0].decode(errors="replace"),
            "scale": model.mesh_scale[mesh].tolist(),
            "position": (model.geom_pos[geom] - offset - turn @ model.mesh_pos[mesh]).tolist(),
            "rpy": rpy_of(turn).tolist(),
        }
        found.append(entry | {"visual": True, "drawing": entry})
    return found


def _mesh(model: Any, geom: int, pose: dict[str, Any]) -> tuple[dict[str, Any], bool]:
    """A mesh in the axes of its geom, which MuJoCo turns to its principal axes, and whether it is closed."""
    from mujoco import mj_id2name, mjtObj

    from uvms_gym._importing.meshes import MeshError, measures_of

    mesh = int(model.geom_dataid[geom])
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = np.asarray(model.mesh_vert[start : start + count], dtype=np.float64).reshape(-1, 3)
    start, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    faces = np.asarray(model.mesh_face[start : start + count]).reshape(-1, 3)
    name = mj_id2name(model, mjtObj.mjOBJ_MESH, mesh) or str(mesh)
    entry = {"file": name, "scale": [1.0] * 3, "visual": False} | pose
    try:
        import trimesh

        measures, closed = measures_of(trimesh.Trimesh(vertices, faces, process=True), np.ones(3))
    except (ModuleNotFoundError, MeshError):
        # Without measures the link has the outline of its mass and moments, with a note.
        return entry, True
    turn = measures.pop("turn")
    if turn is not None:
        entry["rpy"] = rpy_of(_matrix(model.geom_quat[geom]) @ turn).tolist()
    return entry | measures, closed


def _matrix(quaternion: Floats) -> Floats:
    return matrices(np.asarray(quaternion, dtype=np.float64))
