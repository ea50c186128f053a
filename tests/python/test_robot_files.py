"""Files with the traits of public robots: read, refused by one line, or doubted."""

import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import uvms_gym
from uvms_gym import SceneError, Simulator
from uvms_gym.cli import main
from uvms_gym.robots import import_with_notes

FILES = Path(__file__).parents[1] / "data/robots"
HEAVY = uvms_gym.load_scene("bluerov2-heavy")
#: Joints, thrusters, total mass, kg, and displaced volume, m3 (None: an estimate), of files that are read.
READ: dict[str, tuple[int, int, float, float | None]] = {
    "trait-uuv-simulator.urdf": (0, 7, 60.022, 0.0585),
    "trait-two-arms.urdf": (8, 7, 33.82, None),
    "trait-gazebo.sdf": (0, 7, 12.55, None),
    "trait-six-thrusters.urdf": (0, 6, 11.5, 0.0115),
    "trait-parameters.yaml": (0, 8, 70.0, 0.0685),
    "trait-mujoco.xml": (1, 8, 14.9, None),  # Without the fin.
    "vehicle-one-link.urdf": (0, 8, 11.5, None),
}
#: The same of files whose traits do not matter to the robot, and the step and integrator that it is given.
HARMLESS: dict[str, tuple[int, int, float, tuple[str, float]]] = {
    "fixed-joint-zero-axis.urdf": (2, 8, 15.5, ("mk4", 0.01)),
    "two-origins.urdf": (2, 8, 15.5, ("mk4", 0.01)),
    "dummy-frame.urdf": (2, 8, 15.5001, ("mk4", 0.01)),
    "joint-friction.urdf": (2, 8, 14.8, ("ros2", 0.01)),
    "zero-inertia-off-the-arm.urdf": (2, 1, 103.001, ("ros3", 0.005)),
    "locked-joint-off-the-arm.urdf": (2, 8, 103.01, ("mk4", 0.005)),
    "floating-base-off-the-arm.urdf": (2, 8, 103.0, ("mk4", 0.005)),
    "vehicle-and-arm.urdf": (2, 8, 103.0, ("mk4", 0.005)),
    "vehicle-with-propellers.urdf": (0, 8, 11.7, ("mk4", 0.01)),
    "vehicle-one-link.urdf": (0, 8, 11.5, ("mk4", 0.01)),
}
REFUSED = {
    "trait-macros.urdf": r"line \d+: <robot>: has no <link>",
    "trait-stonefish.scn": r"Stonefish scenario",
    "trait-no-masses.urdf": r"no link has a mass.*--density",
}


def read(name: str, **options: Any) -> tuple[dict[str, Any], list[str]]:
    if name.endswith(".xml"):
        pytest.importorskip("mujoco")
    return import_with_notes(FILES / name, **options)


def bodies(scene: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        scene["vehicle"]["body"],
        *(link["body"] for link in scene.get("arm", {}).get("links", []) if "body" in link),
    ]


@pytest.mark.parametrize("name", READ)
def test_a_file_is_read_whole(name: str) -> None:
    joints, thrusters, mass, volume = READ[name]
    scene, _ = read(name)
    simulator = Simulator(scene)
    assert (simulator.num_joints, simulator.num_thrusters) == (joints, thrusters)
    assert sum(body["mass"] for body in bodies(scene)) == pytest.approx(mass, rel=1e-12)
    if volume is not None:
        assert scene["vehicle"]["body"]["volume"] == pytest.approx(volume, rel=1e-12)
    assert uvms_gym.load_scene(scene) == scene


