"""Simulator of ArduPilot's SITL by its JSON interface: pulse widths in, motion out, frame by frame."""

from __future__ import annotations

import errno
import json
import os
import re
import socket
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym import _rotations as rotations
from uvms_gym._core import Simulator, load_scene
from uvms_gym.logs.channel_map import Axis, in_scene_order
from uvms_gym.logs.errors import LogError
from uvms_gym.logs.map import LogMap

Floats = NDArray[np.float64]
#: Number of channels by the first number of a packet.
CHANNELS = {18458: 16, 29569: 32}
#: Maximum size of a UDP packet, bytes, and maximum step of the physics, s.
_MOST, _STEP = 65535, 0.01
#: Library's axes (world north, west, up; body forward, left, up) to ArduPilot's (north, east, down; forward, right,
#: down), and back: the one place where they are converted.
_SIGNS = np.array([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Packet:
    """Packet of SITL: rate, Hz, count of the frame, and pulse widths of the channels, us; 0: no pulse."""

    rate: int
    frame: int
    pulses: tuple[int, ...]


def parse(data: bytes) -> Packet:
    """Read a packet.

    Raises
    ------
    ValueError
        Half a packet, or another one.
    """
    count = CHANNELS.get(int.from_bytes(data[:2], "little"))
    if count is None:
        known = " or ".join(map(str, CHANNELS))
        raise ValueError(f"packet of {len(data)} bytes that does not begin as SITL's, with {known}")
    if len(data) != 8 + 2 * count:
        raise ValueError(f"packet of {len(data)} bytes, but with {count} channels it has {8 + 2 * count}")
    _, rate, frame, *pulses = struct.unpack(f"<HHI{count}H", data)
    if rate == 0:
        raise ValueError("packet with a frame rate of 0")
    return Packet(rate, frame, tuple(pulses))


class Bridge:
    """Simulated vehicle that answers packets.

    Parameters
    ----------
    scene : str, os.PathLike or dict
        Scene with thrusters.
    log_map : str, os.PathLike or dict
        Map of logs with the channel thrusters; the number at the end of a thruster's command, such as `servo3_raw` or
        `C3`, is its channel. Its curves or scales give the thrust of a pulse: no pulse is no thrust, and pulses beyond
        a curve are those of its ends.
    depth : float
        Depth of the start below the world's origin, m.

    Raises
    ------
    LogError
        Map that cannot be used.
    SceneError
        Scene that cannot be used.
    """

    def __init__(
        self,
        scene: str | os.PathLike[str] | dict[str, Any],
        log_map: str | os.PathLike[str] | Mapping[str, Any],
        depth: float = 0.0,
    ) -> None:
        self._scene, self._depth = load_scene(scene), depth
        self._gravity = np.array(self._scene["water"]["gravity"])
        found = LogMap.read(log_map)
        if "thrusters" not in found.channels:
            raise LogError(f"{found.name}: no channel thrusters")
        channel = found.channels["thrusters"]
        self._axes = in_scene_order("thrusters", channel, Simulator(self._scene).thruster_names)
        self._supply = channel.supply
        self._channels = [_channel(found.name, axis) for axis in self._axes]
        needing = [axis.name for axis in self._axes if axis.curve is not None and axis.curve.needs_voltage]
        if needing and channel.supply is None:
            raise channel.place.error("voltage", f"is missing: the curve of {needing[0]} depends on it")
        self._last: Packet | None = None
        self._answer = b""
        self._simulator: Simulator | None = None
        self._period, self._time = 0.0, 0.0

    def thrusts(self, pulses: Sequence[int]) -> Floats:
        """Thrusts (m,), N, of the pulse widths of all channels, us."""
        return np.array([self._thrust(axis, k, pulses) for axis, k in zip(self._axes, self._channels)])

    def _thrust(self, axis: Axis, channel: int | None, pulses: Sequence[int]) -> float:
        if channel is None:
            return -axis.offset
        pulse = np.array([float(pulses[channel - 1]) if channel <= len(pulses) else 0.0])
        if pulse[0] == 0.0:
            return 0.0
        if axis.curve is None:
            return float(axis.factor * pulse[0] - axis.offset)
        pulse = np.clip(pulse, axis.curve.command[0], axis.curve.command[-1])
        return float(axis.factor * axis.curve(pulse, None if self._supply is None else np.array([self._supply]))[0])

    def answer(self, packet: Packet) -> tuple[bytes, str]:
        """Answer to a packet, after a frame of physics under its pulses, and a remark for the user or "".

        A repeated frame gets the same answer again; a count that falls starts the vehicle anew.
        """
        last, remark = self._last, ""
        if last is not None and packet.frame == last.frame:
            return self._answer, f"frame {packet.frame} again: answered again"
        if last is None or packet.frame < last.frame:
            remark = f"connected at {packet.rate} Hz" if last is None else f"restart at frame {packet.frame}"
            self._simulator = None
        elif packet.frame > last.frame + 1:
            remark = f"{packet.frame - last.frame - 1} frames are missing before frame {packet.frame}"
        elif packet.rate != last.rate:
            remark = f"frame rate {packet.rate} Hz instead of {last.rate} Hz from frame {packet.frame} on"
        simulator = self._at_rate(packet.rate)
        before = simulator.rotation[0] @ simulator.twist[0, :3]
        simulator.step(thrust=self.thrusts(packet.pulses), substeps=max(1, round(self._period / simulator.dt)))
        self._time += self._period
        R, after = simulator.rotation[0], simulator.rotation[0] @ simulator.twist[0, :3]
        force = R.T @ ((after - before) / self._period - self._gravity)
        self._last, self._answer = packet, _reply(simulator, force, self._time, self._supply)
        return self._answer, remark

    def _at_rate(self, rate: int) -> Simulator:
        """Simulator with steps of a frame, in the state so far; at the start without one."""
        old, period = self._simulator, 1.0 / rate
        if old is not None and period == self._period:
            return old
        new = Simulator(self._scene, dt=period / int(np.ceil(period / _STEP - 1e-9)))
        if old is None:
            self._time = 0.0
            new.set_state(position=[0.0, 0.0, -self._depth])
        else:
            state = {name: getattr(old, name) for name in ("position", "quaternion", "twist", "q", "qd")}
            new.set_state(**{name: rows for name, rows in state.items() if rows.size})
        self._simulator, self._period = new, period
        return new


def _channel(name: str, axis: Axis) -> int | None:
    if axis.column is None:
        return None
    number = re.search(r"(\d+)\D*$", axis.column)
    if number is None or not 1 <= int(number[1]) <= max(CHANNELS.values()):
        problem = f"command {axis.column!r} names no channel, of 1 to {max(CHANNELS.values())}"
        raise LogError(f"{name}: thrusters.axes.{axis.name}: {problem}")
    return int(number[1])


def _reply(simulator: Simulator, force: Floats, time: float, supply: float | None) -> bytes:
    """Motion in ArduPilot's axes; `force` is the specific force in body axes, mean over the frame."""
    twist = simulator.twist[0]
    velocity = simulator.rotation[0] @ twist[:3]
    w, x, y, z = rotations.canonical(simulator.quaternion)[0]
    found: dict[str, Any] = {
        "timestamp": time,
        "imu": {"gyro": (_SIGNS * twist[3:]).tolist(), "accel_body": (_SIGNS * force).tolist()},
        "position": (_SIGNS * simulator.position[0]).tolist(),
        "quaternion": [float(w), float(x), float(-y), float(-z)],
        "velocity": (_SIGNS * velocity).tolist(),
    }
    if supply is not None:
        found["battery"] = {"voltage": supply, "current": 0.0}
    # (ArduPilot's parser allows no space after a colon.)
    return b"\n" + json.dumps(found, separators=(",", ":")).encode() + b"\n"


def serve(bridge: Bridge, host: str, port: int, report: Callable[[str], object], count: int | None = None) -> None:
    """Answer packets at a UDP port, each to its sender, until an interrupt or for a number of answers.

    `report` is called with one line for the open port and for each remark; a packet that cannot be read is one, and
    gets no answer.

    Raises
    ------
    ValueError
        The port is taken, or the address is not of this machine.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        try:
            link.bind((host, port))
        except OSError as error:
            here = error.errno == errno.EADDRINUSE or isinstance(error, PermissionError)
            place = f"port {port} at {host}" if here else f"host {host!r}"
            raise ValueError(f"{place}: {(error.strerror or str(error)).lower()}") from None
        report(f"waiting for packets at {host}:{port} (Ctrl-C ends it)")
        while count is None or count > 0:
            data, sender = link.recvfrom(_MOST)
            try:
                packet = parse(data)
            except ValueError as error:
                report(f"{sender[0]}:{sender[1]}: {error}; left out")
                continue
            data, remark = bridge.answer(packet)
            count = None if count is None else count - 1
            if remark:
                report(remark)
            link.sendto(data, sender)
