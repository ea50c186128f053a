"""Scenes composed of parts, from Python and from the command line."""

import tomllib
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import uvms_gym
from uvms_gym import SceneError, Simulator
from uvms_gym.cli import main

#: Two arms without handedness, on both sides of the plane of symmetry; not turned, as pi is rounded.
MIRRORED: dict[str, Any] = {
    "name": "mirrored",
    "vehicle": {"file": "petasus"},
    "arms": [
        {"name": name, "file": "pum", "mount": {"frame": {"position": np.array([0.25, y, -0.35])}}}
        for name, y in (("left", 0.2), ("right", -0.2))
    ],
}
#: Signs of joint coordinates in a mirror: yaw and roll of an arm change theirs.
MIRROR = np.array([-1.0, 1.0, 1.0, 1.0, -1.0])
SCENES = ["bluerov2-heavy-two-alpha5", "bluerov2-heavy-alpha5-gripper"]


def test_dicts_and_files_compose_alike(tmp_path: Path) -> None:
    (tmp_path / "arm.toml").write_text('[arm]\nname = "stick"\nend_effector.position = [0.0, 0.0, 0.3]\n')
    scene = {"name": "s", "vehicle": {"file": "rexrov"}, "arms": [{"name": "a", "file": "arm.toml"}]}
    with pytest.raises(SceneError, match=r'<dict>: arms\[0\]\.file \(a\): is "arm\.toml": arm\.toml: No such file'):
        uvms_gym.load_scene(scene)
    text = '[vehicle]\nfile = "rexrov"\n[[arms]]\nname = "a"\nfile = "arm.toml"\n'
    (tmp_path / "s.toml").write_text(f'name = "s"\n{text}')
    loaded = uvms_gym.load_scene(tmp_path / "s.toml")
    scene["arms"][0]["file"] = str(tmp_path / "arm.toml")  # type: ignore[index]
    assert uvms_gym.load_scene(scene) == loaded
    assert [link["name"] for link in loaded["arm"]["links"]] == ["a-base"]
    assert loaded["arm"]["end_effectors"]["a"]["position"] == [0.0, 0.0, 0.3]
    assert loaded["vehicle"] == uvms_gym.load_scene("rexrov")["vehicle"]
    # A dump needs no parts.
    (tmp_path / "dumped.toml").write_text(uvms_gym.dump_scene(loaded))
    assert uvms_gym.load_scene(tmp_path / "dumped.toml") == loaded


@pytest.mark.parametrize(
    ("arms", "message"),
    [
        ([{"file": "pum"}], r"arms\[0\]\.name: missing"),
        ([{"name": "a"}], r"arms\[0\]\.file \(a\): missing"),
        ([{"name": "a", "file": "nemo"}], 'is "nemo": give a path that ends in .toml, or one of petasus-pum, '),
        ([{"name": "a", "file": "pum", "on": "fin"}], r'on \(a\): is "fin", but must be one of .* "vehicle"'),
        ([{"name": "a", "file": "pum", "links": {"hand": {}}}], 'the part has no "hand" there; expected "yaw", '),
        ([{"name": "a", "file": "pum"}] * 2, "the name 'a' is taken"),
        ([{"name": f"a{i}", "file": "pum"} for i in range(9)], "at most"),
        (3, "arms: expected a list of tables; the value is 3"),
    ],
)
def test_a_composition_that_cannot_be_says_so(arms: Any, message: str) -> None:
    with pytest.raises(SceneError, match=f"<dict>: .*{message}") as caught:
        uvms_gym.load_scene(MIRRORED | {"arms": arms})
    assert "\n" not in str(caught.value)


def test_mirrored_arms_move_the_vehicle_in_its_plane_of_symmetry() -> None:
    simulator, random = Simulator(MIRRORED, 64), np.random.default_rng(0)
    q, qd = random.uniform(-0.3, 0.3, (64, 5)), random.normal(size=(64, 5))
    twist = random.normal(size=(64, 6)) * [1, 0, 1, 0, 1, 0]
    simulator.set_state(q=np.hstack([q, q * MIRROR]), qd=np.hstack([qd, qd * MIRROR]), twist=twist)
    torque = random.normal(size=(64, 5))
    found = simulator.forward_dynamics(joint_torque=np.hstack([torque, torque * MIRROR]))
    scale = np.abs(found).max(axis=1, keepdims=True)
    assert np.all(np.abs(found[:, [1, 3, 5]]) < 1e-14 * scale)
    assert np.all(np.abs(found[:, 6:11] * MIRROR - found[:, 11:]) < 1e-14 * scale)
    assert np.abs(found[:, 0]).max() > 0.1


