"""Logs of autopilots, as tables: ArduPilot's .BIN, MAVLink's .tlog and PX4's .ulg."""

import io
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym._files import read
from uvms_gym.logs.channel_map import ChannelMap
from uvms_gym.logs.errors import LogError, reading
from uvms_gym.logs.tables import MAX_BYTES, Table, make_table
from uvms_gym.logs.units import Floats

Columns = dict[str, NDArray[Any]]
#: Start of every message of ArduPilot's .BIN.
_HEADER = b"\xa3\x95"
#: Stamp, in place of the name of a column.
_STAMP = "stamp"


@dataclass(frozen=True)
class _Messages:
    """Messages of one type."""

    #: (n,) stamps, s; None where the type has none.
    time: Floats | None
    #: (n,) number of the sensor, the instance or the system that each message is from.
    publisher: NDArray[np.int64]
    #: (n,) numbers of each field; entries of arrays are "field[3]".
    columns: Columns
    #: Number of messages of the type that are damaged.
    damaged: int
    notes: list[str]


def read_flight_log(path: Path, channels: Mapping[str, ChannelMap]) -> dict[str, Table]:
    """Read the messages of channels from an autopilot's log; its suffix is one of `READERS`.

    Returns
    -------
    dict of str to Table
        Table of every channel.
    """
    reader = READERS[path.suffix.lower()]
    wanted = {str(channel.message) for channel in channels.values()}
    try:
        with reading(path):
            found, known = reader(path, wanted)
    except ModuleNotFoundError as error:
        missing = f"reading this log needs the package {str(error.name).partition('.')[0]}"
        raise LogError(f"{path}: {missing}: pip install 'uvms-gym[flight]'") from None
    except LogError:
        raise
    except Exception as error:  # (a damaged log fails anywhere in the packages)
        raise LogError(f"{path}: cannot be read: {' '.join(str(error).split()) or type(error).__name__}") from None
    for kind, channel in channels.items():
        if channel.message not in found:
            names = ", ".join(sorted(known)) or "none"
            raise LogError(f"{path}: {kind}: no message {channel.message}; messages: {names}")
    return {kind: _table(path, channel, found[str(channel.message)]) for kind, channel in channels.items()}


def _table(path: Path, channel: ChannelMap, messages: _Messages) -> Table:
    """Table of the messages of one publisher: by default the first one's."""
    source = f"{path} {channel.message}"
    names = {key: group or [] for key, group in channel.names.items()}
    time = channel.time or _STAMP
    columns: Columns = messages.columns if messages.time is None else messages.columns | {_STAMP: messages.time}
    for name in [time, *(name for group in names.values() for name in group)]:
        if name == _STAMP and name not in columns:
            raise LogError(f"{source}: the messages have no stamp; time.column names one")
        if name not in columns:
            raise LogError(f"{source}: {name}: no such number; fields: {', '.join(messages.columns)}")
    publishers = np.unique(messages.publisher)
    wanted = messages.publisher[0] if channel.instance is None else channel.instance
    if wanted not in publishers:
        raise LogError(f"{source}: no instance {wanted}; instances: {', '.join(map(str, publishers))}")
    ours = np.flatnonzero(messages.publisher == wanted)
    used = list(dict.fromkeys([time, *(name for group in names.values() for name in group)]))
    return make_table(
        source,
        lambda row: f"{source}, message {ours[row] + 1}",
        {name: np.asarray(columns[name][ours], dtype=np.float64) for name in used},
        time,
        names,
        len(messages.publisher) + messages.damaged,
        {"damaged messages": messages.damaged, "messages of others": len(messages.publisher) - len(ours)},
        messages.notes,
    )


def _fields(rows: NDArray[Any], factors: Mapping[str, float] = {}) -> Columns:
    """Numbers of each field of messages, in float64 where a factor scales them; texts are left out."""
    columns: Columns = {}
    for name in rows.dtype.names or ():
        field = rows[name]
        if field.dtype.kind == "S":
            continue
        # (By division, which is exact for decimal fractions: 1e-7 is not a binary number.)
        field = field / round(1.0 / factors[name]) if name in factors else field
        columns |= {name: field} if field.ndim == 1 else {f"{name}[{k}]": field[:, k] for k in range(field.shape[1])}
    return columns


Found = tuple[dict[str, _Messages], set[str]]


