"""Bridge to ArduPilot's SITL: golden packets, and a second implementation of parser and frames."""

import socket
import struct
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import free_port
from scipy.spatial.transform import Rotation

import uvms_gym
from uvms_gym import LogError
from uvms_gym.ardupilot import Bridge, parse, serve
from uvms_gym.cli import main

MAP = Path(__file__).parents[1] / "data/ardusub/map.toml"
SCENE = "bluerov2-heavy"
#: As in the interface's description: magic 18458, 400 Hz, frame 7, 1100, 1101, ... us.
GOLDEN = bytes.fromhex("1a48900107000000" + "".join(f"{1100 + k:04x}"[2:] + f"{1100 + k:04x}"[:2] for k in range(16)))
STILL = (1500,) * 8


def packet(frame: int, pulses: Any = STILL, rate: int = 400, channels: int = 16) -> bytes:
    magic = {16: 18458, 32: 29569}[channels]
    return struct.pack(f"<HHI{channels}H", magic, rate, frame, *(tuple(pulses) + (0,) * 32)[:channels])


def sensors(answer: bytes) -> dict[str, Any]:
    """Numbers of an answer as ArduPilot finds them: by the key's text, a colon, and at once the number or a bracket."""
    assert answer[:1] == answer[-1:] == b"\n" and answer.count(b"\n") == 2
    text, found = answer.decode().strip(), {}
    for section, key, count in (
        ("", "timestamp", 1),
        ("imu", "gyro", 3),
        ("imu", "accel_body", 3),
        ("", "position", 3),
        ("", "quaternion", 4),
        ("", "velocity", 3),
    ):
        at = text.index(section) + len(section) + 1 if section else 0
        at = text.index(key, at) + len(key) + 2
        if count == 1:
            found[key] = float(text[at : at + 24].split(",")[0])
        else:
            assert text[at] == "["
            numbers = text[at + 1 : text.index("]", at)].split(",")
            assert len(numbers) == count
            found[key] = np.array([float(number) for number in numbers])
    return found


def run(bridge: Bridge, frames: list[Any], rate: int = 400, first: int = 0) -> list[dict[str, Any]]:
    """Answers to frames of pulses."""
    return [sensors(bridge.answer(parse(packet(first + k, p, rate)))[0]) for k, p in enumerate(frames)]


def test_val_golden_packets_are_read() -> None:
    found = parse(GOLDEN)
    assert (found.rate, found.frame) == (400, 7) and found.pulses == tuple(range(1100, 1116))
    wide = parse(b"\x81\x73" + GOLDEN[2:] + GOLDEN[8:])
    assert wide.pulses == tuple(range(1100, 1116)) * 2 and wide.frame == 7


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (GOLDEN[:13], "packet of 13 bytes, but with 16 channels it has 40"),
        (b"\x81\x73" + GOLDEN[2:], "packet of 40 bytes, but with 32 channels it has 72"),
        (b"", "packet of 0 bytes that does not begin as SITL's, with 18458 or 29569"),
        (b"hello", "packet of 5 bytes that does not begin as SITL's, with 18458 or 29569"),
        (packet(0, rate=0), "packet with a frame rate of 0"),
    ],
)
def test_other_packets_are_refused(data: bytes, text: str) -> None:
    with pytest.raises(ValueError, match=f"^{text}$"):
        parse(data)


def test_val_answers_agree_with_a_second_implementation() -> None:
    rng = np.random.default_rng(0)
    frames = [rng.integers(1300, 1700, 8).tolist()] * 60 + [rng.integers(1300, 1700, 8).tolist()] * 60
    bridge = Bridge(SCENE, MAP, depth=3.0)
    answers = run(bridge, frames)
    simulator, dt = uvms_gym.Simulator(SCENE, dt=1 / 400), 1 / 400
    simulator.set_state(position=[0.0, 0.0, -3.0])
    flip = np.diag([1.0, -1.0, -1.0])
    before, last = np.zeros(3), np.eye(3)
    for k, (pulses, found) in enumerate(zip(frames, answers)):
        simulator.step(thrust=bridge.thrusts(pulses))
        w, *xyz = found["quaternion"]
        dcm = Rotation.from_quat([*xyz, w]).as_matrix()
        assert found["timestamp"] == pytest.approx((k + 1) * dt, abs=1e-12)
        assert np.allclose(found["position"], flip @ simulator.position[0], rtol=0.0, atol=1e-12)
        assert np.allclose(dcm, flip @ simulator.rotation[0] @ flip, rtol=0.0, atol=1e-12)
        assert np.allclose(found["gyro"], flip @ simulator.twist[0, 3:], rtol=0.0, atol=1e-12)
        assert np.allclose(found["velocity"], dcm @ flip @ simulator.twist[0, :3], rtol=0.0, atol=1e-12)
        # From the answers alone: gravity is +9.81 down, and an accelerometer does not feel it.
        force = dcm.T @ ((found["velocity"] - before) / dt - [0.0, 0.0, 9.81])
        assert np.allclose(found["accel_body"], force, rtol=0.0, atol=1e-9)
        turn = Rotation.from_matrix(last.T @ dcm).as_rotvec() / dt
        assert np.allclose(turn, found["gyro"], rtol=0.0, atol=0.02)
        before, last = found["velocity"], dcm
    assert np.linalg.norm(before) > 0.01 and np.linalg.norm(answers[-1]["gyro"]) > 0.05


