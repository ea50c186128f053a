"""Map of one channel of a log: its file or topic, columns, units, axes and clock."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uvms_gym.logs import units
from uvms_gym.logs.curves import CURVES, Curve, curve_of, read_curve
from uvms_gym.logs.keys import Keys
from uvms_gym.logs.tables import TextFormat

#: Quantities of the channels, with their units; the first one is required.
QUANTITIES: dict[str, dict[str, Mapping[str, float]]] = {
    "pose": {"position": units.LENGTH},
    "attitude": {},
    "twist": {"velocity": units.SPEED, "angular_velocity": units.ANGULAR_SPEED},
    "imu": {"angular_velocity": units.ANGULAR_SPEED, "specific_force": units.ACCELERATION},
    "joints": {},
    "thrusters": {},
    "battery": {"voltage": units.VOLTAGE},
}
#: Channels with an attitude, and those that must have it.
ORIENTED = {"pose": True, "attitude": True, "imu": False}
#: Endings of autopilots' logs: ArduPilot's, MAVLink's and PX4's.
FLIGHT = (".bin", ".tlog", ".ulg")


@dataclass(frozen=True)
class Columns:
    """Columns of a quantity."""

    #: Names; None: the fields of a message.
    names: tuple[str, ...] | None
    #: Factor to SI units.
    factor: float = 1.0
    #: Order of a quaternion, or roll, pitch, yaw.
    order: str | None = None


@dataclass(frozen=True)
class Axis:
    """Joint or thruster: value = factor * column - offset, in the scene's units.

    With a curve, value = factor * curve(column) - offset.
    """

    #: Name in the scene.
    name: str
    #: Columns of value and velocity; a value without column is the constant -offset.
    column: str | None = None
    velocity: str | None = None
    factor: float = 0.0
    offset: float = 0.0
    #: Thrust over the column.
    curve: Curve | None = None


@dataclass(frozen=True, kw_only=True)
class ChannelMap:
    """Source of a channel and its conversion."""

    #: Table of the map, for errors.
    place: Keys
    #: Name of the file, in which "{trial}" is replaced, or topic of a bag: one of them.
    file: str | None
    topic: str | None
    #: Type of the messages of an autopilot's log, and their publisher; None: the first message's.
    message: str | None
    instance: int | None
    #: Format of the file's lines.
    text: TextFormat
    #: Column of stamps; None: the stamps of a topic's messages, or of an autopilot's.
    time: str | None
    #: Stamps of a topic's messages; None: the header's, where there is one.
    stamp: str | None
    #: Factor of the stamps to seconds.
    time_factor: float
    #: Lateness of the stamps, s.
    lag: float
    #: Rows whose stamps are before an earlier row's: an error ("refuse"), sorted ("sort") or left out ("drop").
    backwards: str
    #: Longest interval between samples that is interpolated, s.
    gap: float
    #: Maximum angle between the attitudes of neighbouring samples, rad.
    jump: float
    #: Shortest interval between rows of equal values, s; 0: all rows remain.
    repeat_period: float
    #: Rotations from the source's axes to the library's, [w, x, y, z].
    world: tuple[float, ...]
    body: tuple[float, ...]
    #: Columns of each quantity.
    columns: Mapping[str, Columns]
    #: Joints or thrusters.
    axes: tuple[Axis, ...]
    #: Supply voltage of the thrusters, V; None: the battery's.
    supply: float | None

    @property
    def names(self) -> dict[str, list[str] | None]:
        """Names of the columns of each quantity; None: the fields of a message."""
        names = {key: None if group.names is None else list(group.names) for key, group in self.columns.items()}
        names["value"] = [axis.column for axis in self.axes if axis.column]
        names["rate"] = [axis.velocity for axis in self.axes if axis.velocity]
        return {key: group for key, group in names.items() if group is None or group}


def channel_map(kind: str, keys: Keys, gap: float) -> ChannelMap:
    """Read the table of a channel; `gap` is the map's."""
    _exclusive(keys, "file", "topic")
    topic = keys.text("topic") if keys.has("topic") else None
    file = None if topic else keys.text("file")
    binary = file is not None and file.lower().endswith(FLIGHT)
    time = keys.table("time")
    if topic is None and not binary:
        time.require("column")
    column = time.text("column") if time.has("column") else None
    columns = _columns(kind, keys, topic is not None)
    found = ChannelMap(
        place=keys,
        file=file,
        topic=topic,
        message=keys.text("message") if binary else None,
        instance=keys.count("instance") if binary else None,
        text=TextFormat() if topic or binary else _text_format(keys),
        time=column,
        stamp=time.choice("stamp", ("header", "bag")) if topic and not column and time.has("stamp") else None,
        time_factor=units.TIME[time.choice("unit", units.TIME, "s")] if column else 1.0,
        lag=time.number("lag", 0.0),
        backwards=time.choice("backwards", ("refuse", "sort", "drop"), "refuse"),
        gap=keys.number("gap", math.inf if kind == "battery" else gap, above=0.0, finite=False),
        jump=np.radians(keys.number("jump_deg", math.inf, above=0.0)) if "attitude" in columns else math.inf,
        repeat_period=keys.number("repeat_period", 0.0, above=0.0) if kind == "joints" else 0.0,
        world=units.WORLD[keys.choice("world", units.WORLD, "nwu")] if kind in ORIENTED else units.WORLD["nwu"],
        body=units.BODY["flu" if kind in ("joints", "thrusters") else keys.choice("body", units.BODY, "flu")],
        columns=columns,
        axes=_axes(kind, keys),
        supply=keys.number("voltage", 0.0, above=0.0) if kind == "thrusters" and keys.has("voltage") else None,
    )
    for axis in found.axes if found.supply is not None else ():
        if axis.curve is not None and len(axis.curve.voltage):
            low, high = axis.curve.voltage[[0, -1]]
            if not low <= found.supply <= high:
                problem = f"is outside of the curve of {axis.name}, {low:g} to {high:g} V"
                raise keys.error("voltage", f"{found.supply:g} V {problem}")
    time.finish()
    keys.finish()
    return found


