"""Mesh files of scenes: pictures, import, composition and export."""

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import uvms_gym
from uvms_gym import Renderer, Simulator
from uvms_gym._importing import meshes
from uvms_gym._rotations import Floats, from_rpy, matrices
from uvms_gym.cli import main

trimesh = pytest.importorskip("trimesh")

POSE = {"position": [0.3, -0.2, 0.1], "rpy": [0.4, -0.5, 0.6]}


def wedge(file: Path) -> Any:
    """A closed mesh without symmetries."""
    mesh = trimesh.Trimesh(
        [[0.0, 0, 0], [0.4, 0, 0], [0, 0.2, 0], [0, 0, 0.1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    )
    mesh.export(file)
    return mesh


def scene_with(*files: dict[str, Any], **arm: Any) -> dict[str, Any]:
    body = {"mass": 1.0, "inertia": [0.01, 0.01, 0.01]}
    scene = {
        "name": "drawn",
        "water": {"density": 1000.0, "gravity": [0.0, 0.0, -9.81]},
        "vehicle": {"name": "hull", "body": {**body, "mass": 20.0, "volume": 0.02}, "meshes": list(files)},
    }
    if arm:
        links = [{"body": body, **link} for link in arm.pop("links")]
        for link in links:
            if link["joint"]["kind"] == "fixed":
                link.pop("body")
        scene["arm"] = {"name": "arm", "links": links, **arm}
    return scene


def corners(mesh: Any, scale: Any = (1.0, 1.0, 1.0)) -> Floats:
    """Corners (n, 3, 3) of the triangles, outside counterclockwise."""
    found = np.asarray(mesh.vertices[mesh.faces] * scale)
    return found[:, ::-1] if np.prod(scale) < 0.0 else found


def drawn(scene: dict[str, Any], body: str = "vehicle") -> Floats:
    """Triangles of a body without the mark of the end effector, which is pink."""
    vertices, _, colours, triangles = Renderer(scene).meshes()[body]
    pink = np.abs(colours - np.array([0xFF, 0x2F, 0xD0]) / 255.0).max(axis=1) < 0.01
    return np.asarray(vertices[triangles[~pink[triangles[:, 0]]]], dtype=np.float64)


def count(scene: dict[str, Any], body: str) -> int:
    return len(Renderer(scene).meshes()[body][3])


def moved(triangles: Floats, pose: dict[str, Any]) -> Floats:
    return triangles @ matrices(from_rpy(np.array(pose["rpy"]))).T + pose["position"]


def assert_same(found: Floats, expected: Floats) -> None:
    """Same triangles with the same outside, in any order."""

    def ordered(triangles: Floats) -> Floats:
        rounded = np.round(triangles, 5) + 0.0
        first = np.lexsort(rounded.transpose(2, 0, 1)[::-1], axis=1)[:, 0]
        turned = np.array([np.roll(t, -k, axis=0) for t, k in zip(rounded, first)])
        return turned[np.lexsort(turned.reshape(len(turned), -1).T)]

    assert found.shape == expected.shape
    np.testing.assert_allclose(ordered(found), ordered(expected), atol=2e-5)


@pytest.mark.parametrize("kind", ["stl", "obj", "dae"])
@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (0.5, -1.0, 2.0)])
def test_val_a_mesh_is_drawn_at_its_pose(tmp_path: Path, kind: str, scale: tuple[float, float, float]) -> None:
    if kind == "dae":
        pytest.importorskip("collada")
    mesh = wedge(tmp_path / f"hull.{kind}")
    scene = scene_with({"file": str(tmp_path / f"hull.{kind}"), "scale": list(scale), **POSE})
    assert_same(drawn(scene), moved(corners(mesh, scale), POSE))
    vertices, normals, _, _ = Renderer(scene).meshes()["vehicle"]
    assert np.all(np.sum((vertices - vertices.mean(axis=0)) * normals, axis=1) > 0.0)
    box, low, high = Renderer(scene).bounding_box, vertices.min(axis=0), vertices.max(axis=0)
    np.testing.assert_allclose(box, [(low + high) / 2.0, high - low], atol=1e-6)