@pytest.mark.parametrize(
    ("signs", "key", "entry"),
    [
        ((-1, -1, 1, 1, 0, 0, 0, 0), "velocity", 0),  # forward
        ((1, -1, 1, -1, 0, 0, 0, 0), "velocity", 1),  # right
        ((0, 0, 0, 0, 1, 1, 1, 1), "velocity", 2),  # down: above 1500 us the vertical thrusters push down
        ((0, 0, 0, 0, 1, -1, 1, -1), "gyro", 0),  # right side down
        ((0, 0, 0, 0, -1, -1, 1, 1), "gyro", 1),  # nose up
        ((1, -1, -1, 1, 0, 0, 0, 0), "gyro", 2),  # clockwise
    ],
)
def test_val_the_map_has_the_signs_of_ardusub(signs: tuple[int, ...], key: str, entry: int) -> None:
    """Factors of ArduSub's motors (forward, lateral, throttle down, roll, pitch, yaw) move the vehicle that way."""
    still = run(Bridge(SCENE, MAP), [STILL] * 20)[-1][key]
    moved = run(Bridge(SCENE, MAP), [[1500 + 150 * sign for sign in signs]] * 20)[-1][key] - still
    assert moved[entry] > 1e-3 and np.argmax(np.abs(moved)) == entry


@pytest.mark.parametrize("pulse", [0, 1500, 1481])
def test_a_disarmed_vehicle_gets_no_thrust(pulse: int) -> None:
    bridge = Bridge(SCENE, MAP)
    assert bridge.thrusts([pulse] * 16).tolist() == [0.0] * 8 and bridge.thrusts([]).tolist() == [0.0] * 8
    found = run(bridge, [[pulse] * 8] * 40)[-1]
    free = uvms_gym.Simulator(SCENE, dt=1 / 400)
    free.step(substeps=40)
    assert np.allclose(found["position"] * [1, -1, -1], free.position[0], rtol=0.0, atol=1e-12)
    linear = {
        "axes": {n: {"command": f"servo{k}_raw", "scale": 0.1, "neutral": 1500.0} for k, n in enumerate(names(), 1)}
    }
    other = Bridge(SCENE, {"thrusters": {"file": "a.csv", "time": {"column": "t"}, **linear}})
    assert other.thrusts([0] * 8).tolist() == other.thrusts([1500] * 8).tolist() == [0.0] * 8
    assert other.thrusts([1600] * 8) == pytest.approx([10.0] * 8)
    ends = uvms_gym.thrust_of([1100, 1900])
    assert [bridge.thrusts([pulse] * 8)[2] for pulse in (1000, 2000)] == pytest.approx(ends)


def names() -> list[str]:
    return uvms_gym.Simulator(SCENE).thruster_names


def test_frames_are_answered_once_repeated_and_restarted() -> None:
    bridge = Bridge(SCENE, MAP)
    push = [1500 + 200 * (k > 3) for k in range(8)]
    (first, said), (second, quiet) = (bridge.answer(parse(packet(k, push))) for k in (5, 6))
    assert said == "connected at 400 Hz" and quiet == "" and first != second
    again, said = bridge.answer(parse(packet(6, push)))
    assert again == second and said == "frame 6 again: answered again"
    third, said = bridge.answer(parse(packet(9, push)))
    assert said == "2 frames are missing before frame 9"
    assert sensors(third)["timestamp"] == pytest.approx(3 / 400)
    restarted, said = bridge.answer(parse(packet(0, push)))
    assert said == "restart at frame 0" and restarted == first
    # Another rate: time and state go on.
    answer, said = bridge.answer(parse(packet(1, push, rate=100)))
    faster = sensors(answer)
    assert said == "frame rate 100 Hz instead of 400 Hz from frame 1 on"
    assert faster["timestamp"] == pytest.approx(1 / 400 + 1 / 100)
    assert np.all(np.abs(faster["velocity"]) >= np.abs(sensors(first)["velocity"]))
    slow = Bridge(SCENE, MAP)
    assert sensors(slow.answer(parse(packet(0, push, rate=25)))[0])["timestamp"] == pytest.approx(0.04)