@pytest.mark.parametrize("name", HARMLESS)
def test_a_harmless_trait_changes_nothing(name: str) -> None:
    joints, thrusters, mass, integration = HARMLESS[name]
    scene, notes = read(name)
    simulator = Simulator(scene, 3)
    assert (simulator.num_joints, simulator.num_thrusters) == (joints, thrusters)
    assert (simulator.integrator, simulator.dt) == integration
    assert sum(body["mass"] for body in bodies(scene)) == pytest.approx(mass, rel=1e-12)
    # No body displaces much more than its outline, and the step follows full speed and effort.
    assert sum(body.get("volume", 0.0) for body in bodies(scene)) < 1.05 * mass / 1000.0
    assert any(note.startswith(f"integration: {integration[0]} at {integration[1]:g} s") for note in notes)
    rng = np.random.default_rng(0)
    simulator.set_state(q=rng.uniform(-0.5, 0.5, (3, joints)), qd=rng.uniform(-1.0, 1.0, (3, joints)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulator.step(substeps=200)
    assert np.isfinite(simulator.q).all() and np.isfinite(simulator.twist).all()


@pytest.mark.parametrize("name", READ)
def test_an_imported_vehicle_holds_station(name: str) -> None:
    env = gymnasium.make("UVMS-StationKeep-v0", scene=read(name)[0])
    controller = uvms_gym.make_controller("pid", env)
    observation, info = env.reset(seed=0)
    memory = None
    for k in range(200):
        action, memory = controller.predict(observation, memory, episode_start=np.array(k == 0))
        observation, _, terminated, _, info = env.step(action)
        assert not terminated
    assert info["position_error"] < 0.05


@pytest.mark.parametrize("name", ["trait-two-arms.urdf", "two-arms-and-grippers.urdf", "../../golden/alpha5.urdf"])
def test_servos_bear_the_weight_of_the_arm(name: str) -> None:
    scene, _ = read(name)
    torques = uvms_gym.assess_scene(scene)["trim"]["joint_torques"]
    assert max(abs(torque) for torque, _ in torques) > 0.1
    for link, (torque, _) in zip(scene["arm"]["links"], torques, strict=True):
        # Gains have three digits.
        assert abs(torque) <= 0.02 * 1.005 * link["joint"]["servo"]["kp"]


def test_numbers_of_plugins_become_the_hulls() -> None:
    scene, notes = read("trait-uuv-simulator.urdf")
    hull, thrusters = scene["vehicle"]["body"], scene["vehicle"]["thrusters"]
    added = np.array(hull["added_mass"])
    np.testing.assert_array_equal(np.diag(added), [30, 60, 80, 4, 6, 5])
    # The file's axes are x forward, y right, z down; its two entries differ by their rounding.
    assert added[1, 3] == added[3, 1] == -0.5005
    assert hull["damping"]["linear"] == [20, 30, 40, 10, 12, 11]
    assert hull["damping"]["quadratic"] == [60, 120, 160, 15, 20, 18]
    assert hull["center_of_buoyancy"] == [0, 0, 0.06] and scene["water"]["density"] == 1028
    assert {thruster["lag"] for thruster in thrusters} == {0.05}
    np.testing.assert_allclose(thrusters[0]["axis"], [0.8660, 0.5, 0], atol=1e-4)
    assert any("asymmetric" in note for note in notes)
    assert sum("no limits of thrust" in note for note in notes) == len(thrusters)


def test_added_mass_counts_by_its_size_whatever_its_sign() -> None:
    scene, notes = read("trait-gazebo.sdf")
    assert scene["vehicle"]["body"]["added_mass"] == [5, 12, 14, 0.12, 0.13, 0.14]
    assert any("opposite sign" in note for note in notes)
    assert scene["vehicle"]["thrusters"][0]["limits"] == [-30, 40]


def test_moments_that_no_body_has_are_repaired_and_named() -> None:
    scene, notes = read("trait-impossible-moments.urdf")
    moments = np.array(scene["vehicle"]["body"]["inertia"])
    assert moments.max() <= moments.sum() - moments.max() + 1e-9
    np.testing.assert_allclose(moments, [0.6, 30, 35], rtol=0.07)
    assert any(note.startswith("base_link (line 4): ") and "moments" in note for note in notes)


def test_two_arms_with_fingers_mirror_each_other() -> None:
    scene, notes = read("trait-two-arms.urdf")
    links = {link["name"]: link for link in scene["arm"]["links"]}
    sides = [[name for name in links if name.startswith(side)] for side in ("left", "right")]
    assert [len(side) for side in sides] == [4, 4]
    for left, right in zip(*sides, strict=True):
        assert links[left]["body"]["mass"] == links[right]["body"]["mass"]
    assert sum("follows -1 times" in note for note in notes) == 2
    simulator = Simulator(scene)
    mass = np.asarray(simulator.mass_matrix())[0]
    # What turns about z turns the other way on the other side, where the first finger mirrors the second.
    mirrored = np.array([10, 11, 13, 12])
    np.testing.assert_allclose(mass[0, 6:10], mass[0, mirrored] * [-1, 1, -1, -1], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(mass[2, 6:10], mass[2, mirrored] * [-1, 1, -1, -1], rtol=1e-12, atol=1e-15)
    locked, _ = read("trait-two-arms.urdf", lock=["left_finger_b_joint", "right_finger_b_joint"])
    assert Simulator(locked).num_joints == 6
    kept, _ = read("trait-two-arms.urdf", keep=["left_shoulder"])
    assert Simulator(kept).num_joints == 1
    assert sum(body["mass"] for body in bodies(kept)) == pytest.approx(READ["trait-two-arms.urdf"][2], rel=1e-12)


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_cannot_be_read_says_why_in_one_line(name: str) -> None:
    with pytest.raises(SceneError, match=REFUSED[name]) as caught:
        read(name)
    message = str(caught.value)
    assert name in message and "\n" not in message and len(message) < 400


INERTIAL = '<inertial><mass value="{mass}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
A, B = (f'<link name="{name}">{INERTIAL.format(mass=2)}</link>\n' for name in "ab")
JOINT = '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>\n'
LIMITS = '<axis xyz="0 0 1"/><limit lower="-1" upper="1"/>'
BOMB = "".join(f'<!ENTITY e{i + 1} "{10 * f"&e{i};"}">' for i in range(9))


def joint(parent: str, child: str, more: str = LIMITS, name: str = "j", kind: str = "revolute") -> str:
    return JOINT.format(name=name, kind=kind, parent=parent, child=child, more=more)


#: Content of the robot's element, and the part of the message after file and line.
FAULTS = {
    "cycle": (A + B + joint("a", "b") + joint("b", "a", name="k"), "loop of joints"),
    "own-parent": (A + B + joint("b", "b"), "loop of joints"),
    "two-parents": (A + B + joint("a", "b") + joint("a", "b", name="k"), 'link "b" is the child of joint "j" already'),
    "unknown-child": (A + joint("a", "z"), 'joint "j" <child>: unknown link "z"'),
    "unknown-parent": (A + joint("z", "a"), 'joint "j" <parent>: unknown link "z"'),
    "no-parent": (A + B + '<joint name="j" type="fixed"><child link="b"/></joint>', 'joint "j": <parent> is missing'),
    "unknown-kind": (A + B + joint("a", "b", kind="screw"), 'type is "screw", but must be revolute'),
    "same-link": (A + A, 'the name "a" is taken by an earlier link'),
    "no-name": ("<link/>", "attribute name is missing"),
    "nan": (A.replace('"2"', '"nan"'), 'value="nan" is not a finite number'),
    "units": (A.replace('"2"', '"2 kg"'), 'value="2 kg" is not a finite number'),
    "negative": (A + B.replace('"2"', '"-2"') + joint("a", "b"), "value is -2, but must be >= 0"),
    "short": (A + B + joint("a", "b", LIMITS + '<origin xyz="1 2"/>'), 'xyz="1 2" is not 3 finite numbers'),
    "no-axis": (A + B + joint("a", "b", LIMITS.replace("1", "0", 1)), "xyz must have a nonzero length"),
    "swapped": (A + B + joint("a", "b", '<limit lower="1" upper="-1"/>'), "lower is 1, but must be"),
    "xacro": ('<link name="${name}"/><include/><xacro:arm/>', "run xacro on the file first"),
    "broken": ("<link name='a'></robot>", "expected 'link' tag"),
    "bomb": (f"<!DOCTYPE r [{BOMB}]>", "line 2"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_line_with_file_and_line(tmp_path: Path, fault: str) -> None:
    content, message = FAULTS[fault]
    path = tmp_path / f"{fault}.urdf"
    path.write_text(f'<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro">\n{content}</robot>')
    with pytest.raises(SceneError) as caught:
        uvms_gym.import_robot(path)
    said = str(caught.value)
    assert said.startswith(f"{path}: line ") and message in said and "\n" not in said and len(said) < 400


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "root"),
        (b"hello", "line 1"),
        (bytes(range(256)), "UTF-8"),
        (
            "<robot name='r'>\n<link name='h\u00fclle'/></robot>".encode("latin-1"),
            "line 2: byte 0xFC is not UTF-8 text",
        ),
        ("<robot/>".encode("utf-16"), "not UTF-8 text but UTF-16: save the file as UTF-8"),
        (b"<html><body/></html>", "<html>"),
        (b"<launch/>", "<launch>"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "line 1"),
    ],
)
def test_a_file_of_another_kind_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "other.urdf"
    path.write_bytes(content)
    with pytest.raises(SceneError) as caught:
        uvms_gym.import_robot(path)
    said = str(caught.value)
    assert said.startswith(f"{path}: ") and message in said and "\n" not in said and len(said) < 400


def test_names_may_be_any_text(tmp_path: Path) -> None:
    for first, second, third in (
        ("vehicle", "base", "j"),
        ("base", "vehicle", "vehicle"),
        ("基座 ü", "рука", "сустав"),
    ):
        path = tmp_path / "names.urdf"
        links = A.replace('"a"', f'"{first}"') + B.replace('"b"', f'"{second}"')
        path.write_text(f'<robot name="r">{links}{joint(first, second, name=third)}</robot>')
        assert Simulator(uvms_gym.import_robot(path)).num_joints == 1


def test_thrusters_are_chosen_on_import(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = FILES / "vehicle-one-link.urdf", str(tmp_path / "robot.toml")
    assert main(["scenes", "import", str(path), "--out", out]) == 0
    said = capsys.readouterr().out.replace("\n", " ")
    assert "eight thrusters are ASSUMED" in said and "warning" not in said
    scene = uvms_gym.load_scene(out)
    assert scene == uvms_gym.import_robot(path)
    assert scene["vehicle"] == uvms_gym.import_robot(path, thrusters="assumed")["vehicle"]
    assert scene["provenance"]["vehicle.thrusters"].startswith("assumed: ")
    assert uvms_gym.import_robot(path, thrusters="file")["vehicle"]["thrusters"] == []
    assert main(["scenes", "import", str(path), "--thrusters", "bluerov2-heavy", "--out", out, "--force"]) == 0
    assert uvms_gym.load_scene(out)["vehicle"]["thrusters"] == HEAVY["vehicle"]["thrusters"]
    for options, message in (
        ({"thrusters": "none"}, "no scene named 'none'"),
        ({"thrusters": "file", "vehicle": "rexrov"}, "--thrusters has no use"),
    ):
        with pytest.raises(SceneError, match=message):
            uvms_gym.import_robot(path, **options)
