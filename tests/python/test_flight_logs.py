"""Logs of autopilots: MAVLink's .tlog and ArduPilot's .BIN, made with pymavlink, and PX4's .ulg by its format."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.DFReader import DFFormat
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from uvms_gym import Log, LogError

N = 12
TIME = 1_700_000_000.0 + 0.1 * np.arange(N)
RPY = np.array([0.1, -0.2, 0.5]) + 0.01 * np.arange(N)[:, None]
PULSE = 1500 + 10 * np.arange(N)


def packets(signed: bool = False) -> list[bytes]:
    """Stamped MAVLink packets: an attitude and the outputs at each instant, and the attitudes of another system."""
    ours, theirs = mavlink.MAVLink(None, srcSystem=1), mavlink.MAVLink(None, srcSystem=9)
    ours.signing.secret_key, ours.signing.sign_outgoing = bytes(32), signed
    found = []
    for k in range(N):
        stamp = struct.pack(">Q", round(TIME[k] * 1e6))
        outputs = [int(PULSE[k]), 1500, *[0] * 14]
        for sender, message in (
            (ours, mavlink.MAVLink_attitude_message(100 * k, *RPY[k], 0.0, 0.0, 0.0)),
            (theirs, mavlink.MAVLink_attitude_message(100 * k, 3.0, 1.0, 2.0, 0.0, 0.0, 0.0)),
            (ours, mavlink.MAVLink_servo_output_raw_message(100_000 * k, 0, *outputs)),
            (ours, mavlink.MAVLink_vision_speed_estimate_message(0, k, 0.0, 0.0, covariance=list(range(9)))),
        ):
            found.append(stamp + bytes(message.pack(sender)))
    return found


def tlog(path: Path, found: list[bytes]) -> Path:
    (path / "dive.tlog").write_bytes(b"".join(found))
    return path


ATTITUDE = {
    "file": "dive.tlog",
    "message": "ATTITUDE",
    "rpy": {"columns": ["roll", "pitch", "yaw"]},
    "world": "ned",
    "body": "frd",
}
THRUSTERS = {"file": "dive.tlog", "message": "SERVO_OUTPUT_RAW", "axes": {"a": {"command": "servo1_raw"}}}


def turned(rpy: np.ndarray) -> np.ndarray:
    """Attitudes [w, x, y, z] in the library's axes of angles from ned to frd."""
    flip = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    return (flip * Rotation.from_euler("ZYX", rpy[:, ::-1]) * flip).as_quat(canonical=True)[:, [3, 0, 1, 2]]


@pytest.mark.parametrize("signed", [False, True])
def test_a_tlog_is_read(tmp_path: Path, signed: bool) -> None:
    log = Log.read(tlog(tmp_path, packets(signed)), {"attitude": ATTITUDE, "thrusters": THRUSTERS})
    assert np.allclose(log.attitude.quaternion, turned(RPY), rtol=0.0, atol=1e-7)
    assert np.array_equal(log.attitude.time, np.round(TIME * 1e6) * 1e-6)
    assert log.thrusters.command[:, 0].tolist() == PULSE.tolist() and log.thrusters.rows == N
    assert log.attitude.dropped == {"messages of others": N, "equal stamps": 0} and log.attitude.notes == ()
    other = Log.read(
        tmp_path, {"attitude": ATTITUDE | {"instance": 9, "time": {"column": "time_boot_ms", "unit": "ms"}}}
    )
    assert np.allclose(other.attitude.quaternion, turned(np.tile([3.0, 1.0, 2.0], (N, 1))), rtol=0.0, atol=1e-7)
    assert np.allclose(other.attitude.time, 0.1 * np.arange(N))
    speed = {"velocity": {"columns": ["x", "covariance[1]", "covariance[8]"]}, "file": "dive.tlog"}
    twist = Log.read(tmp_path, {"twist": speed | {"message": "VISION_SPEED_ESTIMATE"}}).twist
    assert np.allclose(twist.velocity, [[k, 1.0, 8.0] for k in range(N)])


