"""Robots from MJCF, against MuJoCo itself."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uvms_gym
from uvms_gym import SceneError, Simulator, import_robot
from uvms_gym._importing import mjcf, read_robot
from uvms_gym.robots import import_with_notes
from uvms_gym.studies.speed.rigid_bodies import dry

#: Rotated frames, one within 1e-9 of a pitch of 90 degrees, anchors off the body's origin, coordinates with an offset,
#: a slide, defaults, full inertias and a motor's inertia.
ARM = """<mujoco model="arm"><compiler angle="radian" eulerseq="XYZ"/>
<default><joint damping="0.1" armature="0.02"/><default class="light"><joint armature="0.001"/></default></default>
<worldbody><geom type="plane" size="1 1 1"/>
<body name="foot" pos="0 0 0.1">
 <inertial pos="0 0 0.05" mass="2" diaginertia="0.01 0.01 0.02"/>
 <body name="one" pos="0.1 0.02 0.2" quat="0.70710678118654752 0 0.70710678118654752 0">
  <inertial pos="0.1 0.02 -0.03" mass="1.5" fullinertia="0.02 0.03 0.04 0.001 -0.002 0.003"/>
  <joint name="yaw" axis="0.2 0.1 1" pos="0.03 -0.01 0.02" range="-2 2" frictionloss="0.3"/>
  <body name="two" pos="0.3 0 0.05" euler="0.3 1.570796325794896 0.4">
   <inertial pos="0.05 0 0.1" quat="0.9 0.1 0.3 0.2" mass="0.8" diaginertia="0.003 0.004 0.005"/>
   <joint name="pitch" axis="0 1 0" ref="0.4" pos="0 0.02 0" stiffness="3" springref="0.25"/>
   <body name="three" pos="0 0.1 0.2" euler="-0.2 -1.5707 2.9">
    <joint name="reach" type="slide" axis="0 0.6 0.8" ref="0.05" range="-0.1 0.3" pos="0.04 0 0"/>
    <geom type="capsule" size="0.03 0.1" mass="0.5"/>
    <body name="four" pos="0.1 0 0">
     <joint name="wrist" class="light" axis="1 0 0"/><geom type="box" size="0.05 0.02 0.03" mass="0.3" euler="0.3 0 0"/>
     <site name="tool" pos="0.1 0.02 0" euler="0.1 1.57 0.2"/>
    </body></body></body></body></body></worldbody>
<actuator><motor joint="yaw" ctrlrange="-2 3" gear="10"/><position joint="wrist" forcerange="-4 4"/></actuator>
</mujoco>"""

VEHICLE = """<mujoco model="vehicle"><compiler angle="radian"/><option density="1025"/><worldbody>
<body name="prop"><freejoint/><geom size="0.1" mass="900"/></body>
<body name="hull" pos="0 0 -2"><freejoint/>
 <geom type="box" size="0.3 0.2 0.15" mass="20" pos="0.01 0 -0.02" fluidshape="ellipsoid"/>
 <site name="left" pos="-0.3 0.2 0" euler="0 0 0.7"/><site name="up" pos="0 0 0.1"/>
 <body name="upper" pos="0.3 0.1 0" euler="0 1.5707963 0.2"><joint name="a" axis="0 1 0"/>
  <geom type="cylinder" size="0.04 0.15" pos="0 0 0.1" mass="1.2"/>
  <body name="jaw" pos="0 0.02 0.3"><joint name="left-jaw" axis="1 0 0" range="0 0.5"/>
   <geom type="ellipsoid" size="0.02 0.03 0.05" pos="0 0 0.04" mass="0.1"/></body>
  <body name="other" pos="0 -0.02 0.3"><joint name="right-jaw" axis="-1 0 0" range="0 0.5"/>
   <geom type="sphere" size="0.03" pos="0 0 0.04" mass="0.1"/></body></body></body></worldbody>
