"""Time and memory of reading long logs of every format, and the round trip of recordings: figures of docs/logs.md.

    python tests/bench/logs.py [--rows 2000000] [--out docs/_static/logs.json]

Each log is read in a process of its own, whose maximum memory counts. A CSV has seven columns, a message of the others
eight outputs of thrusters.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from uvms_gym import Log, Simulator
from uvms_gym.logs import Recorder
from uvms_gym.studies.records import circumstances, write_json

SCENE = "bluerov2-heavy-alpha5"
OUTPUTS = 8
POSE = {"time": {"column": "t"}, "position": {"columns": ["x", "y", "z"]}, "rpy": {"columns": ["r", "p", "w"]}}


def seeded(rows: int) -> tuple[Any, Any]:
    """Stamps, us, and pulses of all outputs."""
    rng = np.random.default_rng(0)
    return 10_000 * np.arange(1, rows + 1), rng.integers(1100, 1900, (rows, OUTPUTS))


def axes(names: list[str]) -> dict[str, Any]:
    """Thrusters of a map by the names of their fields."""
    return {f"thruster-{k}": {"command": name} for k, name in enumerate(names)}


def write_csv(path: Path, rows: int, kind: str) -> dict[str, Any]:
    """Poses, m and rad; a kind has one lost frame in a thousand, quoted cells, or decimal commas."""
    stamps, pulses = seeded(rows)
    table = np.column_stack([stamps * 1e-6, (pulses[:, :6] - 1500.0) / 1000.0])
    delimiter, quote, commas = (
        (";" if kind == "decimal commas" else ","),
        kind == "quoted cells",
        kind == "decimal commas",
    )
    with open(path / "log.csv", "w") as file:
        file.write(delimiter.join("txyzrpw") + "\n")
        for start in range(0, rows, 100_000):
            part = table[start : start + 100_000]
            form = delimiter.join(['"%.6f"' if quote else "%.6f"] * 7) + "\n"
            text = (form * len(part)) % tuple(part.ravel())
            if kind == "lost frames":
                lines = text.splitlines(keepends=True)
                lines[::1000] = [line.split(",")[0] + ",,,,,,\n" for line in lines[::1000]]
                text = "".join(lines)
            file.write(text.replace(".", ",") if commas else text)
    return {"pose": {"file": "log.csv", "delimiter": delimiter, **POSE}}


def write_bin(path: Path, rows: int) -> dict[str, Any]:
    """ArduPilot's RCOU."""
    stamps, pulses = seeded(rows)
    columns = ["TimeUS", *(f"C{k}" for k in range(1, OUTPUTS + 1))]
    head = b"\xa3\x95\x80"

    def described(number: int, length: int, name: str, layout: str, fields: list[str]) -> bytes:
        words = (
            name.encode().ljust(4, b"\0")
            + layout.encode().ljust(16, b"\0")
            + ",".join(fields).encode().ljust(64, b"\0")
        )
        return head + bytes([number, length]) + words

    found = np.zeros(rows, np.dtype([("head", "S3"), ("time", "<u8"), ("pulses", "<u2", OUTPUTS)]))
    found["head"], found["time"], found["pulses"] = b"\xa3\x95\x01", stamps, pulses
    formats = described(0x80, 89, "FMT", "BBnNZ", ["Type", "Length", "Name", "Format", "Columns"])
    formats += described(1, found.itemsize, "RCOU", "Q" + "H" * OUTPUTS, columns)
    (path / "log.BIN").write_bytes(formats + found.tobytes())
    return {"thrusters": {"file": "log.BIN", "message": "RCOU", "axes": axes(columns[1:])}}


