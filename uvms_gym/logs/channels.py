"""Channels of a log: samples of one source with their own stamps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym import _rotations as rotations
from uvms_gym.logs import interpolation
from uvms_gym.logs.errors import LogError
from uvms_gym.logs.units import Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """Samples of one source, in SI units and the library's axes: world z up; body x forward, y left, z up.

    Values between samples are interpolated; in gaps and outside the samples they are NaN.

    Attributes
    ----------
    source : str
        File or topic.
    time : numpy.ndarray (n,)
        Stamps on the log's clock, s, increasing; n >= 2.
    gap : float
        Longest interval between samples that is interpolated, s.
    rows : int
        Number of rows or messages of the source.
    dropped : dict of str to int
        Number of rows left out, by the reason: "lost frames" (a number is NaN or missing), "empty rows", "cut rows",
        "damaged messages", "messages of others" (of a topic with several publishers), "unstamped messages", "rows out
        of order", "equal stamps", "jumps", "repeats".
    notes : tuple of str
        Remarks on how the source was read, such as "decimal commas".
    """

    source: str
    time: Floats
    gap: float
    rows: int
    dropped: Mapping[str, int]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @property
    def spans(self) -> Floats:
        """(k, 2) first and last stamps of the stretches without gaps, s; stretches of a single sample are left out."""
        breaks = np.flatnonzero(np.diff(self.time) > self.gap)
        first, last = np.r_[0, breaks + 1], np.r_[breaks, len(self.time) - 1]
        return np.asarray(np.stack([self.time[first], self.time[last]], axis=-1)[last > first])

    @property
    def gaps(self) -> Floats:
        """(k, 2) stamps before and after each gap, s."""
        breaks = np.flatnonzero(np.diff(self.time) > self.gap)
        return np.stack([self.time[breaks], self.time[breaks + 1]], axis=-1)

    def covers(self, times: ArrayLike) -> NDArray[np.bool_]:
        """True for times (m,) within a stretch without gaps."""
        return within(self.spans, np.asarray(times, dtype=np.float64))

    def between(self, start: float, end: float) -> Self:
        """Channel of the samples in [start, end], s, and of one sample beyond each end, by which both interpolate.

        Raises
        ------
        LogError
            Fewer than two samples remain.
        """
        first = max(int(np.searchsorted(self.time, start, side="right")) - 1, 0)
        last = int(np.searchsorted(self.time, end, side="left")) + 1
        if min(last, len(self.time)) - first < 2:
            raise LogError(f"{self.source}: fewer than two samples between {start:.6g} and {end:.6g} s")
        return self.rows_of(slice(first, last))

    def rows_of(self, rows: slice | NDArray[np.bool_]) -> Self:
        """Channel of some of its samples."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        arrays: dict[str, Any] = {name: a[rows] for name, a in values.items() if isinstance(a, np.ndarray)}
        return replace(self, **arrays)

    def shifted(self, seconds: float) -> Self:
        """Channel with later stamps."""
        return replace(self, time=self.time + seconds)

    def _where_covered(self, times: Floats, values: Floats) -> Floats:
        """Values (m, k) at times (m,), NaN in gaps and outside the samples."""
        return np.where(self.covers(times)[:, None], values, np.nan)

    def _linear(self, values: Floats, times: ArrayLike) -> Floats:
        times = np.asarray(times, dtype=np.float64)
        return self._where_covered(times, interpolation.linear(self.time, values, times))


def within(spans: Floats, times: Floats) -> NDArray[np.bool_]:
    """True for times (m,) within one of the sorted spans (k, 2)."""
    k = np.searchsorted(spans[:, 0], times, side="right") - 1
    inside = times <= np.append(spans[:, 1], -np.inf)[k]
    return np.asarray((k >= 0) & inside)