def _exclusive(keys: Keys, one: str, other: str, required: bool = True) -> None:
    """Refuse both of two keys, and neither of them where one is required."""
    if keys.has(one) + keys.has(other) == 2:
        raise keys.error(None, f"{one} or {other}, not both")
    if required:
        keys.require(one, other)


def _text_format(keys: Keys) -> TextFormat:
    delimiter = keys.text("delimiter") if keys.has("delimiter") else ","
    if delimiter not in (",", ";", "\t", " ", "|"):
        raise keys.error("delimiter", f"{delimiter!r} is none of ',', ';', '|', a tab and a space")
    decimal = keys.choice("decimal", (".", ",")) if keys.has("decimal") else None
    comment = keys.text("comment") if keys.has("comment") else "#"
    return TextFormat(delimiter, decimal, comment, frozenset(_skipped(keys)))


def _skipped(keys: Keys) -> Sequence[int]:
    """Numbers of the lines to leave out: of the first ones by their count, or a list."""
    value = keys.value("skip")
    numbers = [] if value is None else value if isinstance(value, list) else [value]
    if not all(isinstance(number, int) and not isinstance(number, bool) and number >= 1 for number in numbers):
        raise keys.error("skip", f"{value!r} is neither a count of first lines nor a list of lines' numbers, from 1")
    return numbers if isinstance(value, list) else range(1, sum(numbers) + 1)


def _columns(kind: str, keys: Keys, topic: bool) -> dict[str, Columns]:
    columns = {}
    for k, (quantity, allowed) in enumerate(QUANTITIES[kind].items()):
        if keys.has(quantity) or (k == 0 and topic):
            columns[quantity] = _group(keys.table(quantity), topic, allowed)
        elif k == 0:
            keys.require(quantity)
    if kind in ORIENTED:
        _exclusive(keys, "quaternion", "rpy", required=ORIENTED[kind] and not topic)
        if keys.has("rpy"):
            columns["attitude"] = replace(_group(keys.table("rpy"), False, units.ANGLE), order="rpy")
        elif keys.has("quaternion") or (ORIENTED[kind] and topic):
            columns["attitude"] = _group(keys.table("quaternion"), topic)
    return columns


