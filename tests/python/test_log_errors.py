"""Errors of logs and maps: one line with place, value and what is allowed; nothing is half-read."""

import contextlib
import copy
import os
import re
import sqlite3
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_files import Motion, write_bag, write_logs

from uvms_gym import Log, LogError, LogMap
from uvms_gym.logs import ros2, tables

POOL = Path(__file__).parents[1] / "data" / "pool"
FUZZ = settings(max_examples=int(os.environ.get("UVMS_FUZZ", "100")))

Lines = list[list[str]]
Edit = Callable[[Lines], object]


@pytest.fixture
def log(tmp_path: Path) -> tuple[Path, dict[str, Any]]:
    return tmp_path, write_logs(tmp_path, Motion.random())


def refuse(error: str, *arguments: Any, read: Callable[..., Any] = Log.read, **keywords: Any) -> None:
    """Check that reading raises an error of one line that matches."""
    with pytest.raises(LogError, match=error) as raised:
        read(*arguments, **keywords)
    assert "\n" not in str(raised.value)


def set_key(table: dict[str, Any], path: str, value: Any) -> None:
    """Set the value at a path of keys, or remove it for None."""
    *parents, key = path.split(".")
    for parent in parents:
        table = table.setdefault(parent, {})
    if value is None:
        del table[key]
    else:
        table[key] = value


def edit(path: Path, change: Edit) -> None:
    """Change the cells of a table."""
    cells = [line.split(",") for line in path.read_text().splitlines()]
    change(cells)
    path.write_text("\n".join(map(",".join, cells)))


def put(row: int, column: int, cell: str) -> Edit:
    return lambda cells: cells[row].__setitem__(column, cell)


COLUMNS = "t, x, y, z, qw, qx, qy, qz, frame"


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (lambda cells: cells.clear(), ": the file is empty"),
        (lambda cells: cells.__delitem__(slice(1, None)), ": no rows of numbers"),
        (put(0, 2, "north"), f": y: no such column; columns: {COLUMNS.replace('y,', 'north,', 1)}"),
        (put(0, 3, "y"), f": y: a column of this name exists twice; columns: {COLUMNS.replace('z,', 'y,', 1)}"),
        (put(4, 2, "abc"), ", line 5, y: 'abc' is not a number"),
        (put(4, 2, "1_0"), ", line 5, y: '1_0' is not a number"),
        (put(4, 2, "inf"), ", line 5, y: inf is not a finite number"),
        (
            lambda cells: [put(k, 2, "nan")(cells) for k in range(2, len(cells))],
            ": 1 of 30 rows remain, at least 2 must; left out: 29 lost frames",
        ),
        (put(4, 0, "-inf"), ", line 5, t: -inf is not a finite number"),
        (put(4, 0, "1e999"), ", line 5, t: inf is not a finite number"),
        (lambda cells: cells[-2].pop(), ", line 30: 8 columns, but the first line has 9"),
        (lambda cells: cells[3].append("0"), ", line 4: 10 columns, but the first line has 9"),
        (lambda cells: cells.insert(3, ["", "0"]), ", line 4: 2 columns, but the first line has 9"),
        (put(4, 0, "1.5"), ", line 5: the stamp 1.5 is before the stamp of the row above, 2.0979"),
        (put(4, 4, "2.0"), ", line 5: the quaternion has norm 2.0"),
        (
            lambda cells: [put(k, 0, "3.0")(cells) for k in range(1, len(cells))],
            ": 1 of 30 rows remain, at least 2 must; left out: 29 equal stamps",
        ),
    ],
)
def test_errors_of_tables_name_file_and_line(log: tuple[Path, dict[str, Any]], change: Edit, error: str) -> None:
    folder, found = log
    edit(folder / "1_pose.csv", change)
    refuse("^" + re.escape(f"{folder}/1_pose.csv{error}"), folder, found, "1")