def test_val_links_of_a_tree_are_drawn_at_their_poses(tmp_path: Path) -> None:
    mesh = wedge(tmp_path / "part.stl")
    file = {"file": str(tmp_path / "part.stl")}
    turn = {"kind": "revolute", "axis": [0.0, 1.0, 0.0], "home": 0.7}
    fixed = {"kind": "fixed", "frame": POSE}
    links = [
        {"name": "left", "joint": {**turn, "frame": POSE}, "meshes": [file]},
        {"name": "tool", "joint": fixed, "meshes": [{**file, **POSE}]},
        {"name": "right", "parent": "vehicle", "joint": turn, "meshes": [file, {**file, **POSE}]},
        {"name": "mast", "parent": "vehicle", "joint": fixed, "meshes": [file]},
    ]
    scene = scene_with(links=links, mount={"frame": POSE}, meshes=[file], end_effector={"on": "right"})
    own, at = corners(mesh), moved(corners(mesh), POSE)
    assert_same(drawn(scene, "link 1"), np.concatenate([own, moved(at, POSE)]))
    assert_same(drawn(scene, "link 2"), np.concatenate([own, at]))
    # Base and mast, beside the hull's own box.
    assert_same(drawn(scene)[-2 * len(own) :], np.concatenate([at, at]))
    picture = Renderer(scene).draw(np.zeros(3), np.eye(3))
    assert (picture != Renderer(scene).draw(np.zeros(3), np.eye(3), [0.0, 0.7])).any()


def test_the_mark_of_the_end_effector_belongs_to_its_body() -> None:
    joint = {"kind": "revolute", "axis": [0.0, 1.0, 0.0]}
    links = [{"name": name, "joint": joint, "parent": "vehicle"} for name in ("left", "right")]
    for name, marked in (("left", "link 1"), ("right", "link 2"), ("vehicle", "vehicle")):
        scene = scene_with(links=links, end_effector={"on": name, "position": [0.0, 0.0, 0.5]})
        found = {body for body in ("vehicle", "link 1", "link 2") if len(drawn(scene, body)) < count(scene, body)}
        assert found == {marked}


def test_axes_ned_hold_for_the_pose_and_not_for_the_file(tmp_path: Path) -> None:
    mesh = wedge(tmp_path / "hull.stl")
    scene = scene_with({"file": str(tmp_path / "hull.stl"), **POSE})
    scene["vehicle"]["axes"] = "ned"
    assert_same(drawn(scene), moved(corners(mesh), POSE) * [1.0, -1.0, -1.0])


