"""Log of one trial: channels of a vehicle's motion, sensors and commands."""

from __future__ import annotations

import glob
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from uvms_gym import _core
from uvms_gym._files import read_text
from uvms_gym.logs.build import make_channel
from uvms_gym.logs.channel_map import QUANTITIES, ChannelMap, in_scene_order
from uvms_gym.logs.channels import Attitude, Battery, Channel, Imu, Joints, Pose, Thrusters, Twist
from uvms_gym.logs.errors import LogError, reading
from uvms_gym.logs.flight import read_flight_log
from uvms_gym.logs.map import TRIAL, Bound, LogMap
from uvms_gym.logs.ros2 import read_bag
from uvms_gym.logs.tables import Table, read_table
from uvms_gym.logs.units import Floats

Scene = str | os.PathLike[str] | dict[str, Any]
#: Map: path of a TOML file, its data, or the map read from it.
Map = str | os.PathLike[str] | Mapping[str, Any] | LogMap


@dataclass(frozen=True, kw_only=True, eq=False)
class Log:
    """Log of one trial: channels with stamps of their own, in SI units and the library's axes, on a common clock.

    Attributes
    ----------
    name : str
        Name of the trial.
    start : float
        Start of the trial, s. All channels have samples from there to `end`, and one beyond each where there is one.
    end : float
        End of the trial, s.
    pose : Pose or None
        Position and attitude of the vehicle frame.
    attitude : Attitude or None
        Attitude only.
    twist : Twist or None
        Velocity and angular velocity, body axes.
    imu : Imu or None
        Angular velocity, specific force and attitude.
    joints : Joints or None
        Positions and velocities of the joints.
    thrusters : Thrusters or None
        Commands of the thrusters.
    battery : Battery or None
        Supply voltage of the thrusters.
    """

    name: str
    start: float
    end: float
    pose: Pose | None = None
    attitude: Attitude | None = None
    twist: Twist | None = None
    imu: Imu | None = None
    joints: Joints | None = None
    thrusters: Thrusters | None = None
    battery: Battery | None = None

    @classmethod
    def read(cls, path: str | os.PathLike[str], map: Map, trial: str | None = None, scene: Scene | None = None) -> Log:
        """Read the log of one trial.

        Parameters
        ----------
        path : str or os.PathLike
            Directory of the map's files and bags; or the bag, where the map has topics and no key `bag`.
        map : str, os.PathLike, dict or LogMap
            Map from files and topics to channels: see docs/logs.md.
        trial : str, optional
            Name of the trial, which replaces "{trial}" in names of files. A map without "{trial}" has none: the
            directory, or the bag, is one trial.
        scene : str, os.PathLike or dict, optional
            Scene whose joints and thrusters give the order of the columns and must be the map's. Without it, the
            order is the map's.

        Raises
        ------
        LogError
            Map or file that cannot be read; the message names file, line and value.
        SceneError
            Scene that cannot be read.
        """
        return cls._read(Path(path), LogMap.read(map), trial, _names(scene))

    @classmethod
    def _read(cls, directory: Path, whole: LogMap, trial: str | None, names: Mapping[str, Sequence[str]]) -> Log:
        if whole.by_trial != (trial is not None):
            problem = "is missing" if whole.by_trial else f"is given, but no file's name has {TRIAL}"
            raise LogError(f"{whole.name}: the name of the trial {problem}")
        found = whole.of(trial)
        channels = _read_channels(directory, found, trial, names)
        zero = min(channel.time[0] for channel in channels.values()) if found.first else 0.0
        channels = {kind: channel.shifted(-zero) for kind, channel in channels.items()}
        pose: Any = channels.get("pose")
        start = max(float(channel.time[0]) for channel in channels.values())
        end = min(float(channel.time[-1]) for channel in channels.values())
        start = max(start, _time_of(found.start, -math.inf, directory, trial, pose, start))
        end = min(end, _time_of(found.end, math.inf, directory, trial, pose, start))
        name = trial if trial is not None else directory.resolve().stem
        if not start < end:
            spans = "; ".join(f"{kind} {c.time[0]:.6g} to {c.time[-1]:.6g} s" for kind, c in channels.items())
            raise LogError(f"{directory}: {name}: no samples between start {start:.6g} and end {end:.6g} s; {spans}")
        given: dict[str, Any] = {**channels}
        return cls(name=name, start=start, end=end, **given).between(start, end)

    @classmethod
    def read_all(cls, path: str | os.PathLike[str], map: Map, scene: Scene | None = None) -> list[Log]:
        """Read the logs of all trials of a directory, sorted by name; arguments and errors as of `read`."""
        found = LogMap.read(map)
        which = trials(Path(path), found) if found.by_trial else [None]
        names = _names(scene)
        return [cls._read(Path(path), found, trial, names) for trial in which]

    @property
    def channels(self) -> dict[str, Channel]:
        """Channels that the log has, by name."""
        return {kind: channel for kind in QUANTITIES if (channel := getattr(self, kind)) is not None}

    def spans(self, *kinds: str) -> Floats:
        """(k, 2) starts and ends of the times between start and end at which channels have no gaps, s.

        Parameters
        ----------
        *kinds : str
            Names of the channels; by default all.

        Raises
        ------
        LogError
            The log has no such channel.
        """
        spans = np.array([[self.start, self.end]])
        for kind in kinds or self.channels:
            if kind not in self.channels:
                raise LogError(f"{self.name}: no channel {kind}; channels: {', '.join(self.channels)}")
            other = self.channels[kind].spans
            low = np.maximum(spans[:, None, 0], other[None, :, 0]).ravel()
            high = np.minimum(spans[:, None, 1], other[None, :, 1]).ravel()
            spans = np.stack([low, high], axis=-1)[low < high]
        return spans

    def between(self, start: float, end: float) -> Self:
        """Part of this log at times in [start, end], s.

        Every channel has one sample beyond each end, so that both interpolate.

        Raises
        ------
        LogError
            Fewer than two samples of a channel.
        """
        first, last = max(float(start), self.start), min(float(end), self.end)
        if not first < last:
            known = f"the log has {self.start:.6g} to {self.end:.6g} s"
            raise LogError(f"{self.name}: no times between {start:.6g} and {end:.6g} s; {known}")
        cut: dict[str, Any] = {kind: channel.between(first, last) for kind, channel in self.channels.items()}
        return replace(self, start=first, end=last, **cut)

    def pieces(self, seconds: float) -> list[Self]:
        """Consecutive parts of equal length, s, named by their number from 1 on; the rest at the end is left out.

        Raises
        ------
        LogError
            The log is shorter.
        """
        count = int((self.end - self.start) / seconds + 1e-9)
        if count < 1:
            raise LogError(f"{self.name}: {self.end - self.start:.6g} s, shorter than a piece of {seconds:.6g} s")
        cuts = [(k, self.start + (k - 1) * seconds) for k in range(1, count + 1)]
        return [replace(self.between(start, start + seconds), name=f"{self.name}-{k}") for k, start in cuts]

    def summary(self) -> str:
        """Text with one line per channel: samples, rate, gaps, rows left out, and notes on how it was read."""
        lines = [f"{self.name}: {self.start:.3f} to {self.end:.3f} s ({self.end - self.start:.3f} s)"]
        for kind, channel in self.channels.items():
            rate = 1.0 / np.median(np.diff(channel.time))
            gaps = ", ".join(f"{b - a:.2f} s at {a:.2f} s" for a, b in channel.gaps) or "none"
            dropped = ", ".join(f"{count} {reason}" for reason, count in channel.dropped.items() if count) or "none"
            notes = "".join(f"; {note}" for note in channel.notes)
            lines.append(
                f"  {kind}: {len(channel.time)} samples, {rate:.3g} Hz; gaps: {gaps}; left out: {dropped}{notes}"
            )
        return "\n".join(lines)