@dataclass(frozen=True, kw_only=True, eq=False)
class Attitude(Channel):
    """Attitude of the vehicle.

    Attributes
    ----------
    quaternion : numpy.ndarray (n, 4)
        [w, x, y, z], w >= 0, body to world.
    """

    quaternion: Floats

    @property
    def rotation(self) -> Floats:
        """(n, 3, 3) rotation matrices, body to world."""
        return rotations.matrices(self.quaternion)

    def quaternion_at(self, times: ArrayLike) -> Floats:
        """(m, 4) attitude at times (m,), by spherical linear interpolation."""
        times = np.asarray(times, dtype=np.float64)
        inside = np.clip(times, self.time[0], self.time[-1])
        return self._where_covered(times, rotations.slerp(self.time, self.quaternion, inside))

    def rotation_at(self, times: ArrayLike) -> Floats:
        """(m, 3, 3) attitude at times (m,), by spherical linear interpolation."""
        return rotations.matrices(self.quaternion_at(times))


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose(Attitude):
    """Pose of the vehicle frame.

    Attributes
    ----------
    position : numpy.ndarray (n, 3)
        Position in world axes, m.
    """

    position: Floats

    def position_at(self, times: ArrayLike) -> Floats:
        """(m, 3) position at times (m,), m, by linear interpolation."""
        return self._linear(self.position, times)


@dataclass(frozen=True, kw_only=True, eq=False)
class Twist(Channel):
    """Velocity of the vehicle frame, in body axes.

    Attributes
    ----------
    velocity : numpy.ndarray (n, 3)
        m/s.
    angular_velocity : numpy.ndarray (n, 3) or None
        rad/s.
    """

    velocity: Floats
    angular_velocity: Floats | None = None

    def velocity_at(self, times: ArrayLike) -> Floats:
        """(m, 3) velocity at times (m,), m/s, by linear interpolation."""
        return self._linear(self.velocity, times)

    def angular_velocity_at(self, times: ArrayLike) -> Floats:
        """(m, 3) angular velocity at times (m,), rad/s, by linear interpolation."""
        return self._linear(_given(self.angular_velocity, self.source, "angular_velocity"), times)


@dataclass(frozen=True, kw_only=True, eq=False)
class Imu(Channel):
    """Readings of an inertial measurement unit, in body axes.

    Attributes
    ----------
    angular_velocity : numpy.ndarray (n, 3)
        rad/s.
    specific_force : numpy.ndarray (n, 3) or None
        Acceleration less gravity, m/s2: +9.81 along world z at rest.
    quaternion : numpy.ndarray (n, 4) or None
        Attitude [w, x, y, z], w >= 0, body to world. Its heading may differ from other channels'.
    """

    angular_velocity: Floats
    specific_force: Floats | None = None
    quaternion: Floats | None = None

    def angular_velocity_at(self, times: ArrayLike) -> Floats:
        """(m, 3) angular velocity at times (m,), rad/s, by linear interpolation."""
        return self._linear(self.angular_velocity, times)

    def specific_force_at(self, times: ArrayLike) -> Floats:
        """(m, 3) specific force at times (m,), m/s2, by linear interpolation."""
        return self._linear(_given(self.specific_force, self.source, "specific_force"), times)

    @property
    def attitude(self) -> Attitude | None:
        """Channel of the attitude."""
        if self.quaternion is None:
            return None
        names = [field.name for field in fields(Channel)]
        return Attitude(quaternion=self.quaternion, **{name: getattr(self, name) for name in names})


