"""Scenes as MJCF and URDF, and the same scenes in MuJoCo and Pinocchio."""

import os
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from tree_scenes import HAND_MADE, body, random_tree

import uvms_gym
from uvms_gym import Simulator, export_mjcf, export_urdf
from uvms_gym._scene import joints
from uvms_gym.cli import main
from uvms_gym.export import mjcf, urdf
from uvms_gym.export.tree import Frame, angles

TREES: dict[str, Callable[[], dict[str, Any]]] = HAND_MADE | {
    f"random {k}": lambda k=k: random_tree(k)
    for k in range(40)  # type: ignore[misc]
}
#: Bound of relative differences.
BOUND = 1e-13


def at_random_state(scene: dict[str, Any], seed: int) -> Simulator:
    """Simulator at a random state in general position."""
    rng, simulator = np.random.default_rng(seed), Simulator(scene)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    n = simulator.num_joints
    simulator.set_state(
        position=rng.normal(size=3),
        rotation=turn,
        twist=rng.normal(size=6),
        q=rng.uniform(-2.0, 2.0, n),
        qd=rng.normal(size=n),
    )
    return simulator


def frames(simulator: Simulator) -> list[str]:
    """Names in our files of the end effectors, in the order of `end_effector_names`."""
    return ["end_effector" if name == "default" else name for name in simulator.end_effector_names]


def equations(simulator: Simulator) -> dict[str, Any]:
    """Mass matrix, inertial and gravity forces (rows [vehicle; joints]) and poses of the end effectors."""
    terms = simulator.equations()
    return {
        "mass matrix": simulator.mass_matrix()[0],
        "bias": simulator.bias()[0],
        "gravity": terms["g"][0],
        "end effectors": np.stack([simulator.end_effector_pose(name)[0] for name in simulator.end_effector_names]),
    }


def assert_equal(found: dict[str, Any], expected: dict[str, Any]) -> None:
    for name, theirs in found.items():
        scale = np.abs(expected[name]).max()
        np.testing.assert_allclose(theirs, expected[name], rtol=0.0, atol=BOUND * scale, err_msg=name)


