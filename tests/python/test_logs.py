"""Logs of vehicles: what is read equals the motion, in any convention and from any source."""

import re
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_files import (
    ACCELERATION,
    ANGLE,
    BODY,
    JOINTS,
    LENGTH,
    TIME,
    WORLD,
    Convention,
    Motion,
    write_bag,
    write_logs,
    write_zeros,
)

from uvms_gym import Log, LogError, LogMap

ROOT = Path(__file__).parents[2]
POOL = ROOT / "tests" / "data" / "pool"
KINDS = ("pose", "attitude", "twist", "imu", "joints", "thrusters")


def assert_equal(log: Log, motion: Motion, tolerance: float = 1e-9) -> None:
    """Compare a log with the motion that it was written from, which it holds from its start to its end."""
    wxyz = motion.rotation.as_quat(canonical=True)[:, [3, 0, 1, 2]]
    assert tuple(log.channels) == KINDS
    for channel in log.channels.values():
        assert np.allclose(channel.time, motion.time, rtol=0.0, atol=max(1e-9, tolerance))
    assert log.start == pytest.approx(motion.time[0]) and log.end == pytest.approx(motion.time[-1])
    pairs = [
        (log.pose.position, motion.position),
        (log.pose.quaternion, wxyz),
        (log.pose.rotation, motion.rotation.as_matrix()),
        (log.attitude.quaternion, wxyz),
        (log.twist.velocity, motion.velocity),
        (log.twist.angular_velocity, motion.angular_velocity),
        (log.imu.angular_velocity, motion.angular_velocity),
        (log.imu.specific_force, motion.specific_force),
        (log.imu.quaternion, wxyz),
        (log.joints.position, motion.q),
        (log.joints.velocity, motion.qd),
        (log.thrusters.command, motion.command),
    ]
    for k, (read, written) in enumerate(pairs):
        assert read.shape == written.shape and np.allclose(read, written, rtol=0.0, atol=tolerance), k


conventions = st.builds(
    Convention,
    time=st.sampled_from(sorted(TIME)),
    length=st.sampled_from(sorted(LENGTH)),
    angle=st.sampled_from(sorted(ANGLE)),
    acceleration=st.sampled_from(sorted(ACCELERATION)),
    world=st.sampled_from(sorted(WORLD)),
    body=st.sampled_from(sorted(BODY)),
    order=st.sampled_from(["wxyz", "xyzw", "rpy"]),
    delimiter=st.sampled_from([",", ";", "\t", "|", " "]),
    lag=st.floats(-1.0, 1.0),
    sign=st.sampled_from([1, -1]),
    zero=st.floats(-3.0, 3.0),
    scale=st.floats(0.01, 10.0),
    neutral=st.floats(-2000.0, 2000.0),
    shuffle=st.integers(0, 99),
)


