"""Topics of ROS bags, as tables."""

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from operator import attrgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym._files import replacing
from uvms_gym.logs.channel_map import ChannelMap
from uvms_gym.logs.errors import LogError
from uvms_gym.logs.tables import Table, make_table
from uvms_gym.logs.units import Floats

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
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
#: Stamp, in place of the name of a column.
_STAMP = "stamp"


class _Unnamed(Exception):
    """The message has no entry of this name."""


class _Topic:
    """Rows of one channel, message by message."""

    def __init__(self, place: str, channel: ChannelMap) -> None:
        self._place = place
        self._channel = channel
        self._names: dict[str, list[str]] = {}
        self._getters: dict[str, Getter] = {}
        self._header = False
        # Time of recording, stamp of the header and numbers; None where another publisher's message lacks the name.
        self._rows: list[list[float | None]] = []
        self._entries: set[str] = set()

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
        header = (stamp.sec * 10**9 + stamp.nanosec) / 10**9 if stamp else 0.0
        row: list[float | None] = [recorded / 10**9, header]
        for name, get in self._getters.items():
            try:
                row.append(float(get(message)))
            except _Unnamed:
                row.append(None)
                self._entries.update(map(str, message.name))
            except (AttributeError, IndexError, TypeError, ValueError):
                place, known = self._where(len(self._rows)), _listed(message)
                raise LogError(f"{place}: {name}: no such number; fields: {known}") from None
        self._rows.append(row)

    def table(self) -> Table:
        """Table of all messages."""
        if not self._rows:
            raise LogError(f"{self._place}: no messages")
        absent = np.array([[number is None for number in row] for row in self._rows])
        rows = np.array(self._rows, dtype=np.float64)
        for k, name in enumerate(self._getters, 2):
            if absent[:, k].all():
                known = ", ".join(sorted(self._entries))
                raise LogError(f"{self._place}: {name}: no message has this name; names: {known}")
        notes: list[str] = []
        stamped = self._stamp(rows, notes)
        ours = ~absent[:, 2 if self._channel.time is None else 3 :].all(axis=1)
        dropped = {"unstamped messages": int(np.sum(~stamped)), "messages of others": int(np.sum(stamped & ~ours))}
        where = np.flatnonzero(stamped & ours)
        time = _STAMP if self._channel.time is None else self._channel.time
        if absent[where].any():
            where = self._join(rows, absent, where, notes)
        columns = {_STAMP: rows[where, 0], **dict(zip(self._getters, rows[where, 2:].T))}
        place = lambda row: self._where(int(where[row]))  # noqa: E731
        return make_table(self._place, place, columns, time, self._names, len(rows), dropped, notes)

    def _stamp(self, rows: Floats, notes: list[str]) -> Mask:
        """Put the messages' stamps into the first column; True for messages that have one."""
        every = np.ones(len(rows), np.bool_)
        if not self._header or self._channel.time is not None:
            return every
        # (A simulator's recording begins at 0.)
        stamped: Mask = (rows[:, 1] != 0.0) | (rows[:, 0] == 0.0)
        if rows[:, 1].any():
            rows[:, 0] = rows[:, 1]
            return stamped
        if self._channel.stamp == "header":
            problem = "the header's stamps are all 0"
            raise LogError(f'{self._place}: {problem}; stamp = "bag" reads the times of recording')
        notes.append("times of recording, as the header's stamps are all 0")
        return every

    def _join(self, rows: Floats, absent: Mask, where: Indices, notes: list[str]) -> Indices:
        """Interpolate names of other publishers at the messages of the name that has the most; their indices."""
        names, first = list(self._getters), 2 if self._channel.time is None else 3
        time = (rows[:, 0] if self._channel.time is None else rows[:, 2]) * self._channel.time_factor
        most = first + int(np.argmin(np.sum(absent[where, first:], axis=0)))
        own: Indices = where[~absent[where, most]]
        for k in np.flatnonzero(absent[own].any(axis=0)):
            theirs = where[~absent[where, k]]
            theirs = theirs[np.argsort(time[theirs], kind="stable")]
            near = (time[own] >= time[theirs[0]]) & (time[own] <= time[theirs[-1]])
            after = np.clip(np.searchsorted(time[theirs], time[own]), 1, len(theirs) - 1)
            near &= time[theirs][after] - time[theirs][after - 1] <= self._channel.gap
            rows[own, k] = np.where(near, np.interp(time[own], time[theirs], rows[theirs, k]), np.nan)
            notes.append(f"{names[k - 2]} interpolated at the messages of {names[most - 2]}")
        return own

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

    `path` is the directory of a ROS 2 bag (SQLite or MCAP), an MCAP file, or the file of a ROS 1 bag. Of an MCAP that
    is cut or damaged the messages before the damage are read.

    Returns
    -------
    dict of str to Table
        Table of every channel.
    """
    try:
        import rosbags.highlevel  # noqa: F401
    except ImportError:
        raise LogError(f"{path}: reading bags needs the package rosbags: pip install 'uvms-gym[ros2]'") from None
    if not path.exists():
        raise LogError(f"{path}: no such bag")
    _check_files(path)
    # A recorder that was killed leaves no metadata.
    files = sorted(path.glob("*.mcap")) if path.is_dir() and not (path / "metadata.yaml").exists() else []
    bag = files[0] if len(files) == 1 else path
    try:
        return {kind: topic.table() for kind, topic in _read_topics(path, bag, channels).items()}
    except LogError:
        raise
    except Exception as error:  # (a damaged bag fails anywhere in the package, in its parsers and in SQLite)
        reason = " ".join(str(error).split()) or type(error).__name__
    with TemporaryDirectory() as folder:
        copy, count = _recover(bag, Path(folder)) if bag.suffix == ".mcap" and bag.is_file() else (bag, 0)
        if count == 0:
            raise LogError(f"{path}: cannot be read: {reason}")
        tables = {kind: topic.table() for kind, topic in _read_topics(path, copy, channels).items()}
    note = f"cut or damaged recording: {count} messages before the damage are read"
    return {kind: replace(table, notes=(*table.notes, note)) for kind, table in tables.items()}


def _read_topics(path: Path, bag: Path, channels: Mapping[str, ChannelMap]) -> dict[str, _Topic]:
    """Messages of the channels' topics in a bag; errors name `path`."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    topics = {kind: _Topic(f"{path} {channel.topic}", channel) for kind, channel in channels.items()}
    with AnyReader([bag], default_typestore=get_typestore(Stores.LATEST)) as reader:
        for kind, channel in channels.items():
            if channel.topic not in reader.topics:
                known = ", ".join(sorted(reader.topics)) or "none"
                raise LogError(f"{path}: {kind}: no topic {channel.topic}; topics: {known}")
        wanted = {channel.topic for channel in channels.values()}
        connections = [connection for connection in reader.connections if connection.topic in wanted]
        if (count := sum(connection.msgcount for connection in connections)) > _MESSAGES:
            raise LogError(f"{path}: {count} messages in these topics, but at most {_MESSAGES} are read")
        for connection, recorded, data in reader.messages(connections=connections):
            try:
                message = reader.deserialize(data, connection.msgtype)
            except KeyError:
                raise LogError(
                    f"{path}: {connection.topic}: the bag has no definition of {connection.msgtype}; "
                    "`ros2 bag record -s mcap` records definitions"
                ) from None
            for kind, channel in channels.items():
                if channel.topic == connection.topic:
                    topics[kind].append(message, recorded)
    return topics


def _recover(path: Path, folder: Path) -> tuple[Path, int]:
    """Copy of an MCAP file with the messages before its damage, and their number."""
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader
    from mcap.writer import Writer

    copy, count, schemas, topics = folder / path.name, 0, {0: 0}, {}
    with path.open("rb") as file, replacing(copy) as out:
        writer: Any = Writer(out)
        writer.start(profile="ros2")
        with suppress(Exception):  # (the damage)
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, Schema) and record.id not in schemas:
                    schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
                elif isinstance(record, Channel) and record.id not in topics:
                    known = record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
                    topics[record.id] = writer.register_channel(*known)
                elif isinstance(record, Message):
                    times = record.log_time, record.data, record.publish_time, record.sequence
                    writer.add_message(topics[record.channel_id], *times)
                    count += 1
        writer.finish()
    return copy, count


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

    def named(message: Any) -> float:
        values, names = get(message), list(message.name)
        if entry not in names:
            raise _Unnamed
        return float(values[names.index(entry)])

    return named


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
