"""Channels of logs: interpolation, gaps, outliers, repeats and cubics."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_files import Motion, write_logs, write_table
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation, Slerp

from uvms_gym import Log, LogError
from uvms_gym.logs import Joints, Pose, Thrusters

seeds = st.integers(0, 999)


def channel(kind: type, time: np.ndarray, gap: float = 0.5, **values: Any) -> Any:
    return kind(source="table", time=np.asarray(time, dtype=float), gap=gap, rows=len(time), dropped={}, **values)


def joints(time: np.ndarray, position: np.ndarray, gap: float = 0.5) -> Joints:
    return channel(Joints, time, gap, names=("a",) * position.shape[1], position=position)


def read_pose(folder: Path, time: np.ndarray, turn: np.ndarray, **keys: Any) -> Log:
    """Log of a vehicle that turns about a fixed axis by angles in degrees."""
    q = Rotation.from_rotvec(np.radians(turn)[:, None] * [0.6, 0.0, 0.8]).as_quat()
    write_table(
        folder / "pose.csv", {"t": time, **dict(zip("xyz", np.zeros((3, len(time))))), **dict(zip("ijkw", q.T))}
    )
    found = {"file": "pose.csv", "time": {"column": "t"}, "position": {"columns": list("xyz")}}
    found["quaternion"] = {"columns": list("ijkw"), "order": "xyzw"}
    return Log.read(folder, {"pose": found | keys})


@given(seed=seeds)
def test_val_interpolation_agrees_with_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.01, 0.1, 20))
    rotation = Rotation.from_rotvec(rng.normal(size=(20, 3)))
    position, q = rng.normal(size=(20, 3)), rng.normal(size=(20, 4))
    times = np.r_[rng.uniform(time[0], time[-1], 30), time]
    pose = channel(Pose, time, position=position, quaternion=rotation.as_quat(canonical=True)[:, [3, 0, 1, 2]])
    assert np.allclose(pose.rotation_at(times), Slerp(time, rotation)(times).as_matrix(), rtol=0.0, atol=1e-12)
    expected = np.stack([np.interp(times, time, column) for column in position.T], axis=-1)
    assert np.allclose(pose.position_at(times), expected, rtol=0.0, atol=1e-12)
    expected = PchipInterpolator(time, q)(times)
    assert np.allclose(joints(time, q).position_at(times), expected, rtol=0.0, atol=1e-12)


def test_values_in_gaps_and_outside_are_nan() -> None:
    time = np.r_[np.linspace(0.0, 1.0, 11), 2.5, np.linspace(4.0, 5.0, 11)]
    thrusters = channel(Thrusters, time, names=("t",), command=np.arange(len(time))[:, None])
    assert np.allclose(thrusters.spans, [[0.0, 1.0], [4.0, 5.0]])
    assert np.allclose(thrusters.gaps, [[1.0, 2.5], [2.5, 4.0]])
    times = np.array([-0.01, 0.0, 0.19, 1.0, 1.01, 2.5, 3.99, 4.0, 5.0, 5.01])
    covered = [False, True, True, True, False, False, False, True, True, False]
    assert thrusters.covers(times).tolist() == covered
    command = thrusters.command_at(times)[:, 0]
    assert np.isnan(command).tolist() == [not inside for inside in covered]
    assert command[[1, 2, 3, 7]].tolist() == [0.0, 1.0, 10.0, 12.0]
    assert len(channel(Thrusters, [0.0, 9.0], names=("t",), command=np.zeros((2, 1))).spans) == 0


def test_spans_of_a_log_are_those_that_its_channels_share(tmp_path: Path) -> None:
    motion = Motion.random(n=60)
    found = write_logs(tmp_path, motion)
    lines = (tmp_path / "1_imu.csv").read_text().splitlines()
    (tmp_path / "1_imu.csv").write_text("\n".join(lines[:21] + lines[41:]))
    found["gap"], found["joints"]["gap"] = 0.2, 0.01
    log = Log.read(tmp_path, found, "1")
    a, b = motion.time[19], motion.time[40]
    assert np.allclose(log.spans("pose", "imu"), [[log.start, a], [b, log.end]])
    assert len(log.spans()) == len(log.spans("joints")) == 0
    assert np.allclose(log.between(0.0, (a + b) / 2.0).spans("imu", "twist"), [[log.start, a]])
    with pytest.raises(
        LogError, match=r"^1: no channel sonar; channels: pose, attitude, twist, imu, joints, thrusters$"
    ):
        log.spans("sonar")


@given(seed=seeds)
def test_a_cut_log_interpolates_as_the_whole_one(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder, rng = tmp_path_factory.mktemp("log"), np.random.default_rng(seed)
    log = Log.read(folder, write_logs(folder, Motion.random(seed=seed)), "1")
    start, end = rng.uniform([log.start - 0.1, log.start + 0.2], [log.start + 0.2, log.end + 0.1])
    cut = log.between(start, end)
    assert (cut.start, cut.end) == (max(start, log.start), min(end, log.end))
    times = np.linspace(cut.start, cut.end, 20)
    for quantity in (
        lambda x: x.pose.position_at(times),
        lambda x: x.imu.angular_velocity_at(times),
        lambda x: x.twist.velocity_at(times),
        lambda x: x.attitude.quaternion_at(times),
        lambda x: x.thrusters.command_at(times),
    ):
        assert np.array_equal(quantity(cut), quantity(log)) and not np.isnan(quantity(cut)).any()


def test_arrays_cannot_be_changed(tmp_path: Path) -> None:
    log = Log.read(tmp_path, write_logs(tmp_path, Motion.random()), "1")
    with pytest.raises(ValueError, match="read-only"):
        log.pose.position[0] = 0.0


@given(seed=seeds, dt=st.floats(0.005, 0.1), smoothing=st.sampled_from([0.0, 0.1]))
def test_cubics_are_continuous_with_their_slopes(seed: int, dt: float, smoothing: float) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.02, 0.08, 60))
    log = joints(time, np.cumsum(rng.normal(size=(60, 4)), axis=0))
    c = log.cubics(time[0], dt, int((time[-1] - time[0]) / dt), smoothing)
    c0, c1, c2, c3 = np.moveaxis(c, -1, 0)
    scale = np.max(np.abs(c1)) + np.max(np.abs(c0))
    assert np.allclose((c0 + dt * (c1 + dt * (c2 + dt * c3)))[:-1], c0[1:], rtol=0.0, atol=1e-12 * scale)
    assert np.allclose((c1 + dt * (2.0 * c2 + dt * 3.0 * c3))[:-1], c1[1:], rtol=0.0, atol=1e-11 * scale)
    if not smoothing:
        assert np.allclose(c0, log.position_at(time[0] + dt * np.arange(len(c))), rtol=0.0, atol=1e-12 * scale)


@given(seed=seeds, smoothing=st.floats(0.01, 0.2))
def test_smoothing_keeps_quadratic_motions(seed: int, smoothing: float) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.02, 0.08, 60))
    a, b, c = rng.normal(size=(3, 4))
    log = joints(time, a + b * time[:, None] + c * time[:, None] ** 2)
    cubics = log.cubics(time[0], 0.02, 80, smoothing)
    t = (time[0] + 0.02 * np.arange(80))[:, None]
    assert np.allclose(cubics[:, :, 0], a + b * t + c * t * t, rtol=0.0, atol=1e-6)
    assert np.allclose(cubics[:, :, 1], b + 2.0 * c * t, rtol=0.0, atol=1e-5)
    assert np.allclose(cubics[:, :, 2], c, rtol=0.0, atol=1e-3)


def test_val_smoothing_is_a_weighted_regression() -> None:
    rng = np.random.default_rng(0)
    time, q = np.cumsum(rng.uniform(0.02, 0.08, 60)), rng.normal(size=60)
    knot, width = time[30] + 0.01, 0.15
    # (The weights end at five standard deviations; numpy.polyfit squares its own.)
    near = np.abs(time - knot) < 5.0 * width
    weights = np.exp(-0.25 * ((time[near] - knot) / width) ** 2)
    _, slope, value = np.polyfit(time[near] - knot, q[near], 2, w=weights)
    cubic = joints(time, q[:, None]).cubics(knot, 0.02, 1, width)[0, 0]
    assert np.allclose(cubic[:2], [value, slope], rtol=0.0, atol=1e-9)


def test_smoothing_removes_the_slopes_of_jittering_stamps() -> None:
    rng = np.random.default_rng(0)
    true = np.arange(0.0, 10.0, 0.045)
    time = np.sort(true + rng.uniform(0.0, 0.04, len(true)))
    log = joints(time, np.sin(true)[:, None])
    slope = np.cos(time[0] - 0.02 + 0.01 * np.arange(900))
    rough, smooth = (log.cubics(time[0], 0.01, 900, smoothing)[:, 0, 1] for smoothing in (0.0, 0.15))
    assert np.sqrt(np.mean((smooth - slope) ** 2)) < 0.05 < 0.3 < np.sqrt(np.mean((rough - slope) ** 2))


def test_cubics_refuse_gaps_and_wrong_arguments() -> None:
    time = np.r_[np.arange(0.0, 1.01, 0.1), np.arange(4.0, 5.01, 0.1)]
    log = joints(time, np.zeros((len(time), 2)))
    assert log.cubics(4.0, 0.1, 10).shape == (10, 2, 4)
    text = r"^table: joint positions do not cover 0.5 to 1.5 s; without gaps over 0.5 s are 0 to 1 s, 4 to 5 s$"
    with pytest.raises(LogError, match=text):
        log.cubics(0.5, 0.1, 10)
    for arguments in ((0.0, 0.0, 1), (0.0, 0.1, 0), (0.0, 0.1, 1, -1.0), (0.0, np.nan, 1)):
        with pytest.raises(ValueError, match=r"^dt must be > 0, periods >= 1 and smoothing >= 0, but dt = "):
            log.cubics(*arguments)
    with pytest.raises(LogError, match=r"^table: 2 samples cannot be smoothed, at least 4 can$"):
        joints([0.0, 0.1], np.zeros((2, 1))).cubics(0.0, 0.1, 1, 0.1)


def test_flips_are_left_out_and_turns_are_not(tmp_path: Path) -> None:
    time = np.arange(0.0, 3.0, 0.02)
    turn = 40.0 * np.sin(time)
    bad = np.zeros(len(time), dtype=bool)
    bad[[0, 40, 41, 42, 100]] = True
    bad[-3:] = True
    log = read_pose(tmp_path, time, np.where(bad, turn + 90.0, turn), jump_deg=10.0)
    assert log.pose.dropped == {"equal stamps": 0, "jumps": 8} and log.pose.rows == len(time)
    assert np.array_equal(log.pose.time, time[~bad])
    everything = read_pose(tmp_path, time, np.where(bad, turn + 90.0, turn))
    assert np.array_equal(everything.pose.time, time)


def test_a_turn_during_a_gap_is_no_jump(tmp_path: Path) -> None:
    time = np.r_[np.arange(0.0, 1.0, 0.02), np.arange(4.0, 5.0, 0.02)]
    turn = np.where(time > 2.0, 60.0, 0.0)
    turn[70] = -60.0
    assert np.array_equal(read_pose(tmp_path, time, turn, jump_deg=10.0).pose.time, np.delete(time, 70))
    assert len(read_pose(tmp_path, time, turn, jump_deg=10.0, gap=np.inf).pose.time) == 50


def test_equal_stamps_keep_their_first_row(tmp_path: Path) -> None:
    log = read_pose(tmp_path, np.array([0.0, 0.1, 0.1, 0.1, 0.2]), np.arange(5.0))
    assert log.pose.time.tolist() == [0.0, 0.1, 0.2] and log.pose.dropped["equal stamps"] == 2
    assert np.allclose(
        log.pose.quaternion[1], [np.cos(np.radians(0.5)), *np.sin(np.radians(0.5)) * np.array([0.6, 0.0, 0.8])]
    )


def test_one_row_per_change_remains(tmp_path: Path) -> None:
    time = np.arange(0.0, 2.0, 0.02)
    values = np.floor(time / 0.06 + 1e-9) * np.where((time > 0.5) & (time < 1.5), 0.0, 1.0)
    write_table(tmp_path / "joints.csv", {"t": time, "a": values, "b": 0.0 * time, "va": time, "vb": time})
    axes = {name: {"position": name, "velocity": "v" + name} for name in "ab"}
    found: dict[str, Any] = {"file": "joints.csv", "time": {"column": "t"}, "axes": axes}
    every = Log.read(tmp_path, {"joints": found}).joints
    assert len(every.time) == 100
    log = Log.read(tmp_path, {"joints": found | {"repeat_period": 0.2}}).joints
    changes = np.r_[True, np.diff(values) != 0.0]
    assert set(time[changes]) <= set(log.time) and log.dropped["repeats"] == 100 - len(log.time)
    assert np.max(np.diff(log.time)) <= 0.22  # (the arm rests for a second)
    rest = log.time[(log.time > 0.52) & (log.time < 1.5)]
    assert np.min(np.diff(rest)) >= 0.2 - 1e-9 and len(rest) == 4
    assert np.array_equal(log.velocity[:, 0], log.time)


def test_quantities_that_the_map_lacks_are_refused(tmp_path: Path) -> None:
    found = write_logs(tmp_path, Motion.random())
    del found["twist"]["angular_velocity"], found["imu"]["specific_force"], found["imu"]["quaternion"]
    for axis in found["joints"]["axes"].values():
        del axis["velocity"]
    log = Log.read(tmp_path, found, "1")
    assert log.imu.attitude is None and log.joints.velocity is None
    for read, name in (
        (log.twist.angular_velocity_at, "angular_velocity"),
        (log.imu.specific_force_at, "specific_force"),
        (log.joints.velocity_at, "velocity"),
    ):
        with pytest.raises(LogError, match=f"csv: the map names no {name}$"):
            read([3.0])