@given(convention=conventions, seed=st.integers(0, 99))
def test_a_log_reads_equal_in_every_convention(
    convention: Convention, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder, motion = tmp_path_factory.mktemp("log"), Motion.random(seed=seed)
    found = write_logs(folder, motion, convention)
    assert_equal(Log.read(folder, found, "1"), motion, 1e-8)


@pytest.mark.parametrize("other", [{"world": "ned"}, {"body": "frd"}, {"length": "mm"}, {"order": "rpy"}, {"sign": -1}])
def test_a_wrong_convention_would_show(other: dict[str, Any], tmp_path: Path) -> None:
    motion = Motion.random()
    right = write_logs(tmp_path, motion, Convention())
    wrong = write_logs(tmp_path, motion, replace(Convention(), **other))
    if "order" in other:
        wrong["pose"]["rpy"]["unit"] = "deg"
        right = wrong
    with pytest.raises(AssertionError):
        assert_equal(Log.read(tmp_path, right, "1"), motion)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_bag_reads_equal_to_tables(storage: str, tmp_path: Path) -> None:
    motion = Motion.random()
    found = write_bag(tmp_path / "bag", motion, storage)
    tables = Log.read(tmp_path, write_logs(tmp_path, motion), "1")
    bag = Log.read(tmp_path / "bag", found)
    assert bag.name == "bag"
    assert_equal(bag, motion)
    for kind, channel in bag.channels.items():
        for name, value in vars(channel).items():
            if isinstance(value, np.ndarray):
                assert np.allclose(value, getattr(tables.channels[kind], name), rtol=0.0, atol=1e-9), (kind, name)


@pytest.mark.parametrize(
    ("kind", "messages"),
    [
        ("pose", ["PoseStamped", "PoseWithCovarianceStamped", "Odometry", "TransformStamped"]),
        (
            "attitude",
            ["PoseStamped", "PoseWithCovarianceStamped", "Odometry", "TransformStamped", "Imu", "QuaternionStamped"],
        ),
        ("twist", ["Odometry", "TwistStamped", "TwistWithCovarianceStamped", "Twist"]),
        ("imu", ["Imu"]),
    ],
)
def test_usual_messages_need_no_columns(kind: str, messages: list[str], tmp_path: Path) -> None:
    optional = {"twist": {"angular_velocity": {}}, "imu": {"specific_force": {}, "quaternion": {}}}.get(kind, {})
    for message in messages:
        path = tmp_path / message
        write_zeros(path, message)
        channel = Log.read(path, {kind: {"topic": "/topic", **optional}}).channels[kind]
        assert channel.time.tolist() == [1.0, 2.0]
        arrays = {name: value for name, value in vars(channel).items() if isinstance(value, np.ndarray)}
        assert len(arrays) == {"pose": 3, "attitude": 2, "twist": 3, "imu": 4}[kind]
        for name, value in arrays.items():
            if name != "time":
                assert value.tolist() == 2 * [[1.0, 0.0, 0.0, 0.0] if name == "quaternion" else [0.0, 0.0, 0.0]]


def test_bags_are_trials_of_a_directory(tmp_path: Path) -> None:
    motions = {name: Motion.random(seed=k) for k, name in enumerate(("run_a", "run_b"))}
    for name, motion in motions.items():
        found = write_bag(tmp_path / f"{name}_bag", motion)
    found["bag"] = "{trial}_bag"
    logs = Log.read_all(tmp_path, found)
    assert [log.name for log in logs] == list(motions)
    for log in logs:
        assert_equal(log, motions[log.name])


def test_a_topic_may_name_its_fields_and_stamps(tmp_path: Path) -> None:
    motion = Motion.random(n=15)
    assert motion.time[-1] < 3.0  # (the field holds nanoseconds of a second)
    found = write_bag(tmp_path / "bag", motion, late=0.25)
    found["pose"] = {"topic": "/odometry", "time": {"stamp": "bag", "lag": 0.25}}
    found["imu"]["time"] = {"column": "header.stamp.nanosec", "unit": "ns", "lag": -2.0}
    found["attitude"]["quaternion"] = {"columns": [f"pose.pose.orientation.{x}" for x in "xyzw"], "order": "xyzw"}
    assert_equal(Log.read(tmp_path / "bag", found), motion)


def test_bags_need_their_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(LogError, match=r"needs the package rosbags: pip install 'uvms-gym\[ros2\]'$"):
        Log.read(tmp_path, {"pose": {"topic": "/pose"}})


def test_a_directory_is_a_trial_without_names_of_trials(tmp_path: Path) -> None:
    motion = Motion.random()
    folder = tmp_path / "dive 3"
    folder.mkdir()
    found = write_logs(folder, motion, trial="x")
    for keys in found.values():
        keys["file"] = keys["file"].replace("{trial}", "x")
    logs = [Log.read(folder, found), *Log.read_all(folder, found)]
    for log in logs:
        assert log.name == "dive 3"
        assert_equal(log, motion)


def test_trials_are_found_by_their_files_and_sorted(tmp_path: Path) -> None:
    for k, name in enumerate(("b[1]", "a", "_c 2")):
        found = write_logs(tmp_path, Motion.random(seed=k), trial=name)
    (tmp_path / "notes.csv").write_text("no log")
    (tmp_path / "a_pose.csv.bak").write_text("no log")
    assert [log.name for log in Log.read_all(tmp_path, LogMap.read(found))] == ["_c 2", "a", "b[1]"]


def test_a_trial_has_keys_of_its_own(tmp_path: Path) -> None:
    motion = Motion.random()
    for name in ("a", "b"):
        found = write_logs(tmp_path, motion, trial=name)
    found["start"] = {"position": "z", "above": -1e9}
    found["end"] = {"position": "z", "above": 1e9}
    found["trial"] = {
        "b": {
            "start": 2.5,
            "end": {"position": "x", "below": -1e9},
            "joints": {"time": {"lag": 0.1}, "axes": {"elbow": {"zero": 1.0}}},
        }
    }
    a, b = Log.read_all(tmp_path, found)
    own = LogMap.read(found).of("b").end
    assert (own.axis, own.above, own.below) == (0, np.inf, -1e9)
    assert (a.start, b.start) == (pytest.approx(motion.time[0]), 2.5)
    assert np.allclose(b.joints.time, motion.time[-len(b.joints.time) :] - 0.1)
    assert np.allclose(a.joints.position, motion.q)
    assert np.allclose(b.joints.position, motion.q[-len(b.joints.time) :] - np.array([0.0, 0.0, 1.0, 0.0]))


def test_joints_and_thrusters_follow_the_scene(tmp_path: Path) -> None:
    motion = Motion.random()
    found = write_logs(tmp_path, motion)
    names = list(reversed(JOINTS[1:]))
    found["joints"]["axes"] = {name: found["joints"]["axes"][name] for name in names} | {"shoulder": {"value": 180.0}}
    found["joints"]["axes"]["shoulder"]["unit"] = "deg"
    del found["thrusters"]
    log = Log.read(tmp_path, found, "1")
    assert log.joints.names == (*names, "shoulder")
    log = Log.read(tmp_path, found, "1", scene="bluerov2-heavy-alpha5")
    assert log.joints.names == JOINTS
    assert np.allclose(log.joints.position[:, 0], np.pi) and np.all(log.joints.velocity[:, 0] == 0.0)
    assert np.allclose(log.joints.position[:, 1:], motion.q[:, 1:])


def test_the_clock_may_begin_at_the_first_sample(tmp_path: Path) -> None:
    motion = Motion.random(start=1.7e9)
    found = write_logs(tmp_path, motion, Convention(time="ns"))
    found["clock"] = "first"
    log = Log.read(tmp_path, found, "1")
    assert log.start == 0.0
    assert np.allclose(log.imu.time, motion.time - motion.time[0], rtol=0.0, atol=1e-6)


def test_start_and_end_are_times_keys_or_positions(tmp_path: Path) -> None:
    motion = Motion.random(n=100)
    motion = replace(motion, position=np.linspace(0.0, 1.0, 100)[:, None] * [1.0, 1.0, 1.0])
    found = write_logs(tmp_path, motion)
    (tmp_path / "meta_1.yml").write_text("# metadata\nplace: tank: north\nstart_time: 2.75 # s\nend: 1e9\n")
    found["start"] = {"file": "meta_{trial}.yml", "key": "start_time"}
    found["end"] = {"position": "z", "above": 0.7}
    log = Log.read(tmp_path, found, "1")
    assert log.start == 2.75
    assert log.end == motion.time[np.argmax(motion.position[:, 2] > 0.7)]
    for channel in log.channels.values():
        assert channel.time[0] <= 2.75 < channel.time[1] and channel.time[-2] < log.end <= channel.time[-1]
    found["start"], found["end"] = {"position": "x", "above": 0.5}, 1e3
    log = Log.read(tmp_path, found, "1")
    assert log.start == motion.time[np.argmax(motion.position[:, 0] > 0.5)]
    assert log.end == motion.time[-1]


def test_the_examples_of_the_documentation_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    blocks = re.findall(r"^```(\w+)\n(.*?)^```", (ROOT / "docs" / "logs.md").read_text(), re.MULTILINE | re.DOTALL)
    whole, flight = (LogMap.read(tomllib.loads(text)) for kind, text in blocks if kind == "toml")
    assert tuple(whole.channels) == (*KINDS, "battery") and list(whole.trials) == ["003-1"]
    assert [channel.message for channel in flight.channels.values()] == ["ATT", "IMU", "RCOU", "BAT"]
    names: dict[str, Any] = {}
    exec(next(text for kind, text in blocks if kind == "python"), names)
    assert names["cubics"].shape[1:] == (4, 4)


def test_pool_trials_read_as_their_map_says() -> None:
    flipped, plain = Log.read_all(POOL, POOL / "map.toml", scene="bluerov2-heavy-alpha5")
    assert (flipped.name, plain.name) == ("007-1", "026-1")
    assert (flipped.start, plain.start) == (3.15, 2.4)
    assert flipped.pose.dropped["jumps"] == 52 and plain.pose.dropped["jumps"] == 0
    assert len(flipped.pose.gaps) == 2 and len(plain.pose.gaps) == 0
    assert plain.spans().tolist() == [[plain.start, plain.end]]
    assert len(flipped.spans()) == 3 and len(flipped.spans("imu", "joints")) == 1
    for log in (flipped, plain):
        assert log.joints.names == JOINTS and np.median(np.diff(log.joints.time)) == pytest.approx(0.0447, abs=1e-3)
        # Both attitudes agree but for the heading, and the IMU reads gravity.
        times = log.imu.time[log.pose.covers(log.imu.time)]
        down = log.pose.rotation_at(times)[:, 2], log.imu.attitude.rotation_at(times)[:, 2]
        assert np.degrees(np.sqrt(np.mean(np.sum((down[0] - down[1]) ** 2, axis=1)))) < 2.0
        gravity = np.einsum("nij,nj->ni", log.imu.attitude.rotation, log.imu.specific_force)
        assert np.allclose(np.mean(gravity, axis=0), [0.0, 0.0, 9.81], atol=0.25)
        # The logged velocities are those of the cubics.
        start, end = log.spans("joints")[0]
        cubics = log.joints.cubics(start, 0.02, int((end - start) / 0.02), smoothing=0.1)
        velocity = log.joints.velocity_at(start + 0.02 * np.arange(len(cubics)))
        assert np.sqrt(np.mean((cubics[:, :, 1] - velocity) ** 2)) < 0.1 * np.sqrt(np.mean(velocity**2)) + 0.02
    assert "pose: 779 samples, 78 Hz; gaps: none; left out: none" in plain.summary()
