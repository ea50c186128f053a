"""Recordings: the logs of trials on one grid of times, as replays need them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from uvms_gym import _rotations as rotations
from uvms_gym.logs import Log, LogError, interpolation

Floats = NDArray[np.float64]

#: Interval between compared samples, s.
PERIOD = 0.1
#: Smoothing of the joints' positions, s.
SMOOTHING = 0.1
#: Interval of their smoothed positions and velocities, s.
SMOOTHED = 0.02
#: Time over which the state at the start is estimated, s.
WINDOW = 0.4
#: Channels that are compared: name, unit, and factor from SI units to it.
CHANNELS: dict[str, tuple[str, float]] = {
    **dict.fromkeys(("roll", "pitch", "yaw"), ("deg", 180.0 / np.pi)),
    **dict.fromkeys(("gyro x", "gyro y", "gyro z"), ("deg/s", 180.0 / np.pi)),
    **dict.fromkeys(("x", "y", "z"), ("mm", 1e3)),
    **dict.fromkeys(("velocity x", "velocity y", "velocity z"), ("mm/s", 1e3)),
}
NAMES = tuple(CHANNELS)
ANGLES = [0, 1, 2]


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Trial on a grid of times."""

    #: The trial's log.
    log: Log
    #: First time and interval, s.
    start: float
    period: float
    #: (n + 1, 12) measured `CHANNELS` in SI units at the grid's times; NaN where nothing is known. Heading is in
    #: the position's axes.
    measured: Floats
    #: (12,) the same at the start, by regression over the first samples; velocities in body axes.
    initial: Floats

    @property
    def name(self) -> str:
        """Name of the trial."""
        return self.log.name

    @property
    def periods(self) -> int:
        """Number of intervals n."""
        return len(self.measured) - 1

    @property
    def time(self) -> Floats:
        """(n + 1,) times since the start, s."""
        return np.asarray(self.period * np.arange(self.periods + 1))

    def first(self, seconds: float) -> "Recording":
        """Recording of the first seconds."""
        return replace(self, measured=self.measured[: round(seconds / self.period) + 1])

    def cubics(self, lag: float = 0.0) -> Floats:
        """(n, joints, 4) motion of the joints over each interval, whose stamps are late by a further `lag`, s."""
        if self.log.joints is None:
            return np.zeros((self.periods, 0, 4))
        # (Smoothed once: a fit asks for many lags.)
        time, value, slope = self._smoothed
        wanted = self.start + lag + self.time
        # Beyond the samples the joints rest.
        at = np.clip(wanted, time[0], time[-1])
        moving = (wanted == at)[:, None]
        value = interpolation.linear(time, value, at)
        slope = np.where(moving, interpolation.linear(time, slope, at), 0.0)
        return interpolation.hermite((value[:-1], slope[:-1]), (value[1:], slope[1:]), self.period)

    @cached_property
    def _smoothed(self) -> tuple[Floats, Floats, Floats]:
        """Times (k,), smoothed positions and velocities (k, joints) of the joints around the recording."""
        joints = self.log.joints
        assert joints is not None
        spans = joints.spans
        around = spans[(spans[:, 0] <= self.start + self.period) & (spans[:, 1] > self.start + self.period)]
        first, last = around[0].tolist()
        count = max(int((last - first) / SMOOTHED), 1)
        c = joints.cubics(first, (last - first) / count, count, smoothing=SMOOTHING)
        end = c[-1] @ ((last - first) / count) ** np.arange(4)
        time = np.linspace(first, last, count + 1)
        return time, np.concatenate([c[..., 0], end[None]]), np.concatenate([c[..., 1], c[-1:, :, 1]])

    def commands(self, lag: float = 0.0, parts: int = 1) -> Floats:
        """(n, parts, thrusters) mean commands over parts of intervals, N; stamps are late by a further `lag`, s."""
        thrusters = self.log.thrusters
        if thrusters is None:
            return np.zeros((self.periods, parts, 0))
        # Commands are constant until the next: their integral is piecewise linear.
        stamps, held = thrusters.time, thrusters.command
        stamps, held = np.append(stamps, stamps[-1] + 1e3), np.concatenate([held, held[-1:]])
        integral = np.zeros_like(held)
        np.cumsum(held[:-1] * np.diff(stamps)[:, None], axis=0, out=integral[1:])
        length = self.period / parts
        ends = np.asarray(self.start + lag + length * np.arange(self.periods * parts + 1), dtype=np.float64)
        means = np.diff(interpolation.linear(stamps, integral, ends), axis=0) / length
        return means.reshape(self.periods, parts, -1)