def trials(directory: Path, found: LogMap) -> list[str | None]:
    """Names of the trials in a directory, sorted: all that a channel's file, or a bag, is named by."""
    if not directory.is_dir():
        raise LogError(f"{directory}: no such directory")
    names = set()
    patterns = [found.bag, *(channel.file for channel in found.channels.values())]
    wanted = list(dict.fromkeys(pattern for pattern in patterns if pattern and TRIAL in pattern))
    for pattern in wanted:
        parts = pattern.split(TRIAL)
        expression = re.escape(parts[0]) + "([^/]+)" + r"\1".join(map(re.escape, parts[1:]))
        for file in directory.glob("*".join(map(glob.escape, parts))):
            if match := re.fullmatch(expression, file.relative_to(directory).as_posix()):
                names.add(match[1])
    if not names:
        raise LogError(f"{directory}: no file is named {' or '.join(wanted) or TRIAL}")
    return sorted(names)


def _names(scene: Scene | None) -> dict[str, Sequence[str]]:
    """Names of a scene's joints and thrusters, by channel."""
    if scene is None:
        return {}
    simulator = _core.Simulator(scene)
    return {"joints": simulator.joint_names, "thrusters": simulator.thruster_names}


def _read_channels(
    directory: Path, found: LogMap, trial: str | None, names: Mapping[str, Sequence[str]]
) -> dict[str, Channel]:
    maps = dict(found.channels)
    for kind in (kind for kind in names if kind in maps):
        maps[kind] = replace(maps[kind], axes=in_scene_order(kind, maps[kind], names[kind]))
    tables: dict[str, Table] = {}
    flights: dict[str, dict[str, ChannelMap]] = {}
    for kind, channel in maps.items():
        if channel.file and channel.message:
            flights.setdefault(channel.file, {})[kind] = channel
        elif channel.file:
            columns = {key: group or [] for key, group in channel.names.items()}
            file = _file(directory, channel.file, trial)
            tables[kind] = read_table(file, channel.text, channel.time or "", columns)
    for name, parts in flights.items():
        tables |= read_flight_log(_file(directory, name, trial), parts)
    if topics := {kind: channel for kind, channel in maps.items() if channel.topic}:
        tables |= read_bag(_file(directory, found.bag, trial) if found.bag else directory, topics)
    battery: Any = make_channel("battery", maps["battery"], tables["battery"]) if "battery" in maps else None
    return {kind: make_channel(kind, channel, tables[kind], battery) for kind, channel in maps.items()}