def test_wide_packets_drive_channels_above_16() -> None:
    axes = {name: {"command": f"C{k}", "curve": "t200"} for k, name in enumerate(names(), 17)}
    bridge = Bridge(SCENE, {"thrusters": {"file": "{trial}.BIN", "message": "RCOU", "axes": axes}})
    pulses = (1100,) * 16 + (1700,) * 8
    assert (bridge.thrusts(parse(packet(0, pulses, channels=32)).pulses) > 15.0).all()
    assert bridge.thrusts(parse(packet(0, pulses)).pulses).tolist() == [0.0] * 8


def test_packets_by_udp_get_answers_and_bad_ones_a_line() -> None:
    port, said = free_port(), list[str]()
    bridge = Bridge(SCENE, MAP)
    thread = threading.Thread(target=serve, args=(bridge, "127.0.0.1", port, said.append, 3))
    thread.start()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sitl:
        sitl.settimeout(0.2)
        answers = []
        # Half a packet in the middle: SITL gets no answer, and sends again.
        for data in (packet(0), packet(1)[:20], packet(1), packet(1)):
            for _ in range(50):
                sitl.sendto(data, ("127.0.0.1", port))
                try:
                    answers.append(sitl.recv(4096))
                    break
                except TimeoutError:
                    if len(data) < 40:
                        break
                except ConnectionRefusedError:
                    threading.Event().wait(0.05)  # The server has not bound the port yet.
    thread.join(10.0)
    assert not thread.is_alive() and len(answers) == 3
    assert sensors(answers[1])["timestamp"] == pytest.approx(2 / 400) and answers[2] == answers[1]
    assert said[:2] == [f"waiting for packets at 127.0.0.1:{port} (Ctrl-C ends it)", "connected at 400 Hz"]
    assert said[-1] == "frame 1 again: answered again"
    assert any(text.endswith("packet of 20 bytes, but with 16 channels it has 40; left out") for text in said)


def test_mistakes_are_one_line(tmp_path: Path, capsys: Any) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = str(taken.getsockname()[1])
        assert main(["ardupilot", SCENE, "--map", str(MAP), "--port", port]) == 2
    assert capsys.readouterr() == ("", f"uvms: port {port} at 127.0.0.1: address already in use\n")
    assert main(["ardupilot", SCENE, "--map", str(MAP), "--host", "192.0.2.1"]) == 2
    assert capsys.readouterr() == ("", "uvms: host '192.0.2.1': cannot assign requested address\n")
    axes = {name: {"command": f"C{k}", "curve": "t200"} for k, name in enumerate(names(), 1)}
    channel: dict[str, Any] = {"file": "a.BIN", "message": "RCOU", "axes": axes}
    for wrong, text in (
        ({"pose": {"topic": "/odom"}}, "^map: no channel thrusters$"),
        (
            {"thrusters": channel | {"axes": axes | {"front-left": {"command": "left"}}}},
            "'left' names no channel, of 1 to 32$",
        ),
        ({"thrusters": channel | {"axes": axes | {"front-left": {"command": "C33"}}}}, "'C33' names no channel"),
        ({"thrusters": channel | {"axes": dict(list(axes.items())[1:])}}, "front-right is missing"),
    ):
        with pytest.raises(LogError, match=text):
            Bridge(SCENE, wrong)
    (tmp_path / "bench.csv").write_text("pulse,10V,12V\n1100,-1,-2\n1900,1,2\n")
    text = MAP.read_text().replace('"t200"', '"bench.csv"')
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(LogError, match=r"thrusters\.voltage: is missing: the curve of front-right depends on it$"):
        Bridge(SCENE, tmp_path / "map.toml")
    (tmp_path / "map.toml").write_text(text.replace("[thrusters]", "[thrusters]\nvoltage = 11.0", 1))
    bridge = Bridge(SCENE, tmp_path / "map.toml")
    assert bridge.thrusts([1900] * 8)[2] == pytest.approx(1.5)
    assert b'"battery":{"voltage":11.0,"current":0.0}' in bridge.answer(parse(packet(0)))[0]