def by_pinocchio(simulator: Simulator) -> dict[str, Any]:
    """The same terms by Pinocchio, which reads our URDF."""
    import pinocchio as pin

    scene = simulator.scene
    model = pin.buildModelFromXML(export_urdf(scene))
    model.gravity = pin.Motion(np.array(scene["water"]["gravity"]), np.zeros(3))
    data, names = model.createData(), simulator.joint_names
    at = np.array([model.joints[model.getJointId(name)].idx_v for name in names], dtype=int)
    q, v = pin.neutral(model), np.zeros(model.nv)
    q[:7] = pin.SE3ToXYZQUAT(pin.SE3(simulator.rotation[0], simulator.position[0]))
    v[:6], v[at] = simulator.twist[0], simulator.qd[0]
    for name, angle in zip(names, simulator.q[0], strict=True):
        joint = model.joints[model.getJointId(name)]
        # A joint without limits has cosine and sine as its coordinates.
        q[joint.idx_q : joint.idx_q + joint.nq] = [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
    # Pinocchio does not read rotor inertia.
    root = ET.fromstring(export_urdf(scene))
    rotors = {joint.get("name"): joint.find("dynamics") for joint in root.iter("joint")}
    for name, k in zip(names, at, strict=True):
        dynamics = rotors[name]
        assert dynamics is not None
        model.armature[k] = float(dynamics.get("armature", 0.0))
    order = np.concatenate([np.arange(6), at])
    mass = pin.crba(model, data, q, pin.Convention.WORLD)
    mass = np.triu(mass) + np.triu(mass, 1).T
    gravity = pin.computeGeneralizedGravity(model, data, q).copy()
    bias = pin.nonLinearEffects(model, data, q, v) - gravity
    pin.framesForwardKinematics(model, data, q)
    return {
        "mass matrix": mass[np.ix_(order, order)],
        "bias": bias[order],
        "gravity": gravity[order],
        "end effectors": np.stack([data.oMf[model.getFrameId(name)].homogeneous for name in frames(simulator)]),
    }


def by_mujoco(simulator: Simulator) -> dict[str, Any]:
    """The same terms by MuJoCo, which reads our MJCF; its free joint has the linear velocity in world axes."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(export_mjcf(simulator.scene))
    data, turn, twist = mujoco.MjData(model), simulator.rotation[0], simulator.twist[0]
    moving = [model.joint(name) for name in simulator.joint_names]
    order = np.concatenate([np.arange(6), [joint.dofadr[0] for joint in moving]]).astype(int)
    data.qpos[:3] = simulator.position[0]
    mujoco.mju_mat2Quat(data.qpos[3:7], np.ravel(turn))
    for joint, angle in zip(moving, simulator.q[0], strict=True):
        data.qpos[joint.qposadr[0]] = angle
    turned = np.eye(model.nv)
    turned[:3, :3] = turn.T
    mujoco.mj_forward(model, data)
    gravity = data.qfrc_bias - data.qfrc_gravcomp
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    mass = (turned @ mass @ turned.T)[np.ix_(order, order)]
    velocity = np.concatenate([twist, simulator.qd[0]])
    data.qvel[order] = velocity
    data.qvel[:3] = turn @ twist[:3]
    mujoco.mj_forward(model, data)
    # v' = R^T v_w' - omega x v.
    spin = np.concatenate([np.cross(twist[3:], twist[:3]), np.zeros(model.nv - 3)])
    bias = (turned @ (data.qfrc_bias - data.qfrc_gravcomp - gravity))[order] + mass @ spin
    poses = np.tile(np.eye(4), (len(frames(simulator)), 1, 1))
    for pose, site in zip(poses, map(data.site, frames(simulator)), strict=True):
        pose[:3, :3], pose[:3, 3] = site.xmat.reshape(3, 3), site.xpos
    return {"mass matrix": mass, "bias": bias, "gravity": (turned @ gravity)[order], "end effectors": poses}


@pytest.mark.parametrize("tree", TREES)
def test_val_pinocchio_reads_the_same_robot_from_our_urdf(tree: str) -> None:
    pytest.importorskip("pinocchio")
    for seed in range(3):
        simulator = at_random_state(TREES[tree](), seed)
        assert_equal(by_pinocchio(simulator), equations(simulator))


@pytest.mark.parametrize("tree", TREES)
def test_val_mujoco_reads_the_same_robot_from_our_mjcf(tree: str) -> None:
    pytest.importorskip("mujoco")
    for seed in range(3):
        simulator = at_random_state(TREES[tree](), seed)
        assert_equal(by_mujoco(simulator), equations(simulator))


@pytest.mark.parametrize("name", ["bluerov2-heavy-alpha5", "petasus-pum", "remus-100"])
def test_val_mujoco_drives_the_robot_as_we_do(name: str) -> None:
    mujoco = pytest.importorskip("mujoco")
    scene = uvms_gym.load_scene(name)
    for thruster in scene["vehicle"]["thrusters"][::2]:
        thruster |= {"lag": 0.1, "deduction": 0.2, "induced": [0.01, -0.02, 0.03, 0.004, 0.005, -0.006]}
    simulator = Simulator(scene)
    model = mujoco.MjModel.from_xml_string(export_mjcf(scene))
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    n = simulator.num_joints
    np.testing.assert_array_equal([data.joint(joint).qpos[0] for joint in simulator.joint_names], simulator.q[0])
    # Servos, of which some saturate, at random speeds; thrusters, of which some lag, after a step from rest.
    low, high = simulator.thruster_limits.T
    thrust, target = rng.uniform(low, high), simulator.q[0] + rng.uniform(-0.1, 0.1, n)
    data.ctrl[:], data.qvel[6:] = [*thrust, *target], rng.uniform(-0.2, 0.2, n)
    servos = [joint["servo"] for joint in joints(scene)]
    efforts = np.array([joint.get("effort", np.inf) for joint in joints(scene)])
    torque = [s["kp"] * (x - q) - s["kd"] * v for s, x, q, v in zip(servos, target, simulator.q[0], data.qvel[6:])]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator[6:], np.clip(torque, -efforts, efforts), rtol=1e-14, atol=1e-12)
    assert (np.abs(torque) > efforts).any() == (name == "bluerov2-heavy-alpha5")
    model.opt.timestep = 0.01
    simulator.step(thrust=thrust)
    mujoco.mj_step(model, data)
    mujoco.mj_resetData(model, copy := mujoco.MjData(model))
    copy.ctrl[:], copy.act[:] = data.ctrl, data.act
    mujoco.mj_forward(model, copy)
    wrench = simulator.thruster_configuration @ simulator.thrust[0]
    np.testing.assert_allclose(copy.qfrc_actuator[:6], wrench, rtol=1e-9, atol=1e-9)
    # Buoyancy carries what it does in the scene.
    trim = Simulator(scene).trim()["wrench"][0]
    net = copy.qfrc_gravcomp[2] + model.body_mass.sum() * model.opt.gravity[2]
    assert net == pytest.approx(-trim[2], abs=1e-9)


#: Phrases of the comments at the top by key, for numbers that no element has.
LEFT_OUT = {
    "added_mass": "added mass",
    "hydrodynamic_frame": "added mass",
    "linear": "linear damping",
    "quadratic": "quadratic damping",
    "center_of_buoyancy": "centres of buoyancy",
    "current": "current of 0.1 0 0 m/s",
    "forward_damping": "damping by forward speed",
    "fins": "fins: keel",
    "tether": "tether",
    "servo": "gains of the vehicle's servo",
    "dead_band": "dead band: surge-left",
    "ambient_flow": "loss of thrust by inflow: surge-left",
    "limits": "stiffness and damping of end stops",
    "contact": "spheres: skid\n    - shapes: seabed, panel, pile, rim",
    "fixtures": "fixtures: valve",
    "coulomb_speed": "smooth Coulomb friction",
    "actuator": "maximum torque of a linear actuator",
    "static": "static friction",
    "stribeck_speed": "static friction",
    "detent": "detents",
}
LEFT_OUT_OF = {
    mjcf.export: {"speed": "maximum speed of references", "thruster_lag": "thruster"},
    urdf.export: {
        "density": "water and gravity: density",
        "gravity": "water and gravity: density",
        "volume": "volumes",
        "thrusters": "thrusters: surge-left",
        "thruster_lag": "thrusters: surge-left",
        "servo": "gains of",
        "spring": "springs",
        "home": "joint coordinates at the start",
        "inertia": "-",
    },
}


def numbers(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], float]]:
    """Numbers of nested tables and lists, with their paths."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from numbers(inner, (*path, key))
    elif isinstance(value, float):
        yield path, value


def edited(scene: dict[str, Any], path: tuple[Any, ...], value: float) -> dict[str, Any]:
    """The scene with another number at a path."""
    key, *inner = path
    changed = scene.copy()
    changed[key] = edited(scene[key], tuple(inner), value) if inner else value
    return changed


def full_scene() -> dict[str, Any]:
    """The template with every key that it has in comments, too."""
    scene = uvms_gym.load_scene(tomllib.loads(uvms_gym.scene_template()))
    scene["water"]["current"] = [0.1, 0.0, 0.0]
    options = {"lag": 0.1, "dead_band": 0.5, "ambient_flow": 0.3, "deduction": 0.1}
    joint = scene["arm"]["links"][0]["joint"]
    joint["friction"] |= {"static": 0.08, "stribeck_speed": 0.2}
    joint |= {"spring": {"stiffness": 0.5, "rest": 0.1}, "detent": {"torque": 0.1, "period": 0.5, "offset": 0.1}}
    scene["vehicle"]["thrusters"][0] |= options | {"induced": [0.0, 0.1, 0.0, 0.01, 0.0, 0.0]}
    joint = {"kind": "revolute", "axis": [0.0, 0.0, 1.0], "rotor_inertia": 0.01}
    scene["fixtures"] = [{"name": "valve", "joint": joint}]
    return uvms_gym.load_scene(scene)


@pytest.mark.parametrize("export", [mjcf.export, urdf.export])
def test_every_number_of_a_scene_is_an_element_or_left_out_by_name(export: Callable[..., Any]) -> None:
    scene = full_scene()
    text, _ = export(scene)
    comments, _, _ = text.partition("-->")
    phrases, silent = LEFT_OUT | LEFT_OUT_OF[export], []
    tables = ("water", "vehicle", "arm", "payload", "contact", "fixtures")
    for path, value in numbers({key: scene[key] for key in tables}):
        key = next((key for key in reversed(path) if key in phrases), None)
        changed, _ = export(edited(scene, path, value * 1.37 + 0.0123))
        # Lengths of axes have no meaning.
        if changed == text and not (path[-2] == "axis" and value):
            silent += [path] if key is None or phrases[key] not in comments else []
    assert not silent


@pytest.mark.parametrize("name", ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-alpha5-pool"])
def test_an_arm_comes_back_from_its_urdf(name: str, tmp_path: Path) -> None:
    scene = uvms_gym.load_scene(name)
    path = tmp_path / "robot.urdf"
    path.write_text(export_urdf(scene))
    frame = scene["arm"]["mount"]["frame"]
    found = uvms_gym.import_robot(
        path, vehicle=scene, mount=[*frame["position"], *frame["rpy"]], base="base", tip="end_effector"
    )["arm"]
    assert found["end_effector"] == scene["arm"]["end_effector"]
    assert found["mount"] == scene["arm"]["mount"]
    for link, expected in zip(found["links"], scene["arm"]["links"], strict=True):
        assert link["name"] == expected["name"]
        joint, own = expected["joint"], link["joint"]
        for key in ("kind", "frame", "axis", "effort", "speed", "rotor_inertia"):
            assert own.get(key) == joint.get(key), key
        for table, keys in (("limits", ("lower", "upper")), ("friction", ("viscous", "coulomb"))):
            assert [own[table][key] for key in keys] == [joint[table][key] for key in keys]
        for key in ("mass", "center_of_mass", "inertia"):
            np.testing.assert_array_equal(link["body"][key], expected["body"][key])


@pytest.mark.parametrize("option", ["--mjcf", "--urdf"])
def test_the_command_writes_a_file_and_says_what_is_left_out(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "folder" / "robot.xml"
    command = ["scenes", "export", "bluerov2-heavy-alpha5", option, str(path)]
    assert main(command) == 0
    out = capsys.readouterr().out
    assert f"wrote {path}" in out and "- left out: added mass of all bodies" in out
    text = path.read_text()
    assert text == {"--mjcf": export_mjcf, "--urdf": export_urdf}[option]("bluerov2-heavy-alpha5")
    assert all(line.removeprefix("- left out: ") in text for line in out.splitlines() if line.startswith("- "))
    assert main(command) == 2
    assert f"{path} exists: give another {option}, or --force to overwrite it" in capsys.readouterr().err
    assert main([*command, "--force"]) == 0


def test_the_command_refuses_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkdir(folder := tmp_path / "folder")
    (tmp_path / "file").write_text("")
    for arguments, message in (
        (["bluerov2-heavy"], "at least one of --mjcf and --urdf is needed"),
        (["nemo", "--mjcf", str(tmp_path / "a.xml")], "nemo"),
        (["bluerov2-heavy", "--mjcf", str(folder), "--force"], f"cannot write {folder}: it is a folder"),
        (["bluerov2-heavy", "--urdf", str(tmp_path / "file" / "a.urdf")], f"cannot make the folder {tmp_path}/file"),
    ):
        assert main(["scenes", "export", *arguments]) == 2
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1


def test_names_that_xml_or_a_format_cannot_have_are_written_otherwise() -> None:
    scene = uvms_gym.load_scene("bluerov2-heavy-alpha5")
    names = ["payload", "end_effector", "a--b <&>", "world"]
    for link, name in zip(scene["arm"]["links"], names, strict=True):
        link["name"] = name
    scene["vehicle"]["thrusters"][0]["name"] = "world"
    scene["payload"] = {"body": body(np.random.default_rng(0), 1.0, 0.1)}
    for text in (export_mjcf(scene), export_urdf(scene)):
        root = ET.fromstring(text)
        for tag in ("body", "joint", "link", "general", "position", "site"):
            found = [element.get("name") for element in root.iter(tag)]
            assert len(set(found)) == len(found)
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(export_mjcf(scene))
    assert {model.joint(k).name for k in range(1, model.njnt)} == {"payload", "end_effector", "a--b <&>", "world_"}


def test_angles_are_accurate_at_every_pitch() -> None:
    rng = np.random.default_rng(0)
    for pitch in (0.3, np.pi / 2.0, np.pi / 2.0 - 1e-8, -np.pi / 2.0 + 1e-12):
        for _ in range(20):
            roll, yaw = rng.uniform(-3.0, 3.0, 2)
            turn = Frame(np.zeros(3), np.array([roll, pitch, yaw])).rotation
            again = Frame(np.zeros(3), angles(turn)).rotation
            np.testing.assert_allclose(again, turn, rtol=0.0, atol=4e-15)
