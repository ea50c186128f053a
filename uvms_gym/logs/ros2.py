"""Topics of ROS bags, as tables."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from uvms_gym.logs.errors import LogError
from uvms_gym.logs.map import ChannelMap
from uvms_gym.logs.tables import Table, make_table

#: Fields of the usual messages that contain a quantity; the first one that a message has is read.
FIELDS = {
    "position": ("pose.pose.position", "pose.position", "position", "transform.translation"),
    "attitude": ("pose.pose.orientation", "pose.orientation", "orientation", "quaternion", "transform.rotation"),
    "velocity": ("twist.twist.linear", "twist.linear", "linear", "velocity", "vector"),
    "angular_velocity": ("twist.twist.angular", "twist.angular", "angular", "angular_velocity", "vector"),
    "specific_force": ("linear_acceleration", "accel.linear", "linear", "vector"),
}

#: Maximum size of a bag, bytes, and maximum number of messages of its topics that are read.
_BYTES, _MESSAGES = 64_000_000_000, 10_000_000

Getter = Callable[[Any], float]
#: Stamp, in place of the name of a column.
_STAMP = "stamp"


class _Topic:
    """Rows of one channel, message by message."""

    def __init__(self, place: str, channel: ChannelMap) -> None:
        self._place = place
        self._channel = channel
        self._names: dict[str, list[str]] = {}
        self._getters: dict[str, Getter] = {}
        self._header = False
        self._rows: list[list[float]] = []

    def append(self, message: Any, recorded: int) -> None:
        """Add a message, which the bag recorded at a time in ns."""
        channel = self._channel
        if not self._rows:
            self._names = {key: names or self._default(key, message) for key, names in channel.names.items()}
            names = [name for group in self._names.values() for name in group]
            self._getters = {name: _getter(name) for name in ([channel.time] if channel.time else []) + names}
            self._header = channel.stamp != "bag" and hasattr(message, "header")
            if channel.stamp == "header" and not self._header:
                raise LogError(f'{self._place}: no header; stamp = "bag" reads the times of recording')
        stamp = message.header.stamp if self._header else None
        row = [float(stamp.sec + stamp.nanosec * 1e-9) if stamp else recorded * 1e-9]
        for name, get in self._getters.items():
            try:
                row.append(float(get(message)))
            except (AttributeError, IndexError, TypeError, ValueError):
                place, known = self._where(len(self._rows)), _listed(message)
                raise LogError(f"{place}: {name}: no such number; fields: {known}") from None
        self._rows.append(row)

    def table(self) -> Table:
        """Table of all messages."""
        if not self._rows:
            raise LogError(f"{self._place}: no messages")
        columns = dict(zip([_STAMP, *self._getters], np.array(self._rows).T))
        return make_table(self._place, self._where, columns, self._channel.time or _STAMP, self._names)

    def _where(self, row: int) -> str:
        return f"{self._place}, message {row + 1}"

    def _default(self, quantity: str, message: Any) -> list[str]:
        parts = ("w", "x", "y", "z") if quantity == "attitude" else ("x", "y", "z")
        for base in FIELDS[quantity]:
            names = [f"{base}.{part}" for part in parts]
            try:
                [float(attrgetter(name)(message)) for name in names]
            except (AttributeError, TypeError, ValueError):
                continue
            return names
        raise LogError(f"{self._place}: no field for {quantity}; the map names columns, of: {_listed(message)}")


def read_bag(path: Path, channels: Mapping[str, ChannelMap]) -> dict[str, Table]:
    """Read the topics of channels from a bag.

    `path` is the directory of a ROS 2 bag (SQLite or MCAP), or the file of a ROS 1 bag.

    Returns
    -------
    dict of str to Table
        Table of every channel.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LogError(f"{path}: reading bags needs the package rosbags: pip install 'uvms-gym[ros2]'") from None
    if not path.exists():
        raise LogError(f"{path}: no such bag")
    _check_files(path)
    topics = {kind: _Topic(f"{path} {channel.topic}", channel) for kind, channel in channels.items()}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            for kind, channel in channels.items():
                if channel.topic not in reader.topics:
                    known = ", ".join(sorted(reader.topics)) or "none"
                    raise LogError(f"{path}: {kind}: no topic {channel.topic}; topics: {known}")
            wanted = {channel.topic for channel in channels.values()}
            connections = [connection for connection in reader.connections if connection.topic in wanted]
            if (count := sum(connection.msgcount for connection in connections)) > _MESSAGES:
                raise LogError(f"{path}: {count} messages in these topics, but at most {_MESSAGES} are read")
            for connection, recorded, data in reader.messages(connections=connections):
                message = reader.deserialize(data, connection.msgtype)
                for kind, channel in channels.items():
                    if channel.topic == connection.topic:
                        topics[kind].append(message, recorded)
    except LogError:
        raise
    except Exception as error:  # (a damaged bag fails anywhere in the package, in its parsers and in SQLite)
        raise LogError(f"{path}: cannot be read: {' '.join(str(error).split())}") from None
    return {kind: topic.table() for kind, topic in topics.items()}


def _check_files(path: Path) -> None:
    """Refuse a bag by its files before any is read: pipes and devices have no end."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    for file in files:
        if file.exists() and not (file.is_file() or file.is_dir()):
            raise LogError(f"{file}: cannot be read: not a regular file")
    if (size := sum(file.stat().st_size for file in files if file.is_file())) > _BYTES:
        raise LogError(f"{path}: {size} bytes, but at most {_BYTES} are read")


def _getter(name: str) -> Getter:
    """Number of a message: a field, its entry by number, or by the name that the message's `name` gives to it."""
    found = re.fullmatch(r"([\w.]+)\[([^\[\]]+)\]", name)
    if not found:
        return attrgetter(name)
    get, entry = attrgetter(found[1]), found[2]
    if entry.isdecimal():
        return lambda message: get(message)[int(entry)]
    return lambda message: get(message)[list(message.name).index(entry)]


def _listed(message: Any) -> str:
    return ", ".join(_fields(message, "")) or "none"


def _fields(value: Any, path: str) -> Iterator[str]:
    if is_dataclass(value):
        for field in fields(value):
            if field.name != "__msgtype__":
                yield from _fields(getattr(value, field.name), f"{path}.{field.name}" if path else field.name)
    elif isinstance(value, np.ndarray | list):
        if len(value) > 0:
            yield f"{path}[0 to {len(value) - 1}]"
    elif isinstance(value, int | float):
        yield path
