"""Logs as people have them: lost frames, other formats of text, stamps out of order, several publishers of a topic."""

import contextlib
import sqlite3
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from log_files import Motion, write_logs, write_table

from uvms_gym import Log, LogError
from uvms_gym.cli.logs import remarks

TABLE = "t,roll,pitch,yaw,note\n" + "".join(f"{k / 10},0,-0.5,{k}.25,ok\n" for k in range(6))
RPY = {"columns": ["roll", "pitch", "yaw"], "unit": "deg"}


def read(folder: Path, data: str | bytes, time: Mapping[str, Any] = {}, **keys: Any) -> Any:
    """Channel of a table of attitudes."""
    (folder / "a.csv").write_bytes(data if isinstance(data, bytes) else data.encode())
    found = {"file": "a.csv", "time": {"column": "t", **time}, "rpy": RPY, **keys}
    return Log.read(folder, {"attitude": found}).attitude


def yaw(channel: Any) -> list[float]:
    q = channel.quaternion
    return np.round(np.degrees(2.0 * np.arctan2(q[:, 3], q[:, 0])), 2).tolist()


WHOLE = [k + 0.25 for k in range(6)]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0.2,0,-0.5,2.25,ok", "0.2,nan,NaN,-nan(ind),"),
        ("0.2,0,-0.5,2.25,ok", "0.2,,,,"),
        ("0.2,0,-0.5,2.25,ok", "0.2,0,-0.5,N/A,ok"),
        ("0.2,0,-0.5,2.25,ok", "nan,0,-0.5,2.25,ok"),
        ("0.2,0,-0.5,2.25,ok", ",,,,"),
    ],
)
def test_a_lost_frame_is_left_out_and_counted(tmp_path: Path, old: str, new: str) -> None:
    channel = read(tmp_path, TABLE.replace(old, new))
    assert yaw(channel) == [*WHOLE[:2], *WHOLE[3:]]
    assert channel.rows == 6 and channel.dropped == {"lost frames": 1, "equal stamps": 0}


def test_errors_below_lost_frames_name_the_files_line(tmp_path: Path) -> None:
    data = "# a remark\n" + TABLE.replace("0.1,0,-0.5,1.25,ok\n", "0.1,,,,\n\n").replace("3.25", "x")
    with pytest.raises(LogError, match=r"a\.csv, line 7, yaw: 'x' is not a number$"):
        read(tmp_path, data)
    with pytest.raises(LogError, match=r"a\.csv, line 7: the stamp 0\.05 is before .*, 0\.2; time\.backwards = "):
        read(tmp_path, data.replace("0.3,", "0.05,").replace("x", "3"))


def test_empty_rows_are_left_out_and_counted(tmp_path: Path) -> None:
    channel = read(tmp_path, TABLE.replace("0.3,", "\n  \n0.3,") + "\n\n")
    assert yaw(channel) == WHOLE
    assert channel.rows == 8 and channel.dropped == {"empty rows": 2, "equal stamps": 0}


def test_a_row_that_the_files_end_cuts_is_left_out_and_counted(tmp_path: Path) -> None:
    last = TABLE.rstrip("\n").rpartition("\n")[2]
    for cut in (last.partition(",")[0], ",".join(last.split(",")[:2]) + ","):
        channel = read(tmp_path, TABLE.rstrip("\n").removesuffix(last) + cut)
        assert yaw(channel) == WHOLE[:-1]
        assert channel.rows == 6 and channel.dropped == {"cut rows": 1, "equal stamps": 0}
    # Without the end of its line a row may be whole; a short row elsewhere is a mistake.
    assert yaw(read(tmp_path, TABLE.rstrip("\n"))) == WHOLE
    for wrong in (TABLE.rstrip("\n").removesuffix(last) + "0.5\n", TABLE.replace("0.2,", "0.15\n0.2,")):
        with pytest.raises(LogError, match=r"line \d: 1 columns, but the first line has 5$"):
            read(tmp_path, wrong)