@pytest.mark.parametrize("name", SCENES)
def test_composed_scenes_float_level_and_keep_station(name: str) -> None:
    assert uvms_gym.lint_scene(name) == []
    simulator = Simulator(name)
    # Released at home: the vehicle hardly accelerates, but for the 2 N that lift it.
    acceleration = simulator.forward_dynamics(joint_target=simulator.q)[0]
    assert np.abs(acceleration[:2]).max() < 0.02 and 0.0 < acceleration[2] < 0.1
    assert simulator.stable_steps()["mk4"] > 0.015
    env = gymnasium.make("UVMS-StationKeep-v0", scene=name)
    controller, state = uvms_gym.PID(env), None
    observation, info = env.reset(seed=0)
    for _ in range(200):
        action, state = controller.predict(observation, state)
        observation, _, _, _, info = env.step(action)
    assert info["position_error"] < 0.05
    assert info["attitude_error"] < 0.05


def test_closing_jaws_do_not_push_the_vehicle_aside() -> None:
    simulator = Simulator("bluerov2-heavy-alpha5-gripper")
    names = simulator.joint_names
    left, right = names.index("jaws-left"), names.index("jaws-right")
    opened = simulator.q.copy()
    opened[0, [left, right]] = 0.4
    simulator.set_state(q=opened)
    start = simulator.position.copy()
    closed = opened.copy()
    closed[0, [left, right]] = 0.05
    simulator.step(joint_target=closed, substeps=200)
    assert np.allclose(simulator.q[0, [left, right]], 0.05, atol=0.01)
    assert np.abs(simulator.position - start)[0, 1] < 1e-4
    plate, grip = (simulator.end_effector_pose(name)[0, :3, 3] for name in ("default", "jaws"))
    assert np.linalg.norm(grip - plate) == pytest.approx(0.04, abs=1e-12)


def test_the_command_composes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/arm.toml").write_text('[arm]\nname = "stick"\n')
    compose = ["scenes", "compose", "--vehicle", "bluerov2-heavy", "--arm", "left=reach-alpha5@0.2,0.1,-0.1,3.1,0,0"]
    compose += ["--arm", "stick=parts/arm.toml@0,0,0.1:on=left-wrist"]
    assert main([*compose, "--out", "scenes/both.toml"]) == 0
    text = tomllib.loads(Path("scenes/both.toml").read_text())
    assert text["name"] == "both" and text["vehicle"] == {"file": "bluerov2-heavy"}
    assert [arm["file"] for arm in text["arms"]] == ["reach-alpha5", "../parts/arm.toml"]
    assert text["arms"][1]["mount"] == {"frame": {"position": [0.0, 0.0, 0.1], "rpy": [0.0, 0.0, 0.0]}}
    assert main([*compose, "--expand", "--name", "both", "--out", "full.toml"]) == 0
    assert "file" not in tomllib.loads(Path("full.toml").read_text())["vehicle"]
    assert uvms_gym.load_scene("full.toml") == uvms_gym.load_scene("scenes/both.toml")
    assert main(["scenes", "check", "full.toml"]) == 0
    capsys.readouterr()
    assert main(compose) == 0
    assert tomllib.loads(capsys.readouterr().out)["name"] == "composed"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--vehicle", "nemo"], "--vehicle nemo: give a path"),
        (["--vehicle", "rexrov", "--arm", "pum"], '--arm "pum" must be NAME=PART[@'),
        (["--vehicle", "rexrov", "--arm", "a=pum@1,2"], '--arm "a=pum@1,2" needs 3 or 6 numbers after the @'),
        (
            ["--vehicle", "rexrov", "--arm", "a=pum@1,2,x"],
            '--arm a=pum@1,2,x: "1,2,x" must be numbers separated by commas',
        ),
        (["--vehicle", "rexrov", "--arm", "a=rexrov"], "--arm a=rexrov: it has no table [arm]"),
        (["--vehicle", "rexrov", "--arm", "a=pum:on=b"], '--arm a=pum:on=b: on: is "b", but must be one of'),
        (["--vehicle", "rexrov", "--arm", "a=pum", "--arm", "a=pum"], "--arm a=pum: name: the name 'a' is taken"),
    ],
)
def test_the_command_refuses_in_one_line(options: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes", "compose", *options]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
