"""Channels from tables: checks, units, axes, clocks and outliers."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym import _rotations as rotations
from uvms_gym.logs.channel_map import Axis, ChannelMap, Columns
from uvms_gym.logs.channels import Attitude, Battery, Channel, Imu, Joints, Pose, Thrusters, Twist
from uvms_gym.logs.curves import Curve
from uvms_gym.logs.errors import LogError
from uvms_gym.logs.tables import Table
from uvms_gym.logs.units import Floats

#: Maximum deviation of a logged quaternion's norm from 1.
NORM_TOLERANCE = 0.01

_TYPES: dict[str, type[Channel]] = {
    "pose": Pose,
    "attitude": Attitude,
    "twist": Twist,
    "imu": Imu,
    "joints": Joints,
    "thrusters": Thrusters,
    "battery": Battery,
}

Mask = NDArray[np.bool_]


def make_channel(kind: str, found: ChannelMap, table: Table, battery: Battery | None = None) -> Channel:
    """Channel of a table; the battery is for thrusters without a supply voltage of their own."""
    table = _in_order(table, found.backwards)
    time = np.asarray(table.time * found.time_factor - found.lag)
    keep = np.diff(time, prepend=-np.inf) > 0.0
    own = {"equal stamps": int(np.sum(~keep))}
    values: dict[str, Any] = _values(found, table)
    notes = table.notes
    if found.axes:
        supply = _supply(found, table, time, battery)
        usual = {axis.curve.usual for axis in found.axes if axis.curve is not None and axis.curve.usual}
        if supply is None and usual:
            notes = (*notes, f"thrust at {max(usual):g} V, as the map has neither voltage nor battery")
        values |= _axis_values(kind, found, table, supply)
    if np.isfinite(found.jump):
        keep[keep] = without_jumps(time[keep], values["quaternion"][keep], found.jump, found.gap)
        own["jumps"] = int(np.sum(~keep)) - sum(own.values())
    if found.repeat_period > 0.0:
        keep[keep] = without_repeats(time[keep], values["position"][keep], found.repeat_period)
        own["repeats"] = int(np.sum(~keep)) - sum(own.values())
    dropped = {**table.dropped, **own}
    if np.sum(keep) < 2:
        counts = ", ".join(f"{count} {reason}" for reason, count in dropped.items() if count) or "none"
        raise LogError(
            f"{table.source}: {np.sum(keep)} of {table.rows} rows remain, at least 2 must; left out: {counts}"
        )
    samples: dict[str, Any] = {"time": time, **values}
    samples = {name: array[keep] if isinstance(array, np.ndarray) else array for name, array in samples.items()}
    samples |= {"rows": table.rows, "dropped": dropped, "notes": notes}
    return _TYPES[kind](source=table.source, gap=found.gap, **samples)


def _in_order(table: Table, backwards: str) -> Table:
    """Table whose stamps never run backwards."""
    late = table.time < np.maximum.accumulate(table.time) if len(table.time) else np.zeros(0, np.bool_)
    if not late.any():
        return table
    if backwards == "sort":
        notes = (*table.notes, f"rows sorted by their stamps: {np.sum(late)}")
        return replace(table, notes=notes).take(np.argsort(table.time, kind="stable"))
    if backwards == "drop":
        dropped = {**table.dropped, "rows out of order": int(np.sum(late))}
        return replace(table, dropped=dropped).take(np.flatnonzero(~late))
    row = int(np.flatnonzero(late)[0])
    before, after = (repr(float(stamp)) for stamp in table.time[row - 1 : row + 1])
    raise LogError(
        f"{table.where(row)}: the stamp {after} is before the stamp of the row above, {before}; "
        'time.backwards = "sort" or "drop" allows it'
    )


def _values(found: ChannelMap, table: Table) -> dict[str, Floats]:
    """Vectors and attitudes in the library's units and axes."""
    world, body = np.array(found.world), np.array(found.body)
    values = {}
    for quantity, columns in found.columns.items():
        logged = table.values[quantity] * columns.factor
        if quantity == "attitude":
            q = _quaternions(columns, logged, table)
            q = rotations.multiply(rotations.multiply(world, q), rotations.conjugate(body))
            values["quaternion"] = rotations.canonical(q)
        else:
            turn = rotations.matrices(world if quantity == "position" else body)
            values[quantity] = logged @ turn.T if logged.shape[1] == 3 else logged
    return values


def _quaternions(columns: Columns, logged: Floats, table: Table) -> Floats:
    if columns.order == "rpy":
        return rotations.from_rpy(logged)
    q = logged[:, [3, 0, 1, 2]] if columns.order == "xyzw" else logged
    norms = np.linalg.norm(q, axis=1)
    wrong = np.flatnonzero(np.abs(norms - 1.0) > NORM_TOLERANCE)
    if len(wrong):
        row = int(wrong[0])
        raise LogError(f"{table.where(row)}: the quaternion has norm {norms[row]:.6g}, but must have 1")
    return np.asarray(q / norms[:, None])