def test_a_quaternion_of_zeros_is_a_lost_frame(tmp_path: Path) -> None:
    motion = Motion.random(n=8)
    found = write_logs(tmp_path, motion)
    lines = (tmp_path / "1_attitude.csv").read_text().splitlines()
    lines[4] = ",".join([lines[4].split(",")[0], "0", "0", "0.0", "-0", "world"])
    (tmp_path / "1_attitude.csv").write_text("\n".join(lines))
    channel = Log.read(tmp_path, {"attitude": found["attitude"]}, "1").attitude
    assert channel.dropped["lost frames"] == 1 and np.array_equal(channel.time, np.delete(motion.time, 3))


def commas(text: str) -> str:
    return text.replace(",", ";").replace(".", ",")


@pytest.mark.parametrize("decimal", [{}, {"decimal": ","}])
def test_decimal_commas_are_read(tmp_path: Path, decimal: dict[str, str]) -> None:
    channel = read(tmp_path, commas(TABLE), delimiter=";", **decimal)
    assert yaw(channel) == WHOLE and channel.time.tolist() == [k / 10 for k in range(6)]
    assert channel.notes == (() if decimal else ("decimal commas",))
    quoted = "\n".join(",".join(f'"{cell}"' for cell in line.split(";")) for line in commas(TABLE).splitlines())
    assert yaw(read(tmp_path, quoted, **decimal)) == WHOLE


def test_commas_between_thousands_are_not_taken_for_decimal_commas(tmp_path: Path) -> None:
    data = "t;roll;pitch;yaw\n" + "".join(f"{k + 1},250;0;0;{k}\n" for k in range(4))
    with pytest.raises(LogError, match=r"a\.csv: '1,250' has a decimal comma or .*: decimal = \",\" in the map"):
        read(tmp_path, data, delimiter=";")
    assert read(tmp_path, data, delimiter=";", decimal=",").time.tolist() == [1.25, 2.25, 3.25, 4.25]
    for wrong, keys in (
        (data.replace("2,250", "1.002,250"), {"decimal": ","}),
        (data.replace("2,250", "1002.250"), {"decimal": ","}),
        (data.replace("1,250", "1,25").replace("2,250", "2.25"), {}),
        (data, {"decimal": "."}),
    ):
        with pytest.raises(LogError, match=r"a\.csv, line \d, t: '[\d.,]+' is not a number$"):
            read(tmp_path, wrong, delimiter=";", **keys)


@pytest.mark.parametrize(
    ("encoding", "note"),
    [("latin-1", "read as Latin-1, as it is not UTF-8"), ("utf-16", "read as UTF-16, as it is not UTF-8")],
)
def test_other_encodings_are_read(tmp_path: Path, encoding: str, note: str) -> None:
    data = TABLE.replace("note", "T, °C".replace(",", "")).replace("yaw", "yäw")
    rpy = {"columns": ["roll", "pitch", "yäw"], "unit": "deg"}
    channel = read(tmp_path, data.encode(encoding), rpy=rpy)
    assert yaw(channel) == WHOLE and channel.notes == (note,)
    assert read(tmp_path, data, rpy=rpy).notes == ()


def test_lines_above_and_below_the_names_are_skipped(tmp_path: Path) -> None:
    names, rows = TABLE.split("\n", 1)
    data = f"Capture Frame Rate,120\nExported,today\n{names}\ns,deg,deg,deg,-\n{rows}"
    channel = read(tmp_path, data, skip=[1, 2, 4])
    assert yaw(channel) == WHOLE and channel.notes == ("lines skipped: 3",) and channel.rows == 6
    assert yaw(read(tmp_path, f"a\nb\n{TABLE}", skip=2)) == WHOLE
    with pytest.raises(LogError, match=r"a\.csv: no line names the columns: all are comments, skipped or empty$"):
        read(tmp_path, TABLE, skip=99)
    for wrong in (0, -1, [0], [1.5], True, "2"):
        with pytest.raises(LogError, match=r"^map: attitude\.skip: .* is neither a count of first lines nor a list"):
            read(tmp_path, TABLE, skip=wrong)