def test_columns_that_the_map_does_not_name_may_hold_anything(log: tuple[Path, dict[str, Any]]) -> None:
    folder, found = log
    before = Log.read(folder, found, "1").pose
    edit(folder / "1_pose.csv", put(4, 8, '"a ""b"", c"'.replace(",", ";")))
    edit(folder / "1_pose.csv", put(5, 8, "nan"))
    text = (folder / "1_pose.csv").read_text()
    (folder / "1_pose.csv").write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode() + b"\r\n\r\n")
    assert np.array_equal(Log.read(folder, found, "1").pose.position, before.position)
    (folder / "1_pose.csv").write_text(text.replace('"a ""b""; c"', '"a, b"'))
    assert np.array_equal(Log.read(folder, found, "1").pose.position, before.position)


def test_a_quoted_cell_may_go_on_in_the_next_line_but_is_no_number_then(log: tuple[Path, dict[str, Any]]) -> None:
    folder, found = log
    before = Log.read(folder, found, "1").pose
    edit(folder / "1_pose.csv", put(3, 8, '"a\nb"'))
    assert np.array_equal(Log.read(folder, found, "1").pose.position, before.position)
    text = (folder / "1_pose.csv").read_text()
    cell = text.split("\n")[6].split(",")[0]
    (folder / "1_pose.csv").write_text(text.replace(f"\n{cell},", '\n"1\n2",'))
    refuse(r"1_pose.csv, line 7, \w+: '1\\n2' is not a number$", folder, found, "1")


def test_pipes_and_devices_are_not_opened(log: tuple[Path, dict[str, Any]]) -> None:
    folder, found = log
    (folder / "1_imu.csv").unlink()
    os.mkfifo(folder / "1_imu.csv")
    refuse(r"1_imu.csv: cannot be read: not a regular file$", folder, found, "1")
    refuse(r"^/dev/zero: cannot be read: not a regular file$", folder, "/dev/zero", "1")
    bag = write_bag(folder / "bag", Motion.random())
    (folder / "bag" / "bag.db3").unlink()
    os.mkfifo(folder / "bag" / "bag.db3")
    refuse(r"bag.db3: cannot be read: not a regular file$", folder / "bag", bag)


