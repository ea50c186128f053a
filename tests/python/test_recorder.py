"""Recordings in MCAP: read back by the logs' reader, and by Foxglove's."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import uvms_gym
from uvms_gym import Log, LogError, Rollout
from uvms_gym.cli import main
from uvms_gym.controllers.families import BASELINE, canonical
from uvms_gym.logs import Recorder
from uvms_gym.studies.comparison.own import make_controller

SCENE = "bluerov2-heavy-alpha5"
JOINTS = ("shoulder", "upper-arm", "elbow", "wrist")


def log_map(scene: str) -> dict[str, Any]:
    """Map of a recording, as the documentation has it."""
    simulator = uvms_gym.Simulator(scene)
    axes = {name: {"command": f"data[{k}]"} for k, name in enumerate(simulator.thruster_names)}
    named = {n: {"position": f"position[{n}]", "velocity": f"velocity[{n}]"} for n in simulator.joint_names}
    found: dict[str, Any] = {
        "pose": {"topic": "/odom"},
        "twist": {"topic": "/odom", "angular_velocity": {}},
        "thrusters": {"topic": "/thruster_commands", "axes": axes},
    }
    return found | ({"joints": {"topic": "/joint_states", "axes": named}} if named else {})


def moved(k: int, instances: int = 1) -> uvms_gym.Simulator:
    """Simulator in a state of its own for each k."""
    rng = np.random.default_rng(k)
    simulator = uvms_gym.Simulator(SCENE, instances)
    q = rng.normal(size=(instances, 4))
    simulator.set_state(
        position=rng.normal(size=(instances, 3)),
        quaternion=q / np.linalg.norm(q, axis=1, keepdims=True),
        twist=rng.normal(size=(instances, 6)),
        q=rng.uniform(0.5, 1.0, (instances, 4)),
        qd=rng.normal(size=(instances, 4)),
    )
    return simulator


def test_a_recording_is_read_back(tmp_path: Path) -> None:
    times = 1.0 + 0.07 * np.arange(20) + 1e-9 * np.arange(20) ** 3
    states = [moved(k, 2) for k in range(20)]
    forces = np.random.default_rng(0).normal(size=(20, 12))
    with Recorder(tmp_path / "a.mcap") as recorder:
        for time, state, force in zip(times, states, forces):
            recorder.add(state, time, forces=force, instance=1)
    log = Log.read(tmp_path / "a.mcap", log_map(SCENE), scene=SCENE)
    stamps = np.array([round(time * 1e9) / 10**9 for time in times])
    for channel in log.channels.values():
        assert np.array_equal(channel.time, stamps)
    for value, name in (
        (log.pose.position, "position"),
        (np.concatenate([log.twist.velocity, log.twist.angular_velocity], axis=1), "twist"),
        (log.joints.position, "q"),
        (log.joints.velocity, "qd"),
    ):
        expected = [getattr(state, name)[1] for state in states]
        assert np.allclose(value, expected, rtol=0.0, atol=1e-12) and np.ptp(expected) > 0.1, name
    assert np.allclose(log.pose.rotation, [state.rotation[1] for state in states], rtol=0.0, atol=1e-12)
    assert np.array_equal(log.thrusters.command, forces[:, :8])


def test_a_recording_that_was_cut_is_read_up_to_there(tmp_path: Path) -> None:
    state, rows = moved(0), 4000
    with Recorder(tmp_path / "a.mcap") as recorder:
        for k in range(rows):
            recorder.add(state, 0.01 * k)
    data, found = (tmp_path / "a.mcap").read_bytes(), {"pose": {"topic": "/odom"}}
    (tmp_path / "bag").mkdir()
    # A killed recorder leaves no metadata; messages are written in chunks of 1 MB.
    for file, path in ((tmp_path / "a.mcap", tmp_path / "a.mcap"), (tmp_path / "bag" / "bag_0.mcap", tmp_path / "bag")):
        for end, least, most in ((len(data) - 5, rows, rows), (2 * len(data) // 3, rows // 3, rows - 1)):
            file.write_bytes(data[:end])
            pose = Log.read(path, found).pose
            assert least <= len(pose.time) <= most
            assert np.allclose(pose.time, 0.01 * np.arange(len(pose.time)), rtol=0.0, atol=1e-9)
            assert pose.notes[0].startswith("cut or damaged recording: ")
    (tmp_path / "a.mcap").write_bytes(data[:100])
    with pytest.raises(LogError, match=r"a\.mcap: cannot be read: \S.*$"):
        Log.read(tmp_path / "a.mcap", found)


def test_val_foxgloves_reader_reads_every_message(tmp_path: Path) -> None:
    states = [moved(k) for k in range(3)]
    force = np.random.default_rng(0).normal(size=12)
    with Recorder(tmp_path / "a.mcap") as recorder:
        for k, state in enumerate(states):
            recorder.add(state, 0.5 * k, forces=force)
    found: dict[str, list[Any]] = {}
    kinds = {}
    with open(tmp_path / "a.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
            kinds[channel.topic] = schema.name
    assert kinds == {
        "/odom": "nav_msgs/msg/Odometry",
        "/joint_states": "sensor_msgs/msg/JointState",
        "/thruster_commands": "std_msgs/msg/Float64MultiArray",
        "/wrench": "geometry_msgs/msg/WrenchStamped",
        "/tf": "tf2_msgs/msg/TFMessage",
    }
    assert all([time for time, _ in messages] == [0, 500_000_000, 10**9] for messages in found.values())
    state, odometry = states[2], found["/odom"][2][1]
    p, q = odometry.pose.pose.position, odometry.pose.pose.orientation
    assert [p.x, p.y, p.z] == state.position[0].tolist()
    assert np.allclose(abs(np.dot([q.w, q.x, q.y, q.z], state.quaternion[0])), 1.0, rtol=0.0, atol=1e-12)
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("world", "base_link")
    joints = found["/joint_states"][2][1]
    assert tuple(joints.name) == JOINTS and list(joints.effort) == force[8:].tolist()
    commands = found["/thruster_commands"][2][1]
    assert list(commands.data) == force[:8].tolist()
    assert commands.layout.dim[0].label == ",".join(state.thruster_names)
    wrench, expected = found["/wrench"][2][1].wrench, state.thruster_configuration @ force[:8]
    assert np.allclose([wrench.force.x, wrench.force.z, wrench.torque.y], expected[[0, 2, 4]])
    # The transforms lead from the world to every link.
    poses = {"world": np.eye(4)}
    for transform in found["/tf"][2][1].transforms:
        t, r = transform.transform.translation, transform.transform.rotation
        local = np.eye(4)
        local[:3, :3] = uvms_gym.logs.Pose(
            source="", time=np.arange(2.0), gap=1.0, rows=2, dropped={}, position=np.zeros((2, 3)),
            quaternion=np.array([[r.w, r.x, r.y, r.z]] * 2),
        ).rotation[0]  # fmt: skip
        local[:3, 3] = t.x, t.y, t.z
        poses[transform.child_frame_id] = poses[transform.header.frame_id] @ local
    names = ["base_link", *(f"{name}_link" for name in JOINTS)]
    assert np.allclose([poses[name] for name in names], state.body_poses()[0], rtol=0.0, atol=1e-12)


def test_a_rollout_is_recorded(tmp_path: Path) -> None:
    envs = gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=3, scene="bluerov2-heavy")
    envs.reset(seed=1)
    inner: Any = envs.unwrapped
    rollout = Rollout(envs, uvms_gym.PID(envs))
    expected = []
    with Recorder(tmp_path / "rollout.mcap") as recorder:
        for k in range(10):
            expected.append(inner.snapshot().position[2])
            recorder.add(inner.snapshot(), k * inner.control_period, instance=2)
            rollout.run(1)
    log = Log.read(tmp_path / "rollout.mcap", {"pose": {"topic": "/odom"}})
    assert np.array_equal(log.pose.position, expected) and np.ptp(expected) > 0.0


@pytest.mark.parametrize("scene", [SCENE, "bluerov2-heavy"])
def test_play_records_the_episode(scene: str, tmp_path: Path, capsys: Any) -> None:
    file = tmp_path / "new" / "play.mcap"
    assert main(["play", "--scene", scene, "--seconds", "2", "--seed", "5", "--mcap", str(file)]) == 0
    assert str(file) in capsys.readouterr().out
    log = Log.read(file, log_map(scene), scene=scene)
    env = gymnasium.make("UVMS-StationKeep-v0", scene=scene, max_episode_steps=1000)
    inner: Any = env.unwrapped
    control = make_controller(canonical(BASELINE[inner.task]), env)
    observation, _ = env.reset(seed=5)
    memory = None
    positions, forces = [], []
    for _ in range(round(2.0 / inner.control_period)):
        action, memory = control.predict(observation, memory)
        positions.append(inner.snapshot().position[0])
        forces.append(inner.forces(action, observation)[: len(log.thrusters.names)])
        observation, *_ = env.step(action)
    whole = Log.read(file, {"pose": {"topic": "/odom"}}).pose
    assert np.array_equal(whole.position, [*positions, inner.snapshot().position[0]])
    assert np.array_equal(log.thrusters.command, forces) and np.ptp(forces) > 0.1
    period = inner.control_period
    assert np.array_equal(whole.time, [round(k * period * 1e9) / 10**9 for k in range(len(positions) + 1)])


def test_residual_actions_are_recorded_with_their_base(tmp_path: Path) -> None:
    env = gymnasium.make("UVMS-StationKeep-v0", scene="bluerov2-heavy", action="residual")
    inner: Any = env.unwrapped
    observation, _ = env.reset(seed=0)
    nothing = np.zeros(env.action_space.shape)
    assert np.abs(inner.forces(nothing, observation)).max() > 0.1
    with pytest.raises(ValueError, match="residual actions correct a controller"):
        inner.forces(nothing)


def test_mistakes_leave_no_file(tmp_path: Path, capsys: Any) -> None:
    with pytest.raises(ValueError, match=r"^forces has shape \(3,\), but must have \(8,\) or \(12,\)$"):
        with Recorder(tmp_path / "a.mcap") as recorder:
            recorder.add(moved(0), forces=[1.0, 2.0, 3.0])
    assert list(tmp_path.iterdir()) == []
    assert main(["play", "--mcap", str(tmp_path / "a.bag"), "--seconds", "1"]) == 2
    assert "but must end in .mcap" in capsys.readouterr().err
    (tmp_path / "a.mcap").mkdir()
    assert main(["play", "--mcap", str(tmp_path / "a.mcap"), "--seconds", "1"]) == 2
    assert "a.mcap" in capsys.readouterr().err
