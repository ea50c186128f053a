"""Users' own robots: template, estimates, robots from files, warnings; the functions and their commands."""

import json
import os
import tomllib
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import uvms_gym
from uvms_gym import SceneError, Simulator
from uvms_gym.cli import main

URDF = Path(__file__).parents[1] / "golden/alpha5.urdf"
CYLINDER = {"cylinder": {"radius": 0.045, "length": 0.4}, "ends": "joined", "position": [0.2, 0.0, 0.0]}


def test_an_estimate_is_a_body_with_a_formula_for_each_number() -> None:
    found = uvms_gym.estimate({"speed": [0.1, 0.5], "shapes": [CYLINDER | {"relative_density": 1.02}]})
    shipped = uvms_gym.load_scene("petasus-pum")["arm"]["links"][1]["body"]
    assert found["body"].keys() >= {"mass", "volume", "inertia", "center_of_mass", "center_of_buoyancy", "damping"}
    assert found["body"]["hydrodynamic_frame"] == shipped["hydrodynamic_frame"]
    text = tomllib.loads(found["toml"])
    assert text["vehicle"]["body"]["added_mass"] == found["body"]["added_mass"]
    assert text["provenance"]["vehicle.body.added_mass"] == f"derived: {found['formulas']['added_mass']}"


def test_an_estimate_takes_numpy_and_files(tmp_path: Path) -> None:
    path = tmp_path / "shapes.toml"
    path.write_text("[[shapes]]\nbox = [0.4, 0.3, 0.2]\n")
    given = {"shapes": [{"box": np.array([0.4, 0.3, 0.2])}]}
    assert uvms_gym.estimate(path) == uvms_gym.estimate(str(path)) == uvms_gym.estimate(given)
    for wrong, message in (
        ({"shapes": [{"box": [1, 2]}]}, r"<dict>: shapes\[0\]\.box"),
        (tmp_path / "none.toml", r"none\.toml"),
    ):
        with pytest.raises(SceneError, match=message):
            uvms_gym.estimate(wrong)
    with pytest.raises(TypeError):
        uvms_gym.estimate(3)


