"""Map of a channel: its file or topic, with columns, units, axes and clock."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from uvms_gym.logs import units
from uvms_gym.logs.keys import Keys

#: Quantities of the channels, with their units; the first one is required.
QUANTITIES: dict[str, dict[str, Mapping[str, float]]] = {
    "pose": {"position": units.LENGTH},
    "attitude": {},
    "twist": {"velocity": units.SPEED, "angular_velocity": units.ANGULAR_SPEED},
    "imu": {"angular_velocity": units.ANGULAR_SPEED, "specific_force": units.ACCELERATION},
    "joints": {},
    "thrusters": {},
}
#: Channels with an attitude, and those that must have it.
ORIENTED = {"pose": True, "attitude": True, "imu": False}
#: Longest interval between samples that is interpolated, s.
GAP = 0.5


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
    """Joint or thruster: value = factor * column - offset, in the scene's units."""

    #: Name in the scene.
    name: str
    #: Columns of value and velocity; a value without column is the constant -offset.
    column: str | None = None
    velocity: str | None = None
    factor: float = 0.0
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ChannelMap:
    """Source of a channel and its conversion."""

    #: Table of the map, for errors.
    place: Keys
    #: Name of the file, in which "{trial}" is replaced, or topic of a bag: one of them.
    file: str | None
    topic: str | None
    #: Character between columns of a file.
    delimiter: str
    #: Column of stamps; None: the stamps of a topic's messages.
    time: str | None
    #: Stamps of a topic's messages; None: the header's, where there is one.
    stamp: str | None
    #: Factor of the stamps to seconds.
    time_factor: float
    #: Lateness of the stamps, s.
    lag: float
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
    time = keys.table("time")
    if topic is None:
        time.require("column")
    column = time.text("column") if time.has("column") else None
    columns = _columns(kind, keys, topic is not None)
    found = ChannelMap(
        place=keys,
        file=None if topic else keys.text("file"),
        topic=topic,
        delimiter="," if topic else _delimiter(keys),
        time=column,
        stamp=time.choice("stamp", ("header", "bag")) if topic and not column and time.has("stamp") else None,
        time_factor=units.TIME[time.choice("unit", units.TIME, "s")] if column else 1.0,
        lag=time.number("lag", 0.0),
        gap=keys.number("gap", gap, above=0.0, finite=False),
        jump=np.radians(keys.number("jump_deg", math.inf, above=0.0)) if "attitude" in columns else math.inf,
        repeat_period=keys.number("repeat_period", 0.0, above=0.0) if kind == "joints" else 0.0,
        world=units.WORLD[keys.choice("world", units.WORLD, "nwu")] if kind in ORIENTED else units.WORLD["nwu"],
        body=units.BODY["flu" if kind in ("joints", "thrusters") else keys.choice("body", units.BODY, "flu")],
        columns=columns,
        axes=_axes(kind, keys),
    )
    time.finish()
    keys.finish()
    return found


def _exclusive(keys: Keys, one: str, other: str, required: bool = True) -> None:
    """Refuse both of two keys, and neither of them where one is required."""
    if keys.has(one) + keys.has(other) == 2:
        raise keys.error(None, f"{one} or {other}, not both")
    if required:
        keys.require(one, other)


def _delimiter(keys: Keys) -> str:
    if not keys.has("delimiter"):
        return ","
    delimiter = keys.text("delimiter")
    if delimiter not in (",", ";", "\t", " ", "|"):
        raise keys.error("delimiter", f"{delimiter!r} is none of ',', ';', '|', a tab and a space")
    return delimiter


def _columns(kind: str, keys: Keys, topic: bool) -> dict[str, Columns]:
    columns = {}
    for k, (quantity, allowed) in enumerate(QUANTITIES[kind].items()):
        if keys.has(quantity) or (k == 0 and topic):
            columns[quantity] = _group(keys.table(quantity), 3, allowed, topic)
        elif k == 0:
            keys.require(quantity)
    if kind in ORIENTED:
        _exclusive(keys, "quaternion", "rpy", required=ORIENTED[kind] and not topic)
        if keys.has("rpy"):
            columns["attitude"] = _group(keys.table("rpy"), 3, units.ANGLE, topic=False, order="rpy")
        elif keys.has("quaternion") or (ORIENTED[kind] and topic):
            columns["attitude"] = _quaternion(keys.table("quaternion"), topic)
    return columns


def _group(keys: Keys, count: int, allowed: Mapping[str, float], topic: bool, order: str | None = None) -> Columns:
    """Columns of one quantity with their unit."""
    if not topic:
        keys.require("columns")
    names = keys.texts("columns", count)
    factor = allowed[keys.choice("unit", allowed, next(iter(allowed)))]
    keys.finish()
    return Columns(names, factor, order)


def _quaternion(keys: Keys, topic: bool) -> Columns:
    """Columns of a quaternion with their order, which has no default."""
    if not topic:
        keys.require("columns")
    names = keys.texts("columns", 4)
    order = keys.choice("order", ("wxyz", "xyzw")) if names else "wxyz"
    keys.finish()
    return Columns(names, order=order)


def _axes(kind: str, keys: Keys) -> tuple[Axis, ...]:
    if kind not in ("joints", "thrusters"):
        return ()
    table = keys.table("axes")
    read = _joint if kind == "joints" else _thruster
    axes = tuple(read(name, table.table(name)) for name in table)
    if not any(axis.column for axis in axes):
        raise keys.error("axes", f"a table with the columns of the scene's {kind} by name is expected")
    lacking = [axis.name for axis in axes if axis.column and not axis.velocity]
    if lacking and any(axis.velocity for axis in axes):
        raise table.error(lacking[0], "velocity is missing; all joints have one or none")
    return axes


def _joint(name: str, keys: Keys) -> Axis:
    """Joint: q = (sign * column - zero) in the unit of the column, or a constant."""
    unit = keys.choice("unit", units.ANGLE | units.LENGTH, "rad")
    factor = (units.ANGLE | units.LENGTH)[unit]
    _exclusive(keys, "position", "value")
    if keys.has("value"):
        axis = Axis(name, offset=-keys.number("value", 0.0) * factor)
    else:
        sign = keys.number("sign", 1.0)
        if abs(sign) != 1.0:
            raise keys.error("sign", f"{sign:g} is neither 1 nor -1")
        velocity = keys.text("velocity") if keys.has("velocity") else None
        axis = Axis(name, keys.text("position"), velocity, sign * factor, keys.number("zero", 0.0) * factor)
    keys.finish()
    return axis


def _thruster(name: str, keys: Keys) -> Axis:
    """Thruster: command = scale * (column - neutral), N, or a constant."""
    _exclusive(keys, "command", "value")
    if keys.has("value"):
        axis = Axis(name, offset=-keys.number("value", 0.0))
    else:
        scale = keys.number("scale", 1.0)
        if scale == 0.0:
            raise keys.error("scale", "0 is not allowed")
        axis = Axis(name, keys.text("command"), None, scale, scale * keys.number("neutral", 0.0))
    keys.finish()
    return axis


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