def test_first_generation_packets_of_a_tlog_are_read(tmp_path: Path) -> None:
    from pymavlink.dialects.v10 import ardupilotmega as old

    sender = old.MAVLink(None, srcSystem=1)
    found = [
        struct.pack(">Q", round(TIME[k] * 1e6))
        + bytes(old.MAVLink_servo_output_raw_message(0, 0, int(PULSE[k]), *[0] * 7).pack(sender))
        for k in range(N)
    ]
    assert found[0][8] == 0xFE
    assert Log.read(tlog(tmp_path, found), {"thrusters": THRUSTERS}).thrusters.command[:, 0].tolist() == PULSE.tolist()


@pytest.mark.parametrize(
    ("title", "left", "errors"),
    [("bit", [3], 1), ("length", [3], 1), ("cut", [3, 4], 1), ("noise", [], 1), ("end", [11], 1)],
)
def test_damaged_packets_are_left_out_and_counted(tmp_path: Path, title: str, left: list[int], errors: int) -> None:
    found = [packet for k, packet in enumerate(packets()) if k % 4 == 2]
    if title == "bit":
        found[3] = found[3][:25] + bytes([found[3][25] ^ 1]) + found[3][26:]
    if title == "length":
        found[3] = found[3][:9] + b"\xf0" + found[3][10:]
    if title == "cut":
        found[3] = found[3][:20]
        found[4] = found[4][14:]
    if title == "noise":
        found[3] += np.random.default_rng(0).bytes(4000)
    if title == "end":
        found[-1] = found[-1][:-5]
    thrusters = Log.read(tlog(tmp_path, found), {"thrusters": THRUSTERS}).thrusters
    assert thrusters.command[:, 0].tolist() == np.delete(PULSE, left).tolist()
    assert thrusters.notes == (f"CRC errors: {errors} messages of the file left out",)