def record(log: Log, period: float = PERIOD) -> Recording:
    """Recording of a log."""
    kinds = [kind for kind in ("joints", "thrusters") if kind in log.channels]
    spans = log.spans(*kinds) if kinds else np.array([[log.start, log.end]])
    if len(spans) == 0:
        raise LogError(f"{log.name}: no times without gaps of {' and '.join(kinds)}")
    start, end = spans[np.argmax(spans[:, 1] - spans[:, 0])]
    if end - start < 1.0:
        raise LogError(f"{log.name}: the longest time without gaps is {end - start:.3g} s, but must be at least 1 s")
    count = int((end - start) / period + 1e-9)
    times = start + period * np.arange(count + 1)
    measured = _measured(log, times)
    return Recording(log=log, start=float(start), period=period, measured=measured, initial=_initial(measured, period))


def _measured(log: Log, times: Floats) -> Floats:
    measured = np.full((len(times), len(NAMES)), np.nan)
    attitude = log.imu.attitude if log.imu is not None else None
    attitude = attitude or log.attitude or log.pose
    if attitude is None:
        raise LogError(f"{log.name}: no attitude, in none of imu, attitude, pose")
    measured[:, ANGLES] = unwrapped(rotations.to_rpy(attitude.quaternion_at(times)))
    if log.imu is not None:
        measured[:, 3:6] = log.imu.angular_velocity_at(times)
    elif log.twist is not None and log.twist.angular_velocity is not None:
        measured[:, 3:6] = log.twist.angular_velocity_at(times)
    if log.pose is not None:
        measured[:, 6:9] = log.pose.position_at(times)
        if attitude is not log.pose:
            other = rotations.to_rpy(log.pose.quaternion_at(times))[:, 2]
            turn = np.exp(1j * (other - measured[:, 2]))
            measured[:, 2] += float(np.angle(np.nansum(turn))) if np.isfinite(turn).any() else 0.0
    if log.twist is not None:
        measured[:, 9:12] = log.twist.velocity_at(times)
    return measured


def unwrapped(rpy: Floats) -> Floats:
    """Angles (n, 3) without jumps by full turns; NaN stays."""
    angles = rpy.copy()
    for column in angles.T:
        known = np.isfinite(column)
        column[known] = np.unwrap(column[known])
    return angles


def _initial(measured: Floats, period: float) -> Floats:
    """State at the start by lines through the first known samples; unmeasured velocity by parabolas of the position."""
    count = max(round(WINDOW / period) + 1, 3)

    def line(column: Floats, samples: int, degree: int = 1) -> tuple[float, float]:
        known = np.flatnonzero(np.isfinite(column))[:samples]
        if len(known) < degree + 2:
            return 0.0, 0.0
        *_, slope, value = np.polyfit(period * known, column[known], degree)
        # (A channel that begins later starts at its first value.)
        return (value if known[0] == 0 else column[known[0]]), slope

    state = np.array([line(column, count)[0] for column in measured.T])
    if not np.isfinite(measured[:, 9:12]).any():
        velocity = [line(column, 3 * count, 2)[1] for column in measured[:, 6:9].T]
        state[9:12] = rotations.matrices(rotations.from_rpy(state[None, ANGLES]))[0].T @ velocity
    if not np.isfinite(measured[:, 3:6]).any():
        state[3:6] = [line(column, count)[1] for column in measured[:, ANGLES].T]
    return state


def padded(arrays: Sequence[Floats]) -> Floats:
    """Arrays (n_i, ...) of different lengths side by side, (N, longest, ...): what is missing repeats the last row."""
    longest = max(len(array) for array in arrays)
    return np.stack([np.concatenate([a, np.repeat(a[-1:], longest - len(a), axis=0)]) for a in arrays])