def write_tlog(path: Path, rows: int) -> dict[str, Any]:
    """MAVLink's SERVO_OUTPUT_RAW, second generation, with its CRC."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    stamps, pulses = seeded(rows)
    kind = mavlink.MAVLink_servo_output_raw_message
    parts = [
        ("stamp", ">u8"),
        ("head", "u1", 10),
        ("time", "<u4"),
        ("pulses", "<u2", OUTPUTS),
        ("port", "u1"),
        ("crc", "<u2"),
    ]
    found = np.zeros(rows, np.dtype(parts))
    number = np.arange(rows, dtype=np.int64) % 256
    found["stamp"], found["time"], found["pulses"] = stamps, stamps % 2**32, pulses
    # The port is 1, as zeros at the end are not sent.
    found["port"] = 1
    found["head"][:] = [0xFD, 21, 0, 0, 0, 1, 1, kind.id & 0xFF, kind.id >> 8, 0]
    found["head"][:, 4] = number
    raw = found.view(np.uint8).reshape(rows, -1)
    crc = np.full(rows, 0xFFFF, np.uint16)
    for column in [*raw[:, 9:39].T, np.full(rows, kind.crc_extra, np.uint8)]:
        low = column ^ (crc & 0xFF).astype(np.uint8)
        low ^= low << 4
        wide = low.astype(np.uint16)
        crc = (crc >> 8) ^ (wide << 8) ^ (wide << 3) ^ (wide >> 4)
    found["crc"] = crc
    (path / "log.tlog").write_bytes(found.tobytes())
    names = [f"servo{k}_raw" for k in range(1, OUTPUTS + 1)]
    return {"thrusters": {"file": "log.tlog", "message": "SERVO_OUTPUT_RAW", "axes": axes(names)}}


def write_ulog(path: Path, rows: int) -> dict[str, Any]:
    """PX4's actuator_outputs."""
    stamps, pulses = seeded(rows)

    def message(kind: str, data: bytes) -> bytes:
        return len(data).to_bytes(2, "little") + kind.encode() + data

    start = b"ULog\x01\x12\x35\x01" + bytes(8) + message("B", bytes(40))
    start += message("F", f"actuator_outputs:uint64_t timestamp;float[{OUTPUTS}] output;".encode())
    start += message("A", bytes(3) + b"actuator_outputs")
    parts = [("size", "<u2"), ("kind", "S1"), ("number", "<u2"), ("time", "<u8"), ("pulses", "<f4", OUTPUTS)]
    found = np.zeros(rows, np.dtype(parts))
    found["size"], found["kind"], found["time"], found["pulses"] = found.itemsize - 3, b"D", stamps, pulses
    (path / "log.ulg").write_bytes(start + found.tobytes())
    names = [f"output[{k}]" for k in range(OUTPUTS)]
    return {"thrusters": {"file": "log.ulg", "message": "actuator_outputs", "axes": axes(names)}}