def test_comments_are_skipped_and_may_hold_the_names(tmp_path: Path) -> None:
    first, second, rest = TABLE.split("\n", 2)
    channel = read(tmp_path, f"# dive 3\n{first}\n# armed\n{second}\n{rest}")
    assert yaw(channel) == WHOLE and channel.notes == ("lines of comments: 2",)
    assert yaw(read(tmp_path, f"# {TABLE}")) == WHOLE
    assert yaw(read(tmp_path, f"%{TABLE}", comment="%")) == WHOLE
    with pytest.raises(LogError, match=r"a\.csv: t: no such column; columns: %t, roll, "):
        read(tmp_path, f"%{TABLE}")


def test_files_that_are_no_text_are_refused(tmp_path: Path) -> None:
    for name, extra, hint in (
        ("a.BIN", {"message": "ATT"}, "not ArduPilot's .BIN"),
        ("a.tlog", {"message": "ATTITUDE"}, "no MAVLink messages"),
        ("a.ulg", {"message": "vehicle_attitude"}, ""),
        ("a.csv", {"time": {"column": "t"}}, "not a text file"),
    ):
        (tmp_path / name).write_bytes(b"\xa3\x95\x00\x00\x00\x01,\n1,2\n")
        with pytest.raises(LogError, match=rf"{name}: cannot be read: .*{hint}") as raised:
            Log.read(tmp_path, {"attitude": {"file": name, "rpy": RPY, **extra}})
        assert "\n" not in str(raised.value)


def test_stamps_out_of_order_are_refused_sorted_or_dropped(tmp_path: Path) -> None:
    data = TABLE.replace("0.2,", "0.25,").replace("0.3,", "0.05,")
    with pytest.raises(
        LogError, match=r'line 5: .* 0\.05 is before .* 0\.25; time\.backwards = "sort" or "drop" allow'
    ):
        read(tmp_path, data)
    channel = read(tmp_path, data, {"backwards": "sort"})
    assert channel.time.tolist() == [0.0, 0.05, 0.1, 0.25, 0.4, 0.5]
    assert yaw(channel) == [WHOLE[k] for k in (0, 3, 1, 2, 4, 5)]
    assert channel.notes == ("rows sorted by their stamps: 1",)
    channel = read(tmp_path, data, {"backwards": "drop"})
    assert yaw(channel) == [WHOLE[k] for k in (0, 1, 2, 4, 5)]
    assert channel.dropped == {"rows out of order": 1, "equal stamps": 0} and channel.notes == ()
    with pytest.raises(LogError, match=r"^map: attitude\.time\.backwards: 'keep' is none of refuse, sort, drop$"):
        read(tmp_path, data, {"backwards": "keep"})


def test_a_curve_gives_the_thrust_of_pulses(tmp_path: Path) -> None:
    pulses = np.array([0.0, 1050.0, 1100.0, 1300.0, 1480.0, 1500.0, 1600.0, 1900.0])
    write_table(tmp_path / "out.csv", {"t": np.arange(8.0), "C1": pulses})
    curve = [[0, 0], [1099, 0], [1100, -36.8], [1470, -0.4], [1480, 0], [1530, 0], [1700, 17.9], [1900, 50.4]]
    axis = {"command": "C1", "curve": curve}
    found = {"file": "out.csv", "time": {"column": "t"}, "axes": {"left": axis}, "gap": 2.0}
    command = Log.read(tmp_path, {"thrusters": found}).thrusters.command[:, 0]
    assert np.allclose(command, np.interp(pulses, *np.transpose(curve))) and command[0] == command[5] == 0.0
    axis["scale"] = 0.5
    assert np.allclose(Log.read(tmp_path, {"thrusters": found}).thrusters.command[:, 0], 0.5 * command)
    axis["curve"] = curve[1:]
    with pytest.raises(LogError, match=r"out\.csv, line 3: C1 is 1050, outside of the curve of left, 1099 to 1900$"):
        Log.read(tmp_path, {"thrusters": found})
    for wrong in ([[1100, 0]], [[1, 2], [1, 3]], [[1, 2, 3], [2, 3, 4]], "t999", [[1, "a"], [2, 3]], [[1], [2, 3]]):
        axis["curve"] = wrong
        with pytest.raises(LogError, match=r"^map: thrusters\.axes\.left\.curve: .* is no list of at least two points"):
            Log.read(tmp_path, {"thrusters": found})
    with pytest.raises(LogError, match=r"^map: thrusters\.axes\.left: curve or neutral, not both$"):
        Log.read(tmp_path, {"thrusters": found | {"axes": {"left": axis | {"neutral": 1500}}}})