<equality><joint joint1="right-jaw" joint2="left-jaw" polycoef="0.01 2 0 0 0"/></equality>
<actuator><general name="main" site="left" gear="2 0 0 0 0 0" ctrlrange="-20 30" dyntype="filter" dynprm="0.2"/>
<motor name="heave" site="up" gear="0 0 1 0 0 0.02" forcerange="-15 25"/>
<motor name="roll" site="up" gear="0 0 0 1 0 0"/></actuator></mujoco>"""


def written(folder: Path, text: str, name: str = "robot.xml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def error_of(path: Path, **options: Any) -> str:
    with pytest.raises(SceneError) as caught:
        import_robot(path, **options)
    text = str(caught.value)
    assert "\n" not in text and text.startswith(str(path))
    return text[len(str(path)) :]


def bias_of(simulator: Simulator) -> Any:
    terms = simulator.equations()
    return (terms["C_nu"] + terms["g"])[0]


def test_val_an_arm_of_mjcf_is_the_one_of_mujoco(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    path = written(tmp_path, ARM)
    scene = dry(import_robot(path, vehicle="free-body", tip="tool"))
    scene["water"]["gravity"] = [0.0, 0.0, -9.81]
    simulator, model = Simulator(scene), mujoco.MjModel.from_xml_path(str(path))
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    assert simulator.q.shape == (1, 4)
    dense = np.zeros((4, 4))
    for _ in range(20):
        data.qpos[:], data.qvel[:] = rng.uniform(-1.5, 1.5, 4), rng.normal(size=4)
        mujoco.mj_forward(model, data)
        simulator.set_state(q=data.qpos, qd=data.qvel)
        mujoco.mj_fullM(model, data, dense)
        np.testing.assert_allclose(simulator.mass_matrix()[0, 6:, 6:], dense, rtol=1e-12, atol=1e-12)
        force = data.qfrc_bias - data.qfrc_spring
        np.testing.assert_allclose(bias_of(simulator)[6:], force, rtol=1e-12, atol=1e-12)
        # MuJoCo's foot is at 0.1 m.
        position, turn = data.site("tool").xpos - [0.0, 0.0, 0.1], data.site("tool").xmat.reshape(3, 3)
        pose = simulator.end_effector_pose()[0]
        np.testing.assert_allclose(pose[:3, 3], position, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(pose[:3, :3], turn, rtol=0.0, atol=1e-12)


def test_joints_have_the_numbers_of_mjcf(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    robot = read_robot(written(tmp_path, ARM))
    joints = {joint["name"]: joint for joint in robot["joints"]}
    yaw, pitch, reach, wrist = (joints[name] for name in ("yaw", "pitch", "reach", "wrist"))
    assert (yaw["kind"], pitch["kind"], reach["kind"]) == ("revolute", "continuous", "prismatic")
    assert (yaw["limits"], yaw["effort"], yaw["friction"]) == ([-2.0, 2.0], 30.0, 0.3)
    assert (wrist["effort"], wrist["armature"], wrist["damping"]) == (4.0, 0.001, 0.1)
    assert [(joint["stiffness"], joint["spring_rest"]) for joint in (pitch, wrist)] == [(3.0, 0.25), (0.0, 0.0)]


def test_val_springs_of_mjcf_pull_as_in_mujoco_there_and_back(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    path = written(tmp_path, ARM)
    imported, notes = import_with_notes(path, vehicle="free-body")
    assert not any("spring" in note for note in notes)
    joint = imported["arm"]["links"][1]["joint"]
    assert joint["spring"] == {"stiffness": 3.0, "rest": 0.25}
    back = written(tmp_path, uvms_gym.export_mjcf(imported), "back.xml")
    rng = np.random.default_rng(7)
    for file in (path, back):
        model = mujoco.MjModel.from_xml_path(str(file))
        data = mujoco.MjData(model)
        q = rng.uniform(-0.1, 0.3, 4)
        data.qpos[-4:] = q
        mujoco.mj_forward(model, data)
        simulator = Simulator(imported)
        simulator.set_state(q=q)
        torques = simulator.joint_torques()["spring"][0]
        np.testing.assert_allclose(torques, data.qfrc_spring[-4:], rtol=1e-12, atol=1e-14)
        assert torques[1] == pytest.approx(-3.0 * (q[1] - 0.25), rel=1e-12)


def test_val_a_vehicle_of_mjcf_is_the_one_of_mujoco(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    path = written(tmp_path, VEHICLE)
    imported, notes = import_with_notes(path)
    assert any("prop" in note and "left out" in note for note in notes)
    assert any("roll" in note and "left out" in note for note in notes)
    assert any("fluidshape" in note for note in notes)
    assert imported["water"]["density"] == 1025.0
    thrusters = imported["vehicle"]["thrusters"]
    assert [thruster["name"] for thruster in thrusters] == ["main", "heave"]
    assert thrusters[0]["limits"] == [-40.0, 60.0] and thrusters[1]["limits"] == [-15.0, 25.0]
    assert thrusters[0]["lag"] == 0.2
    np.testing.assert_allclose(thrusters[0]["axis"], [np.cos(0.7), np.sin(0.7), 0.0], atol=1e-12)
    simulator, model = Simulator(dry(imported)), mujoco.MjModel.from_xml_path(str(path))
    data, rng = mujoco.MjData(model), np.random.default_rng(2)
    dense = np.zeros((15, 15))
    for _ in range(20):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
        twist, q, qd = rng.normal(size=6), rng.uniform(-0.5, 0.5, 3), rng.normal(size=3)
        mujoco.mju_mat2Quat(data.qpos[10:14], turn.ravel())
        data.qpos[7:10], data.qpos[14:] = 0.0, q
        data.qvel[6:] = np.concatenate([turn @ twist[:3], twist[3:], qd])
        data.xfrc_applied[:] = 0.0
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, dense)
        # Linear velocity of a free joint is in world axes.
        to_body = np.eye(9)
        to_body[:3, :3] = turn
        simulator.set_state(rotation=turn, twist=twist, q=q, qd=qd)
        expected = to_body.T @ dense[6:, 6:] @ to_body
        np.testing.assert_allclose(
            simulator.mass_matrix()[0], expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max()
        )
        # v_w' = R (v' + omega x v) adds to the bias in body axes.
        turning = np.concatenate([turn @ np.cross(twist[3:], twist[:3]), np.zeros(6)])
        bias = to_body.T @ (data.qfrc_bias[6:] + dense[6:, 6:] @ turning)
        np.testing.assert_allclose(bias_of(simulator), bias, rtol=1e-12, atol=1e-12 * np.abs(bias).max())


def test_an_equality_of_joints_is_a_joint_that_follows(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    robot = read_robot(written(tmp_path, VEHICLE))
    follower = next(joint for joint in robot["joints"] if joint["name"] == "right-jaw")
    assert follower["mimic"] == {"joint": "left-jaw", "multiplier": 2.0, "offset": 0.01}


def test_bodies_with_several_joints_and_with_ball_joints(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    text = """<mujoco><worldbody><body name="foot"><geom size="0.1" mass="3"/>
    <body name="hip" pos="0.1 0 0"><joint name="x" axis="1 0 0" pos="0.02 0 0.03"/>
    <joint name="y" axis="0 1 0" pos="0 0 0.1"/>
    <geom type="capsule" size="0.05 0.2" mass="2" pos="0 0 0.2"/>
    <body name="head" pos="0 0 0.5"><joint name="neck" type="ball"/><geom size="0.1" mass="1"/></body></body></body>
    </worldbody></mujoco>"""
    path = written(tmp_path, text)
    scene, notes = import_with_notes(path, vehicle="free-body")
    assert any(note.startswith("hip: 2 joints: each but the last carries 0.1 %") for note in notes)
    assert any(note.startswith("neck: a ball joint") for note in notes)
    simulator, model = Simulator(dry(scene)), mujoco.MjModel.from_xml_path(str(path))
    data, dense = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:2] = 0.4, -0.7
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, dense)
    simulator.set_state(q=[0.4, -0.7])
    np.testing.assert_allclose(simulator.mass_matrix()[0, 6:, 6:], dense[:2, :2], rtol=2e-3, atol=1e-6)


def test_six_joints_to_the_world_are_a_free_vehicle(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    joints = "".join(
        f'<joint name="{kind}{axis}" type="{kind}" axis="{axis}"/>'
        for kind in ("slide", "hinge")
        for axis in ("1 0 0", "0 1 0", "0 0 1")
    )
    hull = f'<body name="hull">{joints}<geom type="box" size="0.3 0.2 0.1" mass="9"/></body>'
    text = f"<mujoco><worldbody>{hull}</worldbody></mujoco>"
    scene, notes = import_with_notes(written(tmp_path, text))
    assert scene["vehicle"]["body"]["mass"] == 9.0 and "arm" not in scene
    assert any("6 joints to the world are taken for a free vehicle's" in note for note in notes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><worldbody><body><geom size='1'/></worldbody></mujoco>", "XML parse error"),
        ("<mujoco><worldbody/></mujoco>", "has no <body>"),
        ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "mass and inertia of moving bodies"),
        ("<mujoco><include file='none.xml'/></mujoco>", "none.xml"),
        ("<mujoco><include file='robot.xml'/></mujoco>", "already included"),
        ("<mujoco><worldbody><foo/></worldbody></mujoco>", "unrecognized element"),
        ('<!DOCTYPE a [<!ENTITY x SYSTEM "/etc/passwd">]><mujoco model="&x;"><worldbody/></mujoco>', "has no <body>"),
    ],
)
def test_broken_mjcf_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    pytest.importorskip("mujoco")
    assert message in error_of(written(tmp_path, text))


def test_mjcf_that_stands_for_very_many_bodies_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.setattr(mjcf, "_SECONDS", 2)
    inner = '<replicate count="3000000" offset="1 0 0"><body><freejoint/><geom size="0.1"/></body></replicate>'
    path = written(tmp_path, f"<mujoco><worldbody>{inner}</worldbody></mujoco>")
    assert "it may stand for very many bodies" in error_of(path)


def test_mjcf_without_its_meshes(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    text = """<mujoco><asset><mesh name="m" file="none.stl"/><texture name="t" type="2d" file="none.png"/>
    <material name="c" texture="t"/></asset><worldbody><body name="hull"><freejoint/>
    <inertial pos="0 0 0" mass="9" diaginertia="0.2 0.3 0.4"/><geom type="mesh" mesh="m" material="c"/></body>
    </worldbody></mujoco>"""
    robot = read_robot(written(tmp_path, text))
    assert robot["notes"] == ["hull: mesh not read: there is no file none.stl"]
    assert robot["links"][-1]["inertial"]["mass"] == 9.0


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("robot.m", "Xudot = -3;", "MATLAB"),
        ("robot.scn", "", "Stonefish"),
        ("robot.usd", "", "USD"),
        ("robot.toml", "", "TOML"),
        ("robot.stl", "", "a mesh"),
    ],
)
def test_other_formats_are_refused_by_name(tmp_path: Path, name: str, text: str, message: str) -> None:
    assert message in error_of(written(tmp_path, text, name))


def test_the_format_follows_from_the_content(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    text = "<?xml version='1.0'?>\n<!-- <robot> --><!DOCTYPE mujoco>\n" + VEHICLE
    assert read_robot(written(tmp_path, text, "robot.urdf"))["format"] == "MJCF"
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    urdf = f'<robot name="r"><link name="a">{inertial}</link></robot>'
    assert read_robot(written(tmp_path, urdf, "robot.xml"))["format"] == "URDF"