def write_mcap(path: Path, rows: int) -> dict[str, Any]:
    """Float64MultiArray in MCAP."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    stamps, pulses = seeded(rows)
    store, kind = get_typestore(Stores.ROS2_HUMBLE), "std_msgs/msg/Float64MultiArray"
    layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    blank = bytes(store.serialize_cdr(store.types[kind](layout=layout, data=np.zeros(OUTPUTS)), kind))
    begin = blank[: len(blank) - 8 * OUTPUTS]
    bodies = pulses.astype("<f8").tobytes()
    with open(path / "log.mcap", "wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="uvms_gym")
        schema = writer.register_schema(kind, "ros2msg", store.generate_msgdef(kind, ros_version=2)[0].encode())
        channel = writer.register_channel("/thrusts", "cdr", schema)
        for k, ns in enumerate((1000 * stamps).tolist()):
            writer.add_message(channel, ns, begin + bodies[8 * OUTPUTS * k : 8 * OUTPUTS * (k + 1)], ns)
        writer.finish()
    names = [f"data[{k}]" for k in range(OUTPUTS)]
    return {"bag": "log.mcap", "thrusters": {"topic": "/thrusts", "axes": axes(names)}}


WRITERS: dict[str, Callable[[Path, int], dict[str, Any]]] = {
    "CSV": lambda path, rows: write_csv(path, rows, ""),
    "CSV, lost frames": lambda path, rows: write_csv(path, rows, "lost frames"),
    "CSV, quoted cells": lambda path, rows: write_csv(path, rows, "quoted cells"),
    "CSV, decimal commas": lambda path, rows: write_csv(path, rows, "decimal commas"),
    ".BIN": write_bin,
    ".tlog": write_tlog,
    ".ulg": write_ulog,
    "MCAP": write_mcap,
}


def peak() -> int:
    """Maximum memory of this process so far, bytes."""
    # (The resource usage begins with the parent's.)
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def read(folder: Path) -> None:
    """Read the log of a folder and print time, s, memory, bytes, and the samples read."""
    before = peak()
    begun, worked = time.perf_counter(), time.process_time()
    (channel,) = Log.read(folder, json.loads((folder / "map.json").read_text())).channels.values()
    taken, worked = time.perf_counter() - begun, time.process_time() - worked
    memory = peak()
    values = channel.command if hasattr(channel, "command") else channel.position
    found = {"seconds": taken, "processor_seconds": worked, "bytes_of_memory": memory, "bytes_before": before}
    print(json.dumps({**found, "samples": len(channel.time), "sum": float(np.sum(values))}))


def long_logs(rows: int) -> list[dict[str, Any]]:
    """Figures of reading each format."""
    made = []
    _, pulses = seeded(rows)
    for name, write in WRITERS.items():
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "map.json").write_text(json.dumps(write(Path(folder), rows)))
            size = sum(file.stat().st_size for file in Path(folder).glob("log.*"))
            command = [sys.executable, __file__, "--read", folder]
            done = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        lost = -(-rows // 1000) if name == "CSV, lost frames" else 0
        assert done["samples"] == rows - lost, name
        if not name.startswith("CSV"):
            assert done["sum"] == float(pulses.sum()), name
        made.append({"log": name, "rows": rows, "bytes": size, "load": os.getloadavg()[0], **done})
        print(made[-1], flush=True)
    return made


def round_trip(periods: int = 5000) -> dict[str, Any]:
    """A recording with all topics: largest errors of states and stamps, size and times of a control period."""
    rng, simulator = np.random.default_rng(0), Simulator(SCENE)
    m, n = simulator.num_thrusters, simulator.num_joints
    forces = rng.normal(size=(periods, m + n))
    names = ("position", "quaternion", "twist", "q", "qd")
    states: dict[str, list[Any]] = {name: [] for name in names}
    stamps = np.round((0.1 * np.arange(periods) + rng.uniform(0.0, 0.05, periods)) * 1e9).astype(np.int64)
    with tempfile.TemporaryDirectory() as folder:
        file, taken = Path(folder) / "a.mcap", 0.0
        begun = time.perf_counter()
        with Recorder(file) as recorder:
            for k, ns in enumerate(stamps):
                quaternion = rng.normal(size=4)
                simulator.set_state(
                    position=rng.normal(size=3),
                    quaternion=quaternion / np.linalg.norm(quaternion),
                    twist=rng.normal(size=6),
                    q=rng.uniform(0.5, 1.0, n),
                    qd=rng.normal(size=n),
                )
                for name in names:
                    states[name].append(getattr(simulator, name)[0].copy())
                start = time.perf_counter()
                recorder.add(simulator, ns / 1e9, forces=forces[k])
                taken += time.perf_counter() - start
        size, written = file.stat().st_size, time.perf_counter() - begun
        named = {one: {"position": f"position[{one}]", "velocity": f"velocity[{one}]"} for one in simulator.joint_names}
        thrusters = {one: {"command": f"data[{k}]"} for k, one in enumerate(simulator.thruster_names)}
        log_map: dict[str, Any] = {
            "pose": {"topic": "/odom"},
            "twist": {"topic": "/odom", "angular_velocity": {}},
            "joints": {"topic": "/joint_states", "axes": named},
            "thrusters": {"topic": "/thruster_commands", "axes": thrusters},
        }
        begun = time.perf_counter()
        log: Any = Log.read(file, log_map, scene=SCENE)
        reading = time.perf_counter() - begun
    found = {
        "position": log.pose.position,
        "quaternion": log.pose.quaternion,
        "twist": np.concatenate([log.twist.velocity, log.twist.angular_velocity], axis=1),
        "q": log.joints.position,
        "qd": log.joints.velocity,
    }
    states["quaternion"] = [q * np.where(q[0] < 0.0, -1.0, 1.0) for q in states["quaternion"]]
    return {
        "scene": SCENE,
        "periods": periods,
        "largest_error": {name: float(np.abs(found[name] - np.array(states[name])).max()) for name in names},
        "largest_error_of_thrusts": float(np.abs(log.thrusters.command - forces[:, :m]).max()),
        "stamps_that_differ": int(sum(np.sum(one.time != stamps / 1e9) for one in log.channels.values())),
        "bytes_per_period": size / periods,
        "milliseconds_to_write_a_period": 1e3 * taken / periods,
        "milliseconds_to_read_a_period": 1e3 * reading / periods,
        "seconds_of_the_whole_recording": written,
    }


def main() -> None:
    """Measure and write all."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rows", type=int, default=2_000_000)
    parser.add_argument("--read", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path, default=Path("docs/_static/logs.json"))
    given = parser.parse_args()
    if given.read is not None:
        read(given.read)
        return
    trip = round_trip()
    print(trip, flush=True)
    assert max(trip["largest_error"].values()) < 1e-12 and trip["stamps_that_differ"] == 0
    rows = long_logs(given.rows)
    made = {
        "circumstances": circumstances("tests/bench/logs.py", {"rows": given.rows}),
        "round_trip": trip,
        "rows": rows,
    }
    write_json(given.out, made)


if __name__ == "__main__":
    main()