@dataclass(frozen=True, kw_only=True, eq=False)
class Joints(Channel):
    """Joints of the arm, in the scene's order and coordinates.

    Attributes
    ----------
    names : tuple of str
        Names of the joints.
    position : numpy.ndarray (n, joints)
        rad or m.
    velocity : numpy.ndarray (n, joints) or None
        rad/s or m/s.
    """

    names: tuple[str, ...]
    position: Floats
    velocity: Floats | None = None

    def position_at(self, times: ArrayLike) -> Floats:
        """(m, joints) position at times (m,), rad or m, by monotone piecewise cubics through the samples."""
        times = np.asarray(times, dtype=np.float64)
        return self._where_covered(times, interpolation.pchip(self.time, self.position, times)[0])

    def velocity_at(self, times: ArrayLike) -> Floats:
        """(m, joints) logged velocity at times (m,), rad/s or m/s, by linear interpolation."""
        return self._linear(_given(self.velocity, self.source, "velocity"), times)

    def cubics(self, start: float, dt: float, periods: int, smoothing: float = 0.0) -> Floats:
        """Coefficients of the position as piecewise cubics over equal periods, continuous with their slopes.

        Parameters
        ----------
        start : float
            Start of the first period, s.
        dt : float
            Length of a period, s, > 0.
        periods : int
            Number of periods, >= 1.
        smoothing : float
            Time constant, s, >= 0: values and slopes at the ends of periods come from a quadratic regression over
            the samples around, with Gaussian weights of this standard deviation. 0: monotone cubics through the
            samples; stamps that jitter then make steep slopes.

        Returns
        -------
        numpy.ndarray (periods, joints, 4)
            c0 to c3 of c0 + c1 t + c2 t^2 + c3 t^3, t in s from the start of the period; rad or m.

        Raises
        ------
        ValueError
            Argument out of range.
        LogError
            A gap, or no samples, in these periods.
        """
        if not dt > 0.0 or periods < 1 or not smoothing >= 0.0:
            given = f"dt = {dt}, periods = {periods}, smoothing = {smoothing}"
            raise ValueError(f"dt must be > 0, periods >= 1 and smoothing >= 0, but {given}")
        knots = start + np.linspace(0.0, dt * periods, periods + 1)
        # (A sum may exceed the last stamp by a rounding error.)
        spans = self.spans + 1e-9 * np.array([-1.0, 1.0])
        inside = spans[(spans[:, 0] <= knots[0]) & (knots[-1] <= spans[:, 1])]
        if len(inside) == 0:
            raise LogError(
                f"{self.source}: joint positions do not cover {knots[0]:.6g} to {knots[-1]:.6g} s; without gaps over "
                f"{self.gap:g} s are {', '.join(f'{a:.6g} to {b:.6g} s' for a, b in self.spans) or 'none'}"
            )
        rows = (self.time >= inside[0, 0]) & (self.time <= inside[0, 1])
        time, position = self.time[rows], self.position[rows]
        if smoothing > 0.0 and len(time) < 4:
            raise LogError(f"{self.source}: {len(time)} samples cannot be smoothed, at least 4 can")
        if smoothing > 0.0:
            value, slope = interpolation.local_quadratic(time, position, knots, smoothing)
        else:
            value, slope = interpolation.pchip(time, position, knots)
        return interpolation.hermite((value[:-1], slope[:-1]), (value[1:], slope[1:]), dt)


@dataclass(frozen=True, kw_only=True, eq=False)
class Thrusters(Channel):
    """Commands of the thrusters, in the scene's order.

    Attributes
    ----------
    names : tuple of str
        Names of the thrusters.
    command : numpy.ndarray (n, thrusters)
        Commanded thrust, N.
    """

    names: tuple[str, ...]
    command: Floats

    def command_at(self, times: ArrayLike) -> Floats:
        """(m, thrusters) command at times (m,), N, by the last sample (zero-order hold)."""
        times = np.asarray(times, dtype=np.float64)
        k = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, None)
        return self._where_covered(times, self.command[k])


def _given(values: Floats | None, source: str, quantity: str) -> Floats:
    if values is None:
        raise LogError(f"{source}: the map names no {quantity}")
    return values


@dataclass(frozen=True, kw_only=True, eq=False)
class Battery(Channel):
    """Supply of the thrusters.

    Attributes
    ----------
    voltage : numpy.ndarray (n, 1)
        V.
    """

    voltage: Floats

    def voltage_at(self, times: ArrayLike) -> Floats:
        """(m,) voltage at times (m,), V, by linear interpolation; beyond the samples the nearest one's."""
        return np.interp(np.asarray(times, dtype=np.float64), self.time, self.voltage[:, 0])