def _supply(found: ChannelMap, table: Table, time: Floats, battery: Battery | None) -> Floats | None:
    """Supply voltages (n,) of the thrusters, V; None where none is known and no curve needs it."""
    curves = {axis.name: axis.curve for axis in found.axes if axis.curve is not None and len(axis.curve.voltage)}
    if found.supply is not None:
        return np.full(len(time), found.supply)
    if battery is None:
        if needing := [name for name, curve in curves.items() if curve.needs_voltage]:
            raise found.place.error(
                "voltage", f"is missing: the curve of {needing[0]} depends on it; also a channel battery can have it"
            )
        return None
    supply = battery.voltage_at(time)
    for name, curve in curves.items():
        low, high = curve.voltage[[0, -1]]
        for row in np.flatnonzero((supply < low) | (supply > high))[:1]:
            what = f"the supply is {supply[row]:g} V, outside of the curve of {name}, {low:g} to {high:g} V"
            raise LogError(f"{table.where(int(row))}: {what}")
    return supply


def _axis_values(kind: str, found: ChannelMap, table: Table, supply: Floats | None) -> dict[str, Any]:
    """Values of joints or thrusters in the scene's units, and their names."""
    axes = found.axes
    names, factor = tuple(axis.name for axis in axes), np.array([axis.factor for axis in axes])
    logged = np.zeros((2, len(table.time), len(axes)))
    for k, key in enumerate(("value", "rate")):
        if key in table.values:
            logged[k][:, [axis.column is not None for axis in axes]] = table.values[key]
    for k, axis in enumerate(axes):
        if axis.curve is not None:
            logged[0][:, k] = _on_curve(axis.curve, logged[0][:, k], axis, table, supply)
    value = factor * logged[0] - np.array([axis.offset for axis in axes])
    if kind == "thrusters":
        return {"names": names, "command": value}
    velocity = {"velocity": factor * logged[1]} if "rate" in table.values else {}
    return {"names": names, "position": value} | velocity


def _on_curve(curve: Curve, commands: Floats, axis: Axis, table: Table, supply: Floats | None) -> Floats:
    """Thrusts (n,), N, of commands (n,) on a thruster's curve."""
    for row in curve.outside(commands)[:1]:
        first, last = curve.command[[0, -1]]
        what = f"{axis.column} is {commands[row]:g}, outside of the curve of {axis.name}, {first:g} to {last:g}"
        raise LogError(f"{table.where(int(row))}: {what}")
    return curve(commands, supply)


def without_jumps(time: Floats, q: Floats, limit: float, gap: float) -> Mask:
    """True for samples (n,) whose attitude (n, 4) is within a limit, rad, of the accepted sample before.

    The samples between two gaps, s, are judged together. Their longest run without a jump is accepted, and from it in
    both directions every run that begins within the limit of the last accepted sample.
    """
    keep = np.zeros(len(time), dtype=np.bool_)
    breaks = np.diff(time) > gap
    jumps = (rotations.angles(q[:-1], q[1:]) > limit) | breaks
    first = np.r_[0, np.flatnonzero(jumps) + 1]
    end = np.r_[first[1:], len(time)]
    stretch = np.cumsum(np.r_[True, breaks])[first]
    for part in np.unique(stretch):
        runs = [slice(a, b) for a, b in zip(first[stretch == part], end[stretch == part])]
        longest = int(np.argmax([run.stop - run.start for run in runs]))
        keep[runs[longest]] = True
        last = q[runs[longest].stop - 1]
        for run in runs[longest + 1 :]:
            if rotations.angles(last, q[run.start]) <= limit:
                keep[run], last = True, q[run.stop - 1]
        last = q[runs[longest].start]
        for run in reversed(runs[:longest]):
            if rotations.angles(last, q[run.stop - 1]) <= limit:
                keep[run], last = True, q[run.start]
    return keep


def without_repeats(time: Floats, values: Floats, period: float) -> Mask:
    """True for samples (n,) whose values (n, k) are new, or follow the last accepted sample by a period, s."""
    keep: Mask = np.r_[True, np.any(np.diff(values, axis=0) != 0.0, axis=1)]
    for first, end in zip(np.flatnonzero(keep), np.r_[np.flatnonzero(keep)[1:], len(time)]):
        last = time[first]
        if time[end - 1] - last >= period:
            for k in range(first + 1, end):
                if time[k] - last >= period:
                    keep[k], last = True, time[k]
    return keep