def test_remarks_are_one_line_for_each_reason_over_all_trials(tmp_path: Path) -> None:
    motion = Motion.random()
    for name in "ab":
        found = write_logs(tmp_path, motion, trial=name)
        path = tmp_path / f"{name}_imu.csv"
        lines = path.read_text().splitlines()
        lines[7] = lines[7].replace(lines[7].split(",")[2], "nan")
        path.write_text("\n".join([*lines[:9], "# surfaced", *lines[9:]]))
    logs = Log.read_all(tmp_path, found)
    assert remarks(logs) == [
        "imu: 2 of 60 rows left out: lost frames",
        "imu: lines of comments: 1 (2 of 2 trials)",
    ]
    assert "  imu: 29 samples" in logs[0].summary() and "left out: 1 lost frames; lines" in logs[0].summary()


Entries = tuple[float, float, tuple[str, ...], tuple[float, ...]]


def joint_states(path: Path, messages: list[Entries]) -> Path:
    """Write a bag of joint states: time of recording, stamp, names and positions of each."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, kind = store.types, "sensor_msgs/msg/JointState"
    with Writer(path, version=9) as bag:
        connection = bag.add_connection("/joint_states", kind, typestore=store)
        for recorded, stamp, names, position in messages:
            ns = round(stamp * 1e9)
            time = types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
            header = types["std_msgs/msg/Header"](stamp=time, frame_id="")
            none = np.empty(0)
            message = types[kind](
                header=header, name=list(names), position=np.array(position), velocity=none, effort=none
            )
            bag.write(connection, round(recorded * 1e9), store.serialize_cdr(message, kind))
    return path


def read_joints(path: Path, names: str = "a", **keys: Any) -> Any:
    axes = {name: {"position": f"position[{name}]"} for name in names}
    return Log.read(path, {"joints": {"topic": "/joint_states", "axes": axes, **keys}}).joints


TIMES = [100.0 + k / 10 for k in range(8)]


def test_messages_of_another_publisher_are_left_out_and_counted(tmp_path: Path) -> None:
    bag = joint_states(tmp_path / "bag", [(t, t, ("ac"[k % 2],), (float(k),)) for k, t in enumerate(TIMES)])
    joints = read_joints(bag)
    assert joints.position[:, 0].tolist() == [0.0, 2.0, 4.0, 6.0] and joints.time.tolist() == TIMES[::2]
    assert joints.rows == 8 and joints.dropped == {"messages of others": 4, "equal stamps": 0}
    with pytest.raises(LogError, match=r"/joint_states: position\[b\]: no message has this name; names: a, c$"):
        read_joints(bag, "ab")


def test_joints_of_several_publishers_become_one_channel(tmp_path: Path) -> None:
    arm = [(t, t, ("b", "a"), (10.0 * t, t)) for t in np.arange(20.0, 22.0, 0.05)]
    hand = [(t, t, ("c",), (3.0 * t,)) for t in np.r_[np.arange(20.22, 20.8, 0.1), np.arange(21.52, 21.8, 0.1)]]
    joints = read_joints(joint_states(tmp_path / "bag", sorted(arm + hand)), "abc")
    t = joints.time
    assert np.allclose(joints.position, np.stack([t, 10.0 * t, 3.0 * t], axis=-1), rtol=1e-12)
    # The hand is silent for 0.8 s, longer than the gap, and at both ends.
    covered = ((t >= 20.22) & (t <= 20.72)) | ((t >= 21.52) & (t <= 21.72))
    assert covered.all() and len(t) == 14
    assert joints.notes == ("position[c] interpolated at the messages of position[a]",)
    assert joints.rows == len(arm + hand) and joints.dropped["lost frames"] == len(arm) - 14


def test_stamps_of_zero_are_named(tmp_path: Path) -> None:
    messages: list[Entries] = [(t, 0.0, ("a",), (float(k),)) for k, t in enumerate(TIMES)]
    joints = read_joints(joint_states(tmp_path / "zero", messages))
    assert np.allclose(joints.time, TIMES, rtol=0.0, atol=1e-9)
    assert joints.notes == ("times of recording, as the header's stamps are all 0",)
    with pytest.raises(LogError, match=r'the header\'s stamps are all 0; stamp = "bag" reads the times of recording$'):
        read_joints(tmp_path / "zero", time={"stamp": "header"})
    messages[2:] = [(t, t - 0.1, names, value) for t, _, names, value in messages[2:]]
    joints = read_joints(joint_states(tmp_path / "two", messages))
    assert np.allclose(joints.time, [t - 0.1 for t in TIMES[2:]])
    assert joints.dropped == {"unstamped messages": 2, "equal stamps": 0} and joints.notes == ()


def test_lost_and_late_messages_are_as_of_tables(tmp_path: Path) -> None:
    messages: list[Entries] = [(t, t, ("a",), (float(k),)) for k, t in enumerate(TIMES)]
    messages[3] = (*messages[3][:3], (np.nan,))
    messages[5] = (messages[5][0], messages[5][1] - 0.15, *messages[5][2:])
    bag = joint_states(tmp_path / "bag", messages)
    with pytest.raises(LogError, match=r"/joint_states, message 6: the stamp 100\.35 is before .* 100\.4; time\.back"):
        read_joints(bag)
    joints = read_joints(bag, time={"backwards": "drop"})
    assert joints.position[:, 0].tolist() == [0.0, 1.0, 2.0, 4.0, 6.0, 7.0]
    assert joints.dropped == {"lost frames": 1, "rows out of order": 1, "equal stamps": 0}
    assert read_joints(bag, time={"backwards": "sort"}).position[:, 0].tolist() == [0.0, 1.0, 2.0, 5.0, 4.0, 6.0, 7.0]


def test_a_type_without_definition_is_named(tmp_path: Path) -> None:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("float64 x", "our_msgs/msg/Depth"))
    with Writer(tmp_path / "bag", version=9) as bag:
        connection = bag.add_connection("/depth", "our_msgs/msg/Depth", typestore=store)
        for k in range(3):
            message = store.types["our_msgs/msg/Depth"](x=float(k))
            bag.write(connection, k * 10**8, store.serialize_cdr(message, "our_msgs/msg/Depth"))
    found = {"joints": {"topic": "/depth", "axes": {"a": {"position": "x"}}}}
    assert Log.read(tmp_path / "bag", found).joints.position[:, 0].tolist() == [0.0, 1.0, 2.0]
    with contextlib.closing(sqlite3.connect(next((tmp_path / "bag").glob("*.db3")))) as data, data:
        data.execute("delete from message_definitions")
    with pytest.raises(LogError, match=r"bag: /depth: the bag has no definition of our_msgs/msg/Depth; `ros2 bag rec"):
        Log.read(tmp_path / "bag", found)


def test_the_motion_remains_where_frames_are_lost(tmp_path: Path) -> None:
    motion = Motion.random(n=200)
    found = write_logs(tmp_path, motion)
    lost = np.random.default_rng(1).random(200) < 0.2
    path = tmp_path / "1_pose.csv"
    lines = path.read_text().splitlines()
    for row in np.flatnonzero(lost):
        cells = lines[row + 1].split(",")
        lines[row + 1] = ",".join([cells[0], *(len(cells) - 1) * [""]])
    path.write_text("\n".join(lines))
    kept = replace(motion, time=motion.time[~lost], position=motion.position[~lost])
    pose = Log.read(tmp_path, {"pose": found["pose"]}, "1").pose
    assert np.array_equal(pose.time, kept.time) and np.array_equal(pose.position, kept.position)
    assert pose.dropped["lost frames"] == np.sum(lost)