def test_files_are_refused_by_size_before_they_are_read(
    log: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, found = log
    monkeypatch.setattr(tables, "MAX_BYTES", 100)
    refuse(r"cannot be read: \d+ bytes, but at most 100 are read$", folder, found, "1")
    bag = write_bag(folder / "bag", Motion.random())
    monkeypatch.setattr(ros2, "_MESSAGES", 10)
    refuse(r"bag: \d+ messages in these topics, but at most 10 are read$", folder / "bag", bag)
    monkeypatch.setattr(ros2, "_BYTES", 100)
    refuse(r"bag: \d+ bytes, but at most 100 are read$", folder / "bag", bag)


def test_files_that_cannot_be_read_are_named(log: tuple[Path, dict[str, Any]]) -> None:
    folder, found = log
    (folder / "1_imu.csv").write_bytes(b"\xff\xfe\x00\xd8,\x00")
    refuse(r"1_imu.csv: cannot be read: 'utf-16-le' codec can't decode", folder, found, "1")
    (folder / "1_imu.csv").unlink()
    refuse(r"1_imu.csv: no such file$", folder, found, "1")
    refuse(r"1_imu.csv: no such file$", folder, found, read=Log.read_all)
    refuse(r"nowhere: no such directory$", folder / "nowhere", found, read=Log.read_all)
    found["imu"]["file"] = "other_{trial}.csv"
    refuse(r"no file is named other_{trial}.csv$", folder, {"imu": found["imu"]}, read=Log.read_all)


@pytest.mark.parametrize(
    ("keys", "error"),
    [
        ({"start": 9.0}, r"1: no samples between start 9 and end 3.\d+ s; pose 2.\d+ to 3.\d+ s; "),
        ({"start": {"position": "z", "above": 1e9}}, "1: no samples between start inf and end "),
        ({"end": {"file": "none.yml", "key": "end"}}, "none.yml: no such file$"),
        ({"end": {"file": "meta.yml", "key": "end"}}, "meta.yml: end: no such key; keys: start, stop$"),
        ({"end": {"file": "meta.yml", "key": "stop"}}, "meta.yml: stop: 'soon' is not a finite number$"),
    ],
)
def test_starts_and_ends_are_checked(log: tuple[Path, dict[str, Any]], keys: dict[str, Any], error: str) -> None:
    folder, found = log
    (folder / "meta.yml").write_text("start: 1.0\nstop: soon\n")
    refuse(error, folder, found | keys, "1")


def test_trials_are_named_where_files_are(log: tuple[Path, dict[str, Any]]) -> None:
    folder, found = log
    refuse(r"^map: the name of the trial is missing$", folder, found)
    found = {"imu": found["imu"] | {"file": "1_imu.csv"}}
    refuse(r"^map: the name of the trial is given, but no file's name has {trial}$", folder, found, "1")


@pytest.mark.parametrize(
    ("path", "value", "error"),
    [
        ("imu.axis", "x", "imu.axis: unknown key; known: file, topic, time, "),
        ("gps", {}, "gps: unknown key; known: gap, bag, clock, start, end, pose, attitude, twist, imu, joints, "),
        ("imu", 3, "imu: 3 is not a table"),
        ("imu.file", None, "imu: file or topic is missing"),
        ("imu.topic", "/imu", "imu: file or topic, not both"),
        ("imu.file", 3, "imu.file: 3 is not a text"),
        ("imu.time", None, "imu.time: column is missing"),
        ("imu.time.unit", "min", "imu.time.unit: 'min' is none of s, ms, us, ns"),
        ("imu.time.lag", "0.1", "imu.time.lag: '0.1' is not a number"),
        ("imu.time.lag", float("nan"), "imu.time.lag: nan is not a finite number"),
        ("imu.time.stamp", "bag", "imu.time.stamp: unknown key; known: column, unit, lag"),
        ("imu.gap", 0, "imu.gap: 0 must be > 0"),
        ("imu.gap", True, "imu.gap: True is not a number"),
        ("imu.jump_deg", -1.0, "imu.jump_deg: -1.0 must be > 0"),
        ("twist.jump_deg", 1.0, "twist.jump_deg: unknown key; known: "),
        ("imu.repeat_period", 0.1, "imu.repeat_period: unknown key; known: "),
        ("imu.body", "ned", "imu.body: 'ned' is none of flu, frd"),
        ("imu.world", "wnu", "imu.world: 'wnu' is none of nwu, enu, ned"),
        ("imu.delimiter", "ab", "imu.delimiter: 'ab' is none of ',', ';', '|', a tab and a space"),
        ("imu.angular_velocity", None, "imu: angular_velocity is missing"),
        ("imu.angular_velocity.columns", ["a", "b"], "imu.angular_velocity.columns: 2 columns, but must be 3"),
        ("imu.angular_velocity.columns", 3 * ["a"], "imu.angular_velocity.columns: ['a', 'a', 'a'] has a column twice"),
        ("imu.angular_velocity.columns", "abc", "imu.angular_velocity.columns: 'abc' is not a list of texts"),
        ("imu.angular_velocity.unit", "rad", "imu.angular_velocity.unit: 'rad' is none of rad/s, deg/s"),
        ("imu.quaternion.order", None, "imu.quaternion: order is missing"),
        ("imu.quaternion.order", "zyxw", "imu.quaternion.order: 'zyxw' is none of wxyz, xyzw"),
        ("imu.rpy", {}, "imu: quaternion or rpy, not both"),
        ("pose.quaternion", None, "pose: quaternion or rpy is missing"),
        ("joints.axes", None, "joints.axes: a table with the columns of the scene's joints by name is expected"),
        ("joints.axes.elbow.sign", 2, "joints.axes.elbow.sign: 2 is neither 1 nor -1"),
        ("joints.axes.elbow.velocity", None, "joints.axes.elbow: velocity is missing; all joints have one or none"),
        ("joints.axes.elbow.position", None, "joints.axes.elbow: position or value is missing"),
        ("joints.axes.elbow.value", 1.0, "joints.axes.elbow: position or value, not both"),
        ("joints.axes.jaw", {"value": 0}, "joints.axes.jaw: the scene has no such joint; joints: shoulder, upper-arm"),
        ("joints.axes.elbow", None, "joints.axes: elbow is missing; value = 0.0 declares a constant"),
        ("thrusters.axes.left.scale", 0, "thrusters.axes.left.scale: 0 is not allowed"),
        ("thrusters.axes.left.value", 0, "thrusters.axes.left: command or value, not both"),
        ("thrusters", {"topic": "/t", "axes": {"left": {"command": "data[0]"}}},
         "thrusters.axes.left: the scene has no such thruster; thrusters: front-right, "),
        ("bag", "b", "bag: no channel has a topic"),
        ("clock", "unix", "clock: 'unix' is none of stamps, first"),
        ("start", {"position": "w"}, "start.position: 'w' is none of x, y, z"),
        ("end", {"position": "z"}, "end: above or below is missing"),
        ("end", {"file": "x.yml"}, "end: key is missing"),
        ("end", "late", "end: 'late' is not a number"),
        ("trial.1", 3, "trial.1: 3 is not a table"),
        ("trial.2", {"imu": {"gap": -1}}, 'map with [trial."2"]: imu.gap: -1 must be > 0'),
    ],
)  # fmt: skip
def test_errors_of_maps_name_the_key(log: tuple[Path, dict[str, Any]], path: str, value: Any, error: str) -> None:
    folder, found = log
    if not path.startswith("thrusters.axes"):
        del found["thrusters"]
    set_key(found, path, value)
    start = "^" if error.startswith("map with") else "^map: "
    refuse(start + re.escape(error), folder, found, "1", scene="bluerov2-heavy-alpha5")


def test_maps_without_channels_or_poses_are_refused(log: tuple[Path, dict[str, Any]]) -> None:
    refuse(r"^map: no channel; known: pose, attitude, twist, imu, joints, thrusters, battery$", {}, read=LogMap.read)
    found = {"imu": log[1]["imu"], "end": {"position": "z", "below": 0.0}}
    refuse(r"^map: a start or an end by position needs the channel pose$", found, read=LogMap.read)


def test_jumps_need_an_attitude(log: tuple[Path, dict[str, Any]]) -> None:
    folder, found = log
    found["imu"]["jump_deg"] = 170.0
    Log.read(folder, found, "1")
    del found["imu"]["quaternion"]
    refuse(r"^map: imu.jump_deg: unknown key; known: ", folder, found, "1")


def test_map_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    refuse(r"none.toml: no such file$", tmp_path / "none.toml", read=LogMap.read)
    (tmp_path / "map.toml").write_text("[pose\n")
    refuse(r"map.toml: cannot be read: .*line 1", tmp_path / "map.toml", read=LogMap.read)
    (tmp_path / "map.toml").write_text('[pose]\nfile = "a.csv"\n')
    refuse(r"map.toml: pose.time: column is missing$", tmp_path, str(tmp_path / "map.toml"))


@pytest.mark.parametrize(
    ("path", "value", "error"),
    [
        ("pose.topic", "/gps", ": pose: no topic /gps; topics: /imu, /joint_states, /odometry, /pose, /pose_cov, "),
        ("pose.topic", "/joint_states", " /joint_states: no field for position; the map names columns, of: header."),
        (
            "imu.specific_force",
            {"columns": list("abc")},
            " /imu, message 1: a: no such number; fields: header.stamp.sec, ",
        ),
        ("imu.time", {"column": "header.stamp.nanosec"}, " /imu, message 26: the stamp "),
        ("joints.axes.elbow.position", "position[jaw]", " /joint_states: position[jaw]: no message has this name; "),
        ("joints.axes.elbow.position", "position[", " /joint_states, message 1: position[: no such number; "),
        ("joints.axes.elbow.position", "name", " /joint_states, message 1: name: no such number; "),
        ("thrusters.axes.left.command", "data[7]", " /thrusters, message 1: data[7]: no such number; fields: "),
        ("thrusters.time", {"stamp": "header"}, ' /thrusters: no header; stamp = "bag" reads the times of recording'),
    ],
)
def test_errors_of_bags_name_topic_and_field(tmp_path: Path, path: str, value: Any, error: str) -> None:
    found = write_bag(tmp_path / "bag", Motion.random())
    set_key(found, path, value)
    refuse("^" + re.escape(f"{tmp_path}/bag{error}"), tmp_path / "bag", found)


def test_a_topic_without_messages_is_named(tmp_path: Path) -> None:
    found = write_bag(tmp_path / "bag", Motion.random())
    with contextlib.closing(sqlite3.connect(tmp_path / "bag" / "bag.db3")) as data, data:
        data.execute("delete from messages where topic_id in (select id from topics where name = '/imu')")
    refuse(r"bag /imu: no messages$", tmp_path / "bag", found)


def test_bags_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    found = write_bag(tmp_path / "bag", Motion.random())
    refuse(r"none: no such bag$", tmp_path / "none", found)
    (tmp_path / "bag" / "bag.db3").write_bytes(b"no database" * 100)
    refuse(r"bag: cannot be read: .*not a database", tmp_path / "bag", found)
    (tmp_path / "bag" / "metadata.yaml").write_text("nothing")
    refuse(r"bag: cannot be read: ", tmp_path / "bag", found)


cells = st.sampled_from(
    ["", "nan", "1e999", "-1", "0", "1", '"', '"1"', "x", "1;2", "\x00", "0x1", "\uff11", "\t", "1\n", "\r"]
)


@FUZZ
@given(data=st.data())
def test_tables_of_any_content_read_whole_or_not_at_all(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("log")
    found = write_logs(folder, Motion.random(n=5))
    path = folder / f"1_{data.draw(st.sampled_from(sorted(found)))}.csv"
    if data.draw(st.booleans()):
        rows = [line.split(",") for line in path.read_text().splitlines()]
        for _ in range(data.draw(st.integers(1, 3))):
            row = data.draw(st.sampled_from(rows))
            row[data.draw(st.integers(0, len(row) - 1))] = data.draw(cells)
        path.write_text("\n".join(map(",".join, rows)), newline="")
    else:
        content = path.read_bytes()
        cut, end = sorted(data.draw(st.tuples(*2 * [st.integers(0, len(content))])))
        path.write_bytes(content[:cut] + data.draw(st.binary(max_size=9)) + content[end:])
    found[data.draw(st.sampled_from(["pose", "attitude", "imu"]))]["jump_deg"] = 20.0
    found["joints"]["repeat_period"] = 0.1
    try:
        log = Log.read(folder, found, "1")
    except LogError as error:
        assert "\n" not in str(error)
        return
    for channel in log.channels.values():
        assert all(np.isfinite(value).all() for value in vars(channel).values() if isinstance(value, np.ndarray))
        assert np.all(np.diff(channel.time) > 0.0)


#: Map of the pool trials, with every kind of key.
MAP: dict[str, Any] = tomllib.loads((POOL / "map.toml").read_text())
MAP |= {"thrusters": {"topic": "/t", "axes": {"a": {"command": "data[0]"}}}, "bag": "{trial}", "gap": 1.0}
values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-3, 3)
    | st.floats()
    | st.sampled_from(["", "z", "ned", "x.csv", "{trial}", "s"]),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["columns", "unit", "file", "z"]), inner)
    ),
    max_leaves=6,
)


@FUZZ
@given(data=st.data())
def test_maps_of_any_content_read_or_raise_a_log_error(data: st.DataObject) -> None:
    found = copy.deepcopy(MAP)
    for _ in range(data.draw(st.integers(1, 3))):
        table = found
        while True:
            key = data.draw(st.sampled_from(sorted(table)))
            if isinstance(table[key], dict) and table[key] and data.draw(st.booleans()):
                table = table[key]
                continue
            break
        change = data.draw(st.sampled_from(["value", "remove", "rename"]))
        old = table.pop(key)
        if change != "remove":
            table[key if change == "value" else key + "s"] = data.draw(values) if change == "value" else old
        if not found:
            break
    try:
        LogMap.read(found)
    except LogError as error:
        assert "\n" not in str(error)