BAD = {
    "missing.stl": (None, "missing.stl cannot be read: No such file"),
    "broken.stl": (b"no mesh at all", "broken.stl "),
    "none.obj": (b"v 0 0 0\n", "none.obj "),
    "hull.ply": (b"ply\n", "hull.ply is a .ply file, but .stl, .obj, .dae are read"),
    "many.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\n" * 1_000_001, "many.obj has .* at most 1000000 are read"),
    "entities.dae": (b'<!DOCTYPE a [<!ENTITY a "b">]><a/>', "entities.dae has an XML document type"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_cannot_be_read_leaves_the_drawing_without_it(tmp_path: Path, name: str) -> None:
    data, message = BAD[name]
    if data is not None:
        (tmp_path / name).write_bytes(data)
    wedge(tmp_path / "good.stl")
    scene = scene_with({"file": str(tmp_path / "good.stl")}, {"file": str(tmp_path / name)})
    plain = scene_with()
    Simulator(scene).step()
    with pytest.warns(UserWarning, match=f"^vehicle: drawn without meshes: .*{message}") as warned:
        renderer = Renderer(scene)
    assert len(warned) == 1 and "\n" not in str(warned[0].message)
    at = (np.zeros(3), np.eye(3))
    np.testing.assert_array_equal(renderer.draw(*at), Renderer(plain).draw(*at))


def test_check_warns_of_mesh_files_that_do_not_exist(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "there.stl").touch()
    path, lost = tmp_path / "drawn.toml", str(tmp_path / "lost.stl")
    links = [{"name": "boom", "joint": {"kind": "fixed", "frame": POSE}, "meshes": [{"file": lost}]}]
    scene = scene_with({"file": lost}, {"file": str(tmp_path / "there.stl")}, links=links, mount={"frame": POSE})
    path.write_text(uvms_gym.dump_scene(scene))
    assert main(["scenes", "check", str(path), "--json", str(tmp_path / "found.json")]) == 0
    found = [text for text in json.loads((tmp_path / "found.json").read_text())["warnings"] if "mesh" in text]
    assert found == [f"vehicle, link boom: mesh file {lost} does not exist: drawn without meshes"]
    assert "warning: vehicle, link boom: mesh file" in capsys.readouterr().out


def test_without_trimesh_the_warning_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wedge(tmp_path / "hull.stl")
    monkeypatch.setitem(__import__("sys").modules, "trimesh", None)
    with pytest.warns(UserWarning, match=r"needs trimesh: pip install 'uvms-gym\[import\]'"):
        Renderer(scene_with({"file": str(tmp_path / "hull.stl")}))


def test_physics_does_not_depend_on_meshes(tmp_path: Path) -> None:
    ends = []
    for files in ((), ({"file": str(tmp_path / "missing.stl")},)):
        simulator = Simulator(scene_with(*files))
        simulator.step()
        ends.append(simulator.position)
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize(("mesh", "message"), [
    ({"file": ""}, r"vehicle\.meshes\[0\]\.file: .*must be the path of an STL, OBJ or COLLADA file"),
    ({"file": "a.stl", "scale": [1.0, 0.0, 1.0]}, r"meshes\[0\]\.scale\[1\]: is 0.0, but must be other than 0"),
    ({"scale": [1.0, 1.0, 1.0]}, r"vehicle\.meshes\[0\]\.file"),
    ({"file": "a.stl", "colour": [1.0, 1.0, 1.0]}, r"vehicle\.meshes\[0\]\.colour"),
])  # fmt: skip
def test_a_table_that_names_no_mesh_is_refused(mesh: dict[str, Any], message: str) -> None:
    with pytest.raises(uvms_gym.SceneError, match=message):
        uvms_gym.load_scene(scene_with(mesh))


def test_large_meshes_are_simplified(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.5)
    assert len(ball.faces) > 4 * meshes.MOST_DRAWN
    ball.export(tmp_path / "ball.stl")
    found = drawn(scene_with({"file": str(tmp_path / "ball.stl")}))
    assert meshes.MOST_DRAWN / 4 < len(found) <= meshes.MOST_DRAWN
    volume = np.sum(np.linalg.det(found)) / 6.0
    assert volume == pytest.approx(ball.volume, rel=0.01)
    radii = np.linalg.norm(found, axis=2)
    assert 0.495 < radii.min() and radii.max() < 0.501


def test_an_open_mesh_has_two_sides_and_materials_have_colours(tmp_path: Path) -> None:
    pytest.importorskip("collada")
    sheet = trimesh.Trimesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    text = sheet.export(file_type="dae").decode()
    (tmp_path / "sheet.dae").write_text(re.sub(r"(<diffuse>\s*<color>)[^<]*", r"\g<1>1.0 0.2 0.0 1.0", text))
    scene = scene_with({"file": str(tmp_path / "sheet.dae")})
    assert_same(drawn(scene), np.stack([corners(sheet)[0], corners(sheet)[0, ::-1]]))
    np.testing.assert_allclose(Renderer(scene).meshes()["vehicle"][2], np.tile([1.0, 0.2, 0.0], (6, 1)), atol=0.01)


def test_files_are_relative_to_the_file_that_names_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, folder = wedge(tmp_path / "hull.stl"), tmp_path / "parts"
    folder.mkdir()
    own = wedge(folder / "arm.stl")
    part = scene_with(
        {"file": "../hull.stl"},
        links=[],
        meshes=[{"file": "arm.stl", **POSE}],
        base={"mass": 1.0, "inertia": [0.01] * 3},
    )
    monkeypatch.chdir(folder)
    text = uvms_gym.dump_scene(part)
    assert str(folder / "arm.stl") in text and uvms_gym.load_scene(part) == uvms_gym.load_scene(
        uvms_gym.load_scene(part)
    )
    (folder / "part.toml").write_text(text.replace(f"{folder}/", ""))
    monkeypatch.chdir(tmp_path)
    whole = tmp_path / "whole.toml"
    whole.write_text(
        'name = "w"\nvehicle.file = "parts/part.toml"\narms = [{ name = "left", file = "parts/part.toml" }]\n'
    )
    scene = uvms_gym.load_scene(whole)
    (base,) = [link for link in scene["arm"]["links"] if link["name"] == "left-base"]
    assert base["meshes"][0]["file"] == str(folder / "arm.stl")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere/copy.toml").write_text(uvms_gym.dump_scene(whole))
    assert uvms_gym.load_scene(tmp_path / "elsewhere/copy.toml") == scene
    assert_same(drawn(scene), np.concatenate([corners(mesh), moved(corners(own), POSE)]))


URDF = """<robot name="r">
  <link name="hull"><inertial><mass value="20"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="1 1 1"/></geometry></collision>
    <collision><geometry><mesh filename="rough.stl"/></geometry></collision>
    <visual><origin xyz="0.3 -0.2 0.1" rpy="0.4 -0.5 0.6"/>
      <geometry><mesh filename="package://pack/hull.stl" scale="1 2 1"/></geometry></visual></link>
  <link name="sonar"><visual><geometry><mesh filename="lost.stl"/></geometry></visual></link>
  <link name="mast"><collision><geometry><mesh filename="rough.stl"/></geometry></collision></link>
  <link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="rough.stl"/></geometry></visual></link>
  <joint name="a" type="fixed"><parent link="hull"/><child link="sonar"/></joint>
  <joint name="b" type="fixed"><parent link="hull"/><child link="mast"/>
    <origin xyz="0.3 -0.2 0.1" rpy="0.4 -0.5 0.6"/></joint>
  <joint name="c" type="revolute"><parent link="hull"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="9" velocity="1"/></joint>
</robot>
"""


def test_import_states_visual_meshes_else_those_that_collide(tmp_path: Path) -> None:
    (tmp_path / "pack/urdf").mkdir(parents=True)
    (tmp_path / "pack/urdf/r.urdf").write_text(URDF)
    hull, rough = wedge(tmp_path / "pack/hull.stl"), wedge(tmp_path / "pack/urdf/rough.stl")
    scene, notes = uvms_gym.robots.import_with_notes(tmp_path / "pack/urdf/r.urdf")
    (tmp_path / "out").mkdir()
    (tmp_path / "out/scene.toml").write_text(uvms_gym.dump_scene(scene))
    written = uvms_gym.load_scene(tmp_path / "out/scene.toml")
    at_mast = moved(corners(rough), POSE)
    expected = np.concatenate([moved(corners(hull, (1.0, 2.0, 1.0)), POSE), corners(rough), at_mast])
    with pytest.warns(
        UserWarning, match=r"^vehicle: drawn without meshes: .*urdf/lost\.stl cannot be read: No such file"
    ):
        Renderer(written)
    wedge(tmp_path / "pack/urdf/lost.stl")
    assert_same(drawn(written), expected)
    assert_same(drawn(written, "link 1"), corners(rough))
    assert [note for note in notes if "lost.stl" in note and "sonar" in note and "\n" not in note]
    # The hull goes, and its meshes with it.
    other = uvms_gym.import_robot(tmp_path / "pack/urdf/r.urdf", vehicle="bluerov2-heavy")
    assert not other["vehicle"].get("meshes") and not other["arm"].get("meshes")
    assert other["arm"]["links"][0]["meshes"] == scene["arm"]["links"][0]["meshes"]


def test_val_meshes_of_mjcf_are_drawn_where_mujoco_has_them(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    wedge(tmp_path / "part.stl")
    text = """<mujoco><asset><mesh name="m" file="part.stl" scale="0.5 1 2"/></asset><worldbody>
      <body><freejoint/><geom type="box" size="0.2 0.2 0.2" mass="9"/>
        <geom type="mesh" mesh="m" pos="1 2 3" euler="10 20 30" contype="0" conaffinity="0"/></body>
    </worldbody></mujoco>"""
    (tmp_path / "r.xml").write_text(text)
    scene = uvms_gym.import_robot(tmp_path / "r.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "r.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    turn, at = data.geom_xmat[1].reshape(3, 3), data.geom_xpos[1]
    assert_same(drawn(scene), (model.mesh_vert @ turn.T + at)[model.mesh_face])


def test_export_to_urdf_names_the_meshes_and_to_mjcf_says_that_it_does_not(tmp_path: Path) -> None:
    pytest.importorskip("scipy")
    wedge(tmp_path / "part.stl")
    file = {"file": str(tmp_path / "part.stl"), "scale": [1.0, 2.0, 1.0], **POSE}
    limits = {"lower": -1.0, "upper": 1.0, "stiffness": 1.0}
    joint = {"kind": "revolute", "axis": [0.0, 0.0, 1.0], "limits": limits}
    scene = scene_with(file, links=[{"name": "arm", "joint": joint, "meshes": [file]}])
    found = ET.fromstring(uvms_gym.export_urdf(scene)).findall("link/visual/geometry/mesh")
    assert [mesh.get("filename") for mesh in found] == [f"file://{file['file']}"] * 2
    (tmp_path / "r.urdf").write_text(uvms_gym.export_urdf(scene))
    again = uvms_gym.import_robot(tmp_path / "r.urdf")
    hull = drawn(again)
    # Beside the stick of the base.
    assert_same(hull, drawn(scene)[: len(hull)])
    assert_same(drawn(again, "link 1"), drawn(scene, "link 1"))
    assert "meshes for pictures (boxes are written): vehicle, arm" in uvms_gym.export_mjcf(scene)