def _group(keys: Keys, topic: bool, allowed: Mapping[str, float] | None = None) -> Columns:
    """Columns of a vector with their unit, or of a quaternion with their order, which has no default."""
    if not topic:
        keys.require("columns")
    names = keys.texts("columns", 4 if allowed is None else 1 if allowed is units.VOLTAGE else 3)
    if allowed:
        found = Columns(names, allowed[keys.choice("unit", allowed, next(iter(allowed)))])
    else:
        found = Columns(names, order=keys.choice("order", ("wxyz", "xyzw")) if names else "wxyz")
    keys.finish()
    return found


def _axes(kind: str, keys: Keys) -> tuple[Axis, ...]:
    if kind not in ("joints", "thrusters"):
        return ()
    table = keys.table("axes")
    axes = tuple(_axis(kind, name, table.table(name)) for name in table)
    if not any(axis.column for axis in axes):
        raise keys.error("axes", f"a table with the columns of the scene's {kind} by name is expected")
    lacking = [axis.name for axis in axes if axis.column and not axis.velocity]
    if lacking and any(axis.velocity for axis in axes):
        raise table.error(lacking[0], "velocity is missing; all joints have one or none")
    return axes


def _axis(kind: str, name: str, keys: Keys) -> Axis:
    """Joint, sign * column - zero in its unit; or thruster, N, scale * (column - neutral) or scale * curve(column)."""
    column, lengths = {"joints": "position", "thrusters": "command"}[kind], units.ANGLE | units.LENGTH
    unit = lengths[keys.choice("unit", lengths, "rad")] if kind == "joints" else 1.0
    _exclusive(keys, column, "value")
    if keys.has("value"):
        axis = Axis(name, offset=-keys.number("value", 0.0) * unit)
    elif kind == "joints":
        if abs(sign := keys.number("sign", 1.0)) != 1.0:
            raise keys.error("sign", f"{sign:g} is neither 1 nor -1")
        velocity = keys.text("velocity") if keys.has("velocity") else None
        axis = Axis(name, keys.text(column), velocity, sign * unit, keys.number("zero", 0.0) * unit)
    else:
        if (scale := keys.number("scale", 1.0)) == 0.0:
            raise keys.error("scale", "0 is not allowed")
        _exclusive(keys, "curve", "neutral", required=False)
        neutral = keys.number("neutral", 0.0)
        axis = Axis(name, keys.text(column), None, scale, scale * neutral, _curve(keys) if keys.has("curve") else None)
    keys.finish()
    return axis


def _curve(keys: Keys) -> Curve:
    value = keys.value("curve")
    if isinstance(value, str) and value.endswith(".csv"):
        return read_curve(keys.folder / value)
    try:
        return CURVES[value]() if isinstance(value, str) and value in CURVES else curve_of(value)
    except ValueError:
        known = f"a name, of {', '.join(CURVES)}, or a file that ends in .csv"
        problem = f"no list of at least two points [command, N] with increasing commands, {known}"
        raise keys.error("curve", f"{value!r} is {problem}") from None


def in_scene_order(kind: str, found: ChannelMap, names: Sequence[str]) -> tuple[Axis, ...]:
    """Axes of a channel in the order of the scene's names."""
    axes = {axis.name: axis for axis in found.axes}
    for name in axes:
        if name not in names:
            problem = f"the scene has no such {kind.removesuffix('s')}; {kind}: {', '.join(names) or 'none'}"
            raise found.place.table("axes").error(name, problem)
    for name in names:
        if name not in axes:
            raise found.place.error("axes", f"{name} is missing; value = 0.0 declares a constant")
    return tuple(axes[name] for name in names)