def dataflash(path: Path, skip: int | None = None) -> Path:
    """Write a log of ArduPilot: outputs, attitudes, and accelerations of two IMUs, which the units name."""
    head = DFFormat(0x80, "FMT", 89, "BBnNZ", "Type,Length,Name,Format,Columns")
    formats = [
        DFFormat(1, "RCOU", 0, "QHHe", "TimeUS,C1,C2,Err"),
        DFFormat(2, "ATT", 0, "QccC", "TimeUS,Roll,Pitch,Yaw"),
        DFFormat(3, "IMU", 0, "QBfffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,Text"),
        DFFormat(4, "FMTU", 0, "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
        DFFormat(5, "ARR", 0, "QNa", "TimeUS,Name,Data"),
    ]

    def message(fmt: Any, *values: Any) -> bytes:
        return bytes([0xA3, 0x95, fmt.type]) + struct.pack(fmt.msg_struct, *values)

    data = b""
    for fmt in [head, *formats]:
        length, words = struct.calcsize(fmt.msg_struct) + 3, [fmt.name, fmt.format, ",".join(fmt.columns)]
        data += message(head, fmt.type, length, *(word.encode() for word in words))
    data += message(formats[3], 0, 3, b"s#-----", b"F------")
    for k in range(N):
        us = 100_000 * k
        part = message(formats[0], us, int(PULSE[k]), 1500, -250)
        data += part if k != skip else part[:9]
        data += message(formats[1], us, 1000 + k, -500, 27000)
        data += message(formats[2], us, 1, 0.5, 0.25, k, 9.75, 0.0)
        data += message(formats[2], us, 0, -0.5, 0.25, k, 9.75, 0.0)
        data += message(formats[4], us, b"name", struct.pack("<32h", *range(32)))
    (path / "00000001.BIN").write_bytes(data)
    return path


def bin_map(message: str, **keys: Any) -> dict[str, Any]:
    return {"file": "{trial}.BIN", "message": message, **keys}


OUTPUTS = bin_map("RCOU", axes={"a": {"command": "C1"}, "b": {"command": "Err"}})


def test_a_bin_is_read(tmp_path: Path) -> None:
    gyro = {"angular_velocity": {"columns": ["GyrX", "GyrY", "GyrZ"]}}
    found = {
        "thrusters": OUTPUTS,
        "attitude": bin_map("ATT", rpy={"columns": ["Roll", "Pitch", "Yaw"], "unit": "deg"}, world="ned", body="frd"),
        "imu": bin_map("IMU", instance=0, **gyro),
        "twist": bin_map("ARR", velocity={"columns": ["Data[0]", "Data[7]", "Data[31]"]}),
    }
    (log,) = Log.read_all(dataflash(tmp_path), found)
    assert log.name == "00000001" and np.allclose(log.thrusters.time, 0.1 * np.arange(N), rtol=0.0, atol=1e-12)
    assert log.thrusters.command.tolist() == [[pulse, -2.5] for pulse in PULSE]
    rpy = np.radians([[10.0 + 0.01 * k, -5.0, 270.0] for k in range(N)])
    assert np.allclose(log.attitude.quaternion, turned(rpy), rtol=0.0, atol=1e-12)
    assert log.imu.angular_velocity.tolist() == [[-0.5, 0.25, k] for k in range(N)]
    assert log.imu.rows == 2 * N and log.imu.dropped == {"messages of others": N, "equal stamps": 0}
    assert log.twist.velocity.tolist() == [[0.0, 7.0, 31.0]] * N
    first = Log.read_all(tmp_path, {"imu": bin_map("IMU", **gyro)})[0]
    assert first.imu.angular_velocity[:, 0].tolist() == [0.5] * N


def test_messages_cut_in_a_bin_are_left_out_and_counted(tmp_path: Path, capfd: Any) -> None:
    log = Log.read(dataflash(tmp_path, skip=5), {"thrusters": OUTPUTS}, "00000001")
    assert log.thrusters.command[:, 0].tolist() == np.delete(PULSE, 5).tolist()
    assert log.thrusters.dropped == {"damaged messages": 1, "equal stamps": 0} and log.thrusters.rows == N
    data = (tmp_path / "00000001.BIN").read_bytes()
    (tmp_path / "00000001.BIN").write_bytes(data[:-400] + b"\0" * 3000 + data[-400:] + b"\xff" * 40)
    log = Log.read(tmp_path, {"thrusters": OUTPUTS}, "00000001")
    assert N - 4 <= len(log.thrusters.time) <= N - 1
    assert [note.partition(":")[0] for note in log.thrusters.notes] == ["bytes that are no messages"]
    assert capfd.readouterr() == ("", "")


def ulog(path: Path, dropout: bool = False) -> Path:
    """Write a log of PX4 by its format: outputs of two instances, with a dropout."""

    def message(kind: str, data: bytes) -> bytes:
        return struct.pack("<HB", len(data), ord(kind)) + data

    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    data += message("B", bytes(40))
    data += message("F", b"actuator_outputs:uint64_t timestamp;float[4] output;uint8_t noutputs;uint8_t[7] _padding0;")
    data += message("F", b"vehicle_attitude:uint64_t timestamp;float[4] q;")
    data += message("A", struct.pack("<BH", 0, 0) + b"actuator_outputs")
    data += message("A", struct.pack("<BH", 1, 1) + b"actuator_outputs")
    data += message("A", struct.pack("<BH", 0, 2) + b"vehicle_attitude")
    w, x, y, z = Rotation.from_euler("ZYX", RPY[:, ::-1]).as_quat()[:, [3, 0, 1, 2]].T
    for k in range(N):
        us = 1_000_000 + 100_000 * k
        for number in (0, 1):
            outputs = [PULSE[k] + number, 1500, 0.25, 0]
            data += message("D", struct.pack("<HQ4fB", number, us, *outputs, 4))
        data += message("D", struct.pack("<HQ4f", 2, us, w[k], x[k], y[k], z[k]))
        if dropout and k == 4:
            data += message("O", struct.pack("<H", 120))
    (path / "log.ulg").write_bytes(data)
    return path


def test_a_ulog_is_read(tmp_path: Path) -> None:
    quaternion = {"columns": [f"q[{k}]" for k in range(4)], "order": "wxyz"}
    thrusters = {"file": "log.ulg", "message": "actuator_outputs", "axes": {"a": {"command": "output[0]"}}}
    attitude = {"file": "log.ulg", "message": "vehicle_attitude", "quaternion": quaternion}
    found = {"thrusters": thrusters, "attitude": attitude | {"world": "ned", "body": "frd"}}
    log = Log.read(ulog(tmp_path), found)
    assert np.allclose(log.thrusters.time, 1.0 + 0.1 * np.arange(N)) and log.thrusters.notes == ()
    assert log.thrusters.command[:, 0].tolist() == PULSE.tolist()
    assert np.allclose(log.attitude.quaternion, turned(RPY), rtol=0.0, atol=1e-7)
    log = Log.read(ulog(tmp_path, dropout=True), {"thrusters": thrusters | {"instance": 1}})
    assert log.thrusters.command[:, 0].tolist() == (PULSE + 1).tolist()
    assert log.thrusters.notes == ("dropouts: 1, 0.12 s",)


@pytest.mark.parametrize(
    ("title", "damage"),
    [
        ("lost", lambda data, k: data[:k] + data[k + 37 :]),
        ("cut", lambda data, k: data[:k]),
        ("zeros", lambda data, k: data[:k] + bytes(100) + data[k:]),
        ("others", lambda data, k: data[:k] + bytes(range(256)) + data[k:]),
    ],
)
def test_a_ulog_is_read_behind_its_damage(tmp_path: Path, title: str, damage: Any, capfd: Any) -> None:
    thrusters = {"file": "log.ulg", "message": "actuator_outputs", "axes": {"a": {"command": "output[0]"}}}
    file = ulog(tmp_path) / "log.ulg"
    data = file.read_bytes()
    for k in range(len(data) // 2, len(data) - 300, 17):
        file.write_bytes(damage(data, k))
        channel = Log.read(tmp_path, {"thrusters": thrusters}).thrusters
        read = channel.command[:, 0].tolist()
        assert set(read) <= set(PULSE.tolist()) and len(channel.notes) == 1
        assert channel.notes[0].startswith("bytes that are no messages: ")
        # One message of each publisher may be damaged, and the one before it.
        before = int(np.sum(np.array(read) < PULSE[N // 2]))
        assert len(read) >= (N - 2 if title != "cut" else before)
        if title != "cut":
            assert read[-1] == PULSE[-1]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("write", "name", "message", "column"),
    [
        (lambda path: tlog(path, packets()), "dive.tlog", "SERVO_OUTPUT_RAW", "servo1_raw"),
        (dataflash, "00000001.BIN", "RCOU", "C1"),
        (ulog, "log.ulg", "actuator_outputs", "output[0]"),
    ],
)
def test_each_mistake_of_a_map_is_one_line(tmp_path: Path, write: Any, name: str, message: str, column: str) -> None:
    write(tmp_path)

    def refused(**keys: Any) -> str:
        axes = {"a": {"command": keys.pop("column", column)}}
        with pytest.raises(LogError) as raised:
            Log.read(tmp_path, {"thrusters": {"file": name, "message": message, "axes": axes} | keys})
        assert "\n" not in str(raised.value)
        return str(raised.value)

    assert f"{name}: thrusters: no message X; messages: " in refused(message="X")
    assert refused(message="X").endswith(message) or f"{message}, " in refused(message="X")
    assert f"{name} {message}: servo99: no such number; fields: " in refused(column="servo99")
    assert f"{name} {message}: no instance 7; instances: " in refused(instance=7)
    assert refused(instance=-1) == "map: thrusters.instance: -1 is not a whole number from 0 on"
    assert refused(delimiter=";").startswith("map: thrusters.delimiter: unknown key; known: ")
    assert refused(message=3) == "map: thrusters.message: 3 is not a text"
    for data in (
        b"",
        b"\0" * 999,
        b"ULog\x01\x12\x35\x01\0",
        b"\xa3\x95\x80\0\0",
        np.random.default_rng(1).bytes(5000),
    ):
        (tmp_path / name).write_bytes(data)
        assert refused().startswith(f"{tmp_path / name}: ")
    (tmp_path / name).unlink()
    assert refused() == f"{tmp_path / name}: no such file"
