"""Whole robots from files: against Pinocchio's reader of the same files, and by the command."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uvms_gym
from uvms_gym import SceneError, Simulator, _core
from uvms_gym.cli import main

ROBOTS = Path(__file__).parents[1] / "data/robots"
GOLDEN = json.loads((Path(__file__).parents[1] / "golden/imported_robots.json").read_text())["robots"]


def dry(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene without water and without forces of its joints."""
    scene["water"]["density"] = 0.0
    links = scene["arm"]["links"]
    bodies = [scene["vehicle"]["body"], scene["arm"].get("base"), *(link["body"] for link in links)]
    for body in filter(None, bodies):
        body |= {"added_mass": [0.0] * 6, "damping": {"linear": [0.0] * 6, "quadratic": [0.0] * 6}}
    for link in links:
        link["joint"].pop("limits", None)
    scene["provenance"] = {}
    return scene


def compare(actual: Any, expected: Any) -> None:
    expected = np.asarray(expected)
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=1e-12 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("robot", GOLDEN, ids=[robot["file"] for robot in GOLDEN])
def test_an_imported_robot_moves_as_pinocchio_has_it_move(robot: dict[str, Any]) -> None:
    path, free = ROBOTS / f"{robot['file']}.urdf", robot["free"]
    read = {joint["name"]: joint["child"] for joint in _core.read_robot(path)["joints"]}
    scene = dry(uvms_gym.import_robot(path))
    scene["vehicle"]["fixed"] = not free
    assert [link["name"] for link in scene["arm"]["links"]] == [read[name] for name in robot["joints"]]
    simulator, own = Simulator(scene), slice(0 if free else 6, None)
    for case in robot["cases"]:
        simulator.set_state(**{key: case[key] for key in ("q", "qd", "position", "rotation", "twist") if key in case})
        compare(simulator.mass_matrix()[0][own, own], case["mass_matrix"])
        compare(simulator.equations()["g"][0][own], case["gravity"])
        compare(simulator.bias()[0][own] + simulator.equations()["g"][0][own], case["bias"])
    for name in robot["cases"][0]["poses"]:
        at = Simulator(dry(uvms_gym.import_robot(path, tip=name)) | {"vehicle": scene["vehicle"]})
        for case in robot["cases"]:
            at.set_state(**{key: case[key] for key in ("q", "position", "rotation") if key in case})
            compare(at.end_effector_pose()[0], case["poses"][name])


def test_the_command_takes_what_the_file_cannot_say(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = str(ROBOTS / "two-arms-and-grippers.urdf"), tmp_path / "robot.toml"
    options = ["--tip", "right=right_grasp", "--lock", "mast_pan", "--lock", "mast_tilt"]
    assert main(["scenes", "import", path, *options, "--out", str(out)]) == 0
    notes = capsys.readouterr().out.replace("\n", " ")
    for part in ("hull: the hull of a vehicle", "mast_pan, mast_tilt: locked at 0, as chosen", "taken for a propeller"):
        assert notes.count(part) == 1
    assert "left_propeller_joint, right_propeller_joint: taken for a propeller" in notes
    scene = uvms_gym.load_scene(out)
    given: dict[str, Any] = {"tip": {"right": "right_grasp"}, "lock": ["mast_pan", "mast_tilt"]}
    assert scene == uvms_gym.import_robot(path, **given)
    assert "mast" not in [link["name"] for link in scene["arm"]["links"]]
    assert main(["scenes", "import", path, "--keep", "left_elbow", "--vehicle", "rexrov"]) == 0
    scene = tomllib.loads(capsys.readouterr().out)
    assert [link["name"] for link in scene["arm"]["links"]] == ["left_fore"]
    assert scene["vehicle"]["name"] == uvms_gym.load_scene("rexrov")["vehicle"]["name"]


def test_densities_make_masses(tmp_path: Path) -> None:
    path = tmp_path / "bare.urdf"
    link = '<link name="{}"><collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision></link>'
    joint = '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
    path.write_text(f"<robot name='r'>{link.format('a')}{link.format('b')}{joint}</robot>")
    with pytest.raises(SceneError, match=r"no link has a mass \(a, b\): state a --density"):
        uvms_gym.import_robot(path)
    arm = uvms_gym.import_robot(path, density={"a": 1000.0, "b": 2000.0})["arm"]
    assert (arm["base"]["mass"], arm["links"][0]["body"]["mass"]) == pytest.approx((6.0, 12.0))
    out = tmp_path / "bare.toml"
    assert main(["scenes", "import", str(path), "--density", "1000", "--density", "b=2000", "--out", str(out)]) == 0
    assert uvms_gym.load_scene(out)["arm"] == arm
    assert main(["scenes", "import", str(path), "--density", "heavy"]) == 2


def test_a_robot_can_be_amended_as_plain_data() -> None:
    robot = _core.read_robot(ROBOTS / "vehicle-with-propellers.urdf")
    robot["thrusters"] = [{"name": joint, "joint": joint, "limits": [-5, 5]} for joint in ("p1", "p2")]
    scene, notes = _core.assemble_robot(robot)
    assert [thruster["limits"] for thruster in scene["vehicle"]["thrusters"]] == [[-5.0, 5.0]] * 2
    assert any(note.startswith("p1: turns the propeller") for note in notes)
    for wrong, message in (({"links": []}, "the robot|<robot>: has no links"), ({"joints": [{"axle": 1}]}, "axle")):
        with pytest.raises(SceneError, match=message):
            _core.assemble_robot(robot | wrong)