def test_an_imported_arm_runs() -> None:
    scene = uvms_gym.import_robot(URDF, vehicle="bluerov2-heavy", mount=[0.19, 0, -0.12, np.pi, 0, 0])
    simulator = Simulator(scene, 2)
    shipped = Simulator("bluerov2-heavy-alpha5")
    q = np.array([0.3, 0.5, 0.7, 0.9])
    simulator.set_state(q=q)
    shipped.set_state(q=q)
    np.testing.assert_allclose(simulator.end_effector_pose()[:1], shipped.end_effector_pose(), atol=1e-12)
    simulator.step(joint_target=q, substeps=200)
    assert np.all(np.isfinite(simulator.q))
    assert simulator.stable_steps()["mk4"] > 0.01


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mount": [0.0] * 5}, "mount must be 6 numbers"),
        ({"mount": [0, 0, np.nan, 0, 0, 0]}, "position must be three finite numbers"),
        ({"tip": "hand"}, r'alpha5\.urdf: .*no link "hand"'),
        ({"vehicle": "nemo"}, "nemo"),
        ({"base": "\ud800"}, "Unicode"),
    ],
)
def test_an_import_that_cannot_be_says_so(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        uvms_gym.import_robot(URDF, **options)


def test_a_dumped_scene_reads_back(tmp_path: Path) -> None:
    for name in uvms_gym.scene_names():
        path = tmp_path / f"{name}.toml"
        path.write_text(uvms_gym.dump_scene(name))
        assert uvms_gym.load_scene(path) == uvms_gym.load_scene(name)


def test_warnings_are_lines_with_key_and_numbers() -> None:
    assert uvms_gym.lint_scene("petasus-pum") == []
    scene = uvms_gym.load_scene("bluerov2-heavy")
    scene["vehicle"]["body"]["mass"] = 1.35
    balance, density, thrust = uvms_gym.lint_scene(scene)
    assert balance.startswith("vehicle.body.volume: ") and "rises" in balance
    assert density.startswith("vehicle.body.volume: 1.3500 kg in ") and "kg/m3" in density
    assert thrust.startswith("vehicle.thrusters: ") and "% of its limit" in thrust


def test_added_mass_that_is_symmetric_but_for_its_digits_is_made_so() -> None:
    added = np.diag([70.0, 90.0, 260.0, 41.0, 52.0, 18.0])
    added[2, 4], added[4, 2] = 7.413, 7.412
    body = {"mass": 120.0, "inertia": [30.0, 50.0, 45.0], "volume": 0.117, "added_mass": added}
    water = {"density": 1028.0, "gravity": [0.0, 0.0, -9.81]}
    scene = {"name": "rounded", "water": water, "vehicle": {"name": "rounded", "body": body}}
    read = np.array(uvms_gym.load_scene(scene)["vehicle"]["body"]["added_mass"])
    assert np.array_equal(read, read.T) and read[2, 4] == pytest.approx(7.4125, abs=1e-12)
    assert any(w.startswith("vehicle.body.added_mass: ") and "7.413" in w for w in uvms_gym.lint_scene(scene))
    added[4, 2] = 6.4
    with pytest.raises(SceneError, match=r"vehicle\.body\.added_mass.*not symmetric.*7\.413.*6\.4"):
        uvms_gym.load_scene(scene)


def test_the_template_passes_its_check_and_is_an_environment(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "my.toml"
    assert main(["scenes", "template", "--out", str(path)]) == 0
    assert path.read_text() == uvms_gym.scene_template()
    assert main(["scenes", "check", str(path), "--strict"]) == 0
    assert "no fault found" in capsys.readouterr().out
    env = gymnasium.make("UVMS-StationKeep-v0", scene=str(path))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    assert env.observation_space.contains(env.step(np.zeros(6, np.float32))[0])
    assert main(["scenes", "template", "--out", str(path), "--force"]) == 0


def test_check_shows_warnings_and_a_balance(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, numbers = tmp_path / "my.toml", tmp_path / "my.json"
    path.write_text(uvms_gym.dump_scene("bluerov2-heavy").replace("mass = 13.5", "mass = 27.0", 1))
    assert main(["scenes", "check", str(path), "--json", str(numbers)]) == 0
    out = capsys.readouterr().out
    assert "warning: vehicle.body.volume: all bodies weigh 27.0000 kg" in out and "net weight in water, N" in out
    found = json.loads(numbers.read_text())
    assert found["summary"]["mass, kg"] == 27.0 and found["summary"]["degrees of freedom"] == 6
    assert len(found["warnings"]) == 2 and "63 % of its limit" in found["warnings"][1]
    assert (found["recommended"]["integrator"], found["recommended"]["step"]) == ("mk4", 0.01)
    assert main(["scenes", "check", str(path), "--strict"]) == 1
    assert main(["scenes", "check", "rexrov", "--strict"]) == 0
    capsys.readouterr()
    # A scene too stiff for the default step.
    scene = uvms_gym.load_scene("petasus-pum")
    scene["arm"]["links"][4]["joint"]["friction"]["viscous"] = 5000.0
    path.write_text(uvms_gym.dump_scene(scene))
    assert main(["scenes", "check", str(path), "--strict"]) == 1
    out = capsys.readouterr().out
    assert "warning: integration: mk4 at 0.01 s is unstable for joint 4 (gripper)" in out
    assert "ros2, 0.01 s" in out


def test_the_commands_estimate_and_import(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    numbers = tmp_path / "body.json"
    command = ["scenes", "estimate", "--box", "0.4,0.3,0.2@0,0,0.05", "--capsule", "0.05,0.3,y@0.1,0,0.2,0,0.1,0"]
    command += ["--cylinder", "0.05,0.3", "--ellipsoid", "0.3,0.2,0.1", "--perforation", "0.2,0.2,0.1"]
    command += ["--solidity", "0.9", "--displaced", "0.5", "--relative-density", "1.01", "--table", "payload.body"]
    assert main([*command, "--json", str(numbers)]) == 0
    out = capsys.readouterr().out
    body = json.loads(numbers.read_text())["body"]
    assert tomllib.loads(out)["payload"]["body"]["added_mass"] == body["added_mass"]
    assert np.shape(body["added_mass"]) == (6, 6)

    path = tmp_path / "my.toml"
    mount = "0.19,0,-0.12,3.141592653589793,0,0"
    assert main(["scenes", "import", str(URDF), "--mount", mount, "--out", str(path)]) == 0
    out = capsys.readouterr().out
    assert "wrist: mesh not read: package://alpha" in out and "foot: merged into mount" in out
    assert uvms_gym.load_scene(path) == uvms_gym.import_robot(URDF, mount=[float(x) for x in mount.split(",")])
    assert main(["scenes", "import", str(URDF)]) == 0
    assert tomllib.loads(capsys.readouterr().out)["arm"]["name"] == "Reach Alpha 5"


def chain(count: int) -> str:
    """Arm whose first joint moves, with many links behind fixed joints."""
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    links = [f'<link name="l{i}">{inertial if i in (0, 1, count) else ""}</link>' for i in range(count + 1)]
    joint = '<joint name="j{0}" type="{1}"><parent link="l{2}"/><child link="l{0}"/>{3}</joint>'
    joints = [joint.format(1, "revolute", 0, '<limit lower="-1" upper="1"/>')]
    joints += [joint.format(i, "fixed", i - 1, "") for i in range(2, count + 1)]
    return "<robot name='r'>\n" + "\n".join([*links, *joints]) + "</robot>"


def test_thousands_of_links_are_imported_soon(tmp_path: Path) -> None:
    path = tmp_path / "long.urdf"
    path.write_text(chain(30000))
    assert [link["name"] for link in uvms_gym.import_robot(path)["arm"]["links"]] == ["l1"]
    path.write_text(chain(5).replace('link="l0"/><child link="l1"', 'link="l5"/><child link="l1"'))
    with pytest.raises(SceneError, match=r'line 3: link "l1": is part of a loop of joints'):
        uvms_gym.import_robot(path)


def test_elements_with_very_many_attributes_are_refused_by_their_line(tmp_path: Path) -> None:
    path = tmp_path / "wide.urdf"
    many = " ".join(f"a{i}='1'" for i in range(100000))
    path.write_text(chain(2).replace('<joint name="j1"', f'<joint {many} name="j1"'))
    with pytest.raises(SceneError, match=r"line 5: <joint>: has 100002 attributes, but at most 100 are read"):
        uvms_gym.import_robot(path)


def test_pipes_devices_and_large_files_are_not_read(tmp_path: Path) -> None:
    for read, suffix in ((uvms_gym.load_scene, "toml"), (uvms_gym.estimate, "toml"), (uvms_gym.import_robot, "urdf")):
        pipe, large = tmp_path / f"pipe.{suffix}", tmp_path / f"large.{suffix}"
        if not pipe.exists():
            os.mkfifo(pipe)
        with open(large, "wb") as file:
            file.truncate(10**9)
        for path, problem in ((pipe, "not a regular file"), (large, "1000000000 bytes, but at most 16000000")):
            with pytest.raises(SceneError, match=f"{path.name}: {problem}"):
                read(path)
    with pytest.raises(SceneError, match=r"^/dev/zero: not a regular file$"):
        uvms_gym.load_scene(Path("/dev/zero"))