def _file(directory: Path, pattern: str, trial: str | None) -> Path:
    return directory / (pattern if trial is None else pattern.replace(TRIAL, trial))


def _time_of(bound: Bound, default: float, directory: Path, trial: str | None, pose: Any, after: float) -> float:
    """Time of a start or an end, s; a position is searched from `after` on, and infinite if it is never reached."""
    if bound.time is not None:
        return bound.time
    if bound.file is not None:
        return _value_of(_file(directory, bound.file, trial), bound.key or "")
    if math.isinf(bound.above) and math.isinf(bound.below):
        return default
    height = pose.position[:, bound.axis]
    beyond = (pose.time >= after) & ((height > bound.above) | (height < bound.below))
    return float(pose.time[np.argmax(beyond)]) if beyond.any() else math.inf


def _value_of(path: Path, key: str) -> float:
    with reading(path):
        text = read_text(path, encoding="utf-8-sig")
    lines = [line.partition("#")[0].partition(":") for line in text.splitlines()]
    values = {name.strip(): value.strip() for name, colon, value in lines if colon}
    if key not in values:
        raise LogError(f"{path}: {key}: no such key; keys: {', '.join(values) or 'none'}")
    try:
        number = float(values[key])
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise LogError(f"{path}: {key}: {values[key]!r} is not a finite number")
    return number
