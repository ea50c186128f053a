"""Meshes of robots' files: measures, and meshes that cannot be read."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uvms_gym._importing import meshes
from uvms_gym._rotations import about, from_rpy, matrices
from uvms_gym.robots import import_with_notes


def box_mesh(size: tuple[float, float, float], at: tuple[float, float, float]) -> Any:
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.creation.box(extents=size)
    mesh.apply_translation(at)
    return mesh


def linked(folder: Path, file: str, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> dict[str, Any]:
    entry = {"file": file, "scale": list(scale), "position": [0.0] * 3, "rpy": [0.0] * 3, "visual": True}
    return {
        "source": str(folder / "robot.urdf"),
        "notes": [],
        "links": [{"name": "link", "shapes": [], "meshes": [entry]}],
    }


@pytest.mark.parametrize("kind", ["stl", "obj", "dae"])
@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (0.5, -1.0, 2.0)])
def test_val_a_mesh_of_a_box_has_the_measures_of_the_box(
    tmp_path: Path, kind: str, scale: tuple[float, float, float]
) -> None:
    mesh = box_mesh((2.0, 1.0, 0.5), (1.0, 0.25, 0.0))
    if kind == "dae":
        pytest.importorskip("collada")
    mesh.export(tmp_path / f"box.{kind}")
    robot = linked(tmp_path, f"box.{kind}", scale)
    meshes.measure(robot)
    (found,) = robot["links"][0]["meshes"]
    size, centre = np.abs(np.array([2.0, 1.0, 0.5]) * scale), np.array([1.0, 0.25, 0.0]) * scale
    volume = np.prod(size)
    square = size**2 * volume / 12.0
    assert found["volume"] == pytest.approx(volume, rel=1e-12)
    np.testing.assert_allclose(found["center"], centre, atol=1e-12)
    np.testing.assert_allclose(found["inertia"], np.diag(square.sum() - square), atol=1e-9)
    np.testing.assert_allclose([found["lower"], found["upper"]], [centre - size / 2.0, centre + size / 2.0], atol=1e-12)
    assert robot["notes"] == []


def test_val_a_slender_mesh_across_its_axes_gets_a_box_along_it(tmp_path: Path) -> None:
    mesh, turn = box_mesh((2.0, 0.2, 0.1), (0.3, 0.0, 0.0)), about([1.0, 2.0, 3.0] / np.sqrt(14.0), 0.7)
    mesh.apply_transform(np.block([[turn, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]))
    mesh.export(tmp_path / "box.obj", digits=15)
    robot = linked(tmp_path, "box.obj")
    robot["links"][0]["meshes"][0]["rpy"] = [0.3, -0.2, 0.1]
    meshes.measure(robot)
    (found,) = robot["links"][0]["meshes"]
    own, turned = (matrices(from_rpy(np.array([rpy])))[0] for rpy in ([0.3, -0.2, 0.1], found["rpy"]))
    np.testing.assert_allclose(np.sort(np.subtract(found["upper"], found["lower"])), [0.1, 0.2, 2.0], atol=1e-9)
    centre = own @ turn @ [0.3, 0.0, 0.0]
    np.testing.assert_allclose(turned @ found["center"], centre, atol=1e-9)
    np.testing.assert_allclose(turned @ np.add(found["upper"], found["lower"]) / 2.0, centre, atol=1e-9)
    size = np.array([2.0, 0.2, 0.1])
    moments = np.diag((size @ size - size**2) * 0.04 / 12.0)
    inertia = turned @ found["inertia"] @ turned.T
    np.testing.assert_allclose(inertia, own @ turn @ moments @ turn.T @ own.T, atol=1e-9)


def test_a_unit_of_collada_is_followed(tmp_path: Path) -> None:
    pytest.importorskip("collada")
    text = box_mesh((200.0, 100.0, 50.0), (0.0, 0.0, 0.0)).export(file_type="dae").decode()
    (tmp_path / "box.dae").write_text(text.replace("<up_axis>", '<unit name="cm" meter="0.01"/><up_axis>'))
    robot = linked(tmp_path, "box.dae")
    meshes.measure(robot)
    assert robot["links"][0]["meshes"][0]["volume"] == pytest.approx(1.0)


def test_an_open_mesh_is_measured_by_its_convex_hull(tmp_path: Path) -> None:
    mesh = box_mesh((2.0, 1.0, 0.5), (0.0, 0.0, 0.0))
    mesh.update_faces(np.arange(12) > 1)
    mesh.export(tmp_path / "open.stl")
    robot = linked(tmp_path, "open.stl")
    meshes.measure(robot)
    assert robot["links"][0]["meshes"][0]["volume"] == pytest.approx(1.0)
    assert robot["notes"] == ["link: mesh open.stl is not closed: its convex hull is measured"]


def test_meshes_that_cannot_be_read_are_noted_with_the_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("trimesh")
    monkeypatch.setattr(meshes, "MOST_BYTES", 1000)
    for name, data in {
        "text.stl": b"nonsense",
        "empty.stl": b"",
        "many.stl": b"\0" * 80 + struct.pack("<I", 10**9),
        "cut.stl": b"\0" * 80 + struct.pack("<I", 1000) + b"12",
        "flat.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "sheet.obj": b"v 0 0 0\nv 1 0 1e-17\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n",
        "nan.obj": b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "bomb.dae": b'<!DOCTYPE a [<!ENTITY x "y">]><COLLADA>&x;</COLLADA>',
        "huge.stl": b"\0" * 1001,
        "robot.step": b"ISO-10303-21;",
    }.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "folder.stl").mkdir()
    for name, reason in {
        "text.stl": "has no triangles",
        "empty.stl": "has no triangles",
        "many.stl": "1000000000 triangles, but at most 1000000",
        "cut.stl": "has no triangles",
        "flat.obj": "is flat",
        "sheet.obj": "is flat",
        "nan.obj": "has no triangles",
        "bomb.dae": "document type",
        "huge.stl": "1001 bytes, but at most 1000",
        "robot.step": "is a .step file",
        "none.stl": "not found beside the robot's file",
        "folder.stl": "not found beside the robot's file",
        "package://none/a.stl": "not found in the folders above the robot's file",
    }.items():
        robot = linked(tmp_path, name)
        meshes.measure(robot)
        (note,) = robot["notes"]
        assert note.startswith(f"link: mesh not read: {name}") and reason in note and "\n" not in note
        assert "volume" not in robot["links"][0]["meshes"][0]


@pytest.mark.parametrize(
    "name", ["package://robot/meshes/a.stl", "model://robot/meshes/a.stl", "$(find robot)/meshes/a.stl"]
)
def test_packages_are_sought_in_the_folders_above(tmp_path: Path, name: str) -> None:
    for folder in ("workspace/robot/meshes", "workspace/description/urdf"):
        (tmp_path / folder).mkdir(parents=True)
    mesh = tmp_path / "workspace/robot/meshes/a.stl"
    mesh.write_text("")
    assert meshes.locate(name, tmp_path / "workspace/description/urdf") == mesh
    assert meshes.locate(name, mesh.parent) == mesh
    assert meshes.locate(name, tmp_path) is None


@pytest.mark.filterwarnings("error")
def test_degenerate_meshes_warn_of_nothing(tmp_path: Path) -> None:
    mesh = box_mesh((2.0, 1.0, 0.5), (0.0, 0.0, 0.0))
    mesh.export(tmp_path / "box.stl")
    (tmp_path / "sheet.obj").write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n")
    for name, scale in (
        ("box.stl", [0.0, 1.0, 1.0]),
        ("box.stl", [1e200, 1e200, 1e200]),
        ("sheet.obj", [1.0, 1.0, 1.0]),
    ):
        robot = linked(tmp_path, name)
        robot["links"][0]["meshes"][0]["scale"] = scale
        meshes.measure(robot)
        assert robot["notes"], name


def test_a_mesh_in_millimetres_is_left_out_with_a_note(tmp_path: Path) -> None:
    box_mesh((457.0, 338.0, 254.0), (0.0, 0.0, 0.0)).export(tmp_path / "hull.stl")
    mesh = "<collision><geometry><mesh filename='hull.stl'{}/></geometry></collision>"
    mass = "<inertial><mass value='11'/><inertia ixx='.2' ixy='0' ixz='0' iyy='.25' iyz='0' izz='.3'/></inertial>"
    for scale, left_out in (("", True), (" scale='.001 .001 .001'", False)):
        path = tmp_path / "robot.urdf"
        path.write_text(f"<robot name='r'><link name='hull'>{mass}{mesh.format(scale)}</link></robot>")
        scene, notes = import_with_notes(path)
        assert any("457 m long" in note and "scale 0.001" in note for note in notes) == left_out
        assert scene["vehicle"]["body"]["volume"] == pytest.approx(0.011)
        size = scene["vehicle"]["shape"]["size"]
        assert (np.max(np.abs(np.array(size) - [0.457, 0.338, 0.254])) < 1e-6) != left_out