def _read_dataflash(path: Path, wanted: set[str]) -> Found:
    """Messages by their names, and the names of all messages, of ArduPilot's .BIN."""
    from pymavlink.DFReader import FORMAT_TO_STRUCT, DFFormat

    data = read(path, MAX_BYTES)
    if data[:3] != _HEADER + b"\x80":
        raise LogError(f"{path}: cannot be read: not ArduPilot's .BIN, which begins with the format of its messages")
    formats = {0x80: DFFormat(0x80, "FMT", 89, "BBnNZ", "Type,Length,Name,Format,Columns")}
    offsets: dict[int, list[int]] = {}
    damaged: dict[int, int] = {}
    k = used = 0
    while 0 <= k < len(data) - 2:
        found = formats.get(data[k + 2])
        end = k + (found.len if found else 0)
        # A message that is cut is followed by no header.
        if found and end <= len(data) and data[end : end + 2] in (_HEADER, _HEADER[:1], b""):
            offsets.setdefault(found.type, []).append(k)
            if found.name in ("FMT", "FMTU"):
                _describe(formats, found, data[k + 3 : end])
            used += end - k
            k = end
        else:
            damaged[data[k + 2]] = damaged.get(data[k + 2], 0) + 1
            k = data.find(_HEADER, k + 1)
    notes = [f"bytes that are no messages: {len(data) - used}"] if used < len(data) else []
    names = {formats[number].name: number for number in offsets}
    messages = {}
    for name in wanted & names.keys():
        found = formats[names[name]]
        kinds = [(column, _kind(FORMAT_TO_STRUCT[c][0], c)) for column, c in zip(found.columns, found.format)]
        record = np.dtype([("head", "S3"), *kinds])
        at = np.array(offsets[found.type])[:, None] + np.arange(record.itemsize)
        rows = np.frombuffer(data, np.uint8)[at].view(record)[:, 0]
        factors = {column: FORMAT_TO_STRUCT[c][1] for column, c in zip(found.columns, found.format)}
        columns = _fields(rows, {column: factor for column, factor in factors.items() if factor})
        ticks = {"TimeUS": 1e-6, "TimeMS": 1e-3}
        time = next((columns[key] * factor for key, factor in ticks.items() if key in columns), None)
        publisher = rows[found.instance_field] if found.instance_field in columns else np.zeros(len(rows))
        messages[name] = _Messages(time, publisher.astype(np.int64), columns, damaged.get(found.type, 0), notes)
    return messages, set(names)


def _describe(formats: dict[int, Any], found: Any, data: bytes) -> None:
    """Add the format of a type, or the units of its fields, which name the instance."""
    from pymavlink.DFReader import FORMAT_TO_STRUCT, DFFormat

    values = struct.unpack(found.msg_struct, data)
    if found.name == "FMT":
        number, length, *words = values
        name, layout, columns = (word.split(b"\0")[0].decode("latin-1") for word in words)
        if length == 3 + sum(struct.calcsize("<" + FORMAT_TO_STRUCT[letter][0]) for letter in layout):
            formats[number] = DFFormat(number, name, length, layout, columns)
    elif (described := formats.get(values[1])) is not None:
        described.set_unit_ids(values[2].split(b"\0")[0].decode("latin-1"), {})


def _kind(layout: str, letter: str) -> Any:
    """Type of a field in NumPy's words."""
    if letter == "a":
        return ("<i2", 32)
    return f"S{layout[:-1]}" if layout.endswith("s") else f"<{layout}"


def _read_mavlink(path: Path, wanted: set[str]) -> Found:
    """Messages by their names, and the names of all messages, of MAVLink's .tlog."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    types = dialect.mavlink_map
    rows: dict[int, list[tuple[int, int, bytes]]] = {}
    damaged = [0]
    for stamp, system, number, payload in _packets(read(path, MAX_BYTES), types, dialect.x25crc, damaged):
        kind = rows.setdefault(number, [])
        if number in types and (types[number].msgname in wanted or not kind):
            kind.append((stamp, system, payload))
    if not rows:
        raise LogError(f"{path}: cannot be read: no MAVLink messages")
    notes = [f"CRC errors: {damaged[0]} messages of the file left out"] if damaged[0] else []
    messages, names = {}, {types[number].msgname: number for number in rows if number in types}
    for name in wanted & names.keys():
        kind = types[names[name]]
        stamps, systems, payloads = zip(*rows[kind.id])
        size = kind.unpacker.size
        lengths = [(length,) if length else () for length in kind.array_lengths]
        letters = [f"<{letter}" if letter != "c" else "S1" for letter in kind.native_format.decode()[1:]]
        record = np.dtype(list(zip(kind.ordered_fieldnames, letters, lengths)))
        # (Zeros at the end of a payload are not sent.)
        found = np.frombuffer(b"".join(payload[:size].ljust(size, b"\0") for payload in payloads), record)
        columns = {key: column for key in kind.fieldnames for key, column in _fields(found[[key]]).items()}
        messages[name] = _Messages(np.array(stamps) * 1e-6, np.array(systems), columns, 0, notes)
    return messages, set(names)


def _packets(
    data: bytes, types: Mapping[int, Any], crc: Callable[[bytes], Any], damaged: list[int]
) -> Iterator[tuple[int, int, int, bytes]]:
    """Stamp in us, system, number and payload of every packet; a stamp of eight bytes is before each.

    A packet with a CRC error, or bytes without a packet, count once in `damaged`.
    """
    k, sound = 0, True
    while k + 8 + 8 <= len(data):
        start = k + 8
        second, size = data[start] == 0xFD, data[start + 1]
        head = 10 if second else 6
        end = start + head + size
        length = end + 2 - start + (13 if second and data[start + 2] & 1 else 0)
        whole = (second or data[start] == 0xFE) and start + length <= len(data)
        number = int.from_bytes(data[start + 7 : start + 10], "little") if second else data[start + 5]
        next_marker = start + length + 8
        followed = next_marker >= len(data) or data[next_marker] in (0xFD, 0xFE)
        skippable = sound and whole and followed
        good = skippable
        if whole and number in types:
            check = crc(data[start + 1 : end] + bytes([types[number].crc_extra])).crc
            good = check == int.from_bytes(data[end : end + 2], "little")
        if good:
            yield (
                int.from_bytes(data[k:start], "big"),
                data[start + (5 if second else 3)],
                number,
                data[end - size : end],
            )
        damaged[0] += sound and not good
        # After bytes that are no packet, only a packet with the right CRC counts.
        sound = good or skippable
        k += 8 + length if sound else 1
    damaged[0] += sound and k < len(data)


def _read_ulog(path: Path, wanted: set[str]) -> Found:
    """Messages by their names, and the names of all messages, of PX4's .ulg."""
    from pyulog import ULog

    data, lost = _sound_ulog(read(path, MAX_BYTES))
    log = ULog(io.BytesIO(data), sorted(wanted))
    notes = [f"bytes that are no messages: {lost}"] if lost else []
    if log.dropouts:
        notes.append(f"dropouts: {len(log.dropouts)}, {sum(gap.duration for gap in log.dropouts) / 1e3:.3g} s")
    if log.file_corruption:
        notes.append("damaged parts are left out")
    messages = {}
    for name in wanted:
        topics = [topic for topic in log.data_list if topic.name == name]
        if topics:
            columns = {key: np.concatenate([topic.data[key] for topic in topics]) for key in topics[0].data}
            publisher = np.repeat(
                [topic.multi_id for topic in topics], [len(topic.data["timestamp"]) for topic in topics]
            )
            messages[name] = _Messages(columns["timestamp"] * 1e-6, publisher, columns, 0, notes)
    return messages, set(log.message_formats)


#: Kinds of messages of PX4's .ulg; those with data, and those that subscribe to a topic.
_ULOG, _DATA, _SUBSCRIPTION = frozenset(b"BFIMPQAaRDLCSO"), ord("D"), ord("A")


def _sound_ulog(data: bytes) -> tuple[bytes, int]:
    """A .ulg without damaged messages, and the number of bytes left out.

    The package pyulog reads nothing behind lost bytes, as it takes wrong lengths there.
    """
    #: Size of the messages of each subscription, 0 before its first.
    sizes: dict[bytes, int] = {}

    def end_of(k: int) -> int:
        """End of the message at k; 0 where none fits."""
        if k + 3 > len(data):
            return 0
        end, kind = k + 3 + data[k] + 256 * data[k + 1], data[k + 2]
        if kind not in _ULOG or end > len(data):
            return 0
        if kind == _DATA:
            return end if sizes.get(data[k + 3 : k + 5], -1) in (0, end - k) else 0
        if kind == _SUBSCRIPTION:
            sizes.setdefault(data[k + 4 : k + 6], 0)
        return end

    parts, start, k, end = [], 0, 16, end_of(16)
    while k < len(data):
        following = end_of(end) if end else 0
        # A message that is cut is followed by none.
        if following or end == len(data):
            if data[k + 2] == _DATA:
                sizes[data[k + 3 : k + 5]] = end - k
            k, end = end, following
            continue
        if start < k:
            parts.append(data[start:k])
        # Behind the damage only data count, whose size is known.
        k = start = k + 1
        while k + 3 <= len(data) and not (data[k + 2] == _DATA and end_of(k)):
            k = start = k + 1
        if k + 3 > len(data):
            break
        end = end_of(k)
    sound = b"".join([*parts, data[start:k]])
    return sound, len(data) - len(sound)


#: Readers by the suffix of files.
READERS: dict[str, Callable[[Path, set[str]], Found]] = {
    ".bin": _read_dataflash,
    ".tlog": _read_mavlink,
    ".ulg": _read_ulog,
}
