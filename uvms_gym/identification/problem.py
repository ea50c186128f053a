"""Residuals of replays against recordings, weighted by the noise."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from uvms_gym.identification.least_squares import minimise
from uvms_gym.identification.parameters import Parameter, apply
from uvms_gym.identification.recordings import ANGLES, CHANNELS, NAMES, Floats, Recording
from uvms_gym.identification.replay import Corrections, Replay

_DEG = np.pi / 180.0
#: Deviations of noise and of what no model explains, by channel, in SI units. In 32 pool trials attitudes at the same
#: pose of the arm repeat to 0.25 degrees.
NOISE: dict[str, float] = {
    **dict.fromkeys(("roll", "pitch", "yaw"), 0.25 * _DEG),
    **dict.fromkeys(("gyro x", "gyro y", "gyro z"), 0.15 * _DEG),
    **dict.fromkeys(("x", "y", "z"), 0.05),
    **dict.fromkeys(("velocity x", "velocity y", "velocity z"), 0.005),
}
#: Channels that count in a fit where the thrusters are off: yaw and drift depend on an unknown current.
FLOATING = ("roll", "pitch", "gyro x", "gyro y")
#: Time over which residuals are correlated, s.
CORRELATION = 2.0
#: Deviations of the trials' own parameters, by channel, in SI units: of angles the offset of the sensor, which differs
#: by trial, of other channels the state at the start from its estimate.
_START = {
    **dict.fromkeys(("roll", "pitch", "yaw"), 0.3 * _DEG),
    **dict.fromkeys(("gyro x", "gyro y", "gyro z"), 0.1 * _DEG),
    **dict.fromkeys(("x", "y", "z"), 0.005),
    **dict.fromkeys(("velocity x", "velocity y", "velocity z"), 0.02),
}
#: Deviation of the current along each horizontal axis, m/s.
_CURRENT = 0.1
#: Time at the start of a trial by which its own parameters are estimated where the rest is to be predicted, s.
WINDOW = 1.0
#: Maximum residual, in deviations of the noise.
_DIVERGED = 1e4
_UNITS = np.array([factor for _, factor in CHANNELS.values()])


class ReplayProblem:
    """Residuals of dynamics or, with `static`, of the attitude at which weight and buoyancy balance.

    `corrections` correct the logs where no parameter does.
    """

    def __init__(
        self,
        scene: dict[str, Any],
        replay: Replay,
        parameters: Sequence[Parameter],
        channels: Sequence[str],
        static: bool = False,
        corrections: Corrections | None = None,
    ) -> None:
        self.corrections = corrections
        self.scene, self.replay, self.parameters, self.static = scene, replay, list(parameters), static
        self.joints = list(replay.recordings[0].log.joints.names) if replay.recordings[0].log.joints else []
        self.thrusters = list(replay.recordings[0].log.thrusters.names) if replay.recordings[0].log.thrusters else []
        self.columns = [NAMES.index(name) for name in channels]
        self.noise = np.array([NOISE[name] for name in channels])
        # The trials' own parameters: the start of every channel that counts, velocity where position does, and the
        # current where it can be seen.
        start = [name for name in NAMES if name in channels or name.removeprefix("velocity ") in channels]
        self.start = [] if static else [NAMES.index(name) for name in start]
        self.current = not static and {"velocity x", "velocity y"} <= set(start)
        self.share = replay.period / CORRELATION
        # Attributes of `least_squares.Problem`.
        self.deviations = np.array([parameter.deviation for parameter in parameters])
        # Lags move as far as the parts of intervals over which commands are constant.
        lags = np.array([parameter.key.endswith(".time.lag") for parameter in parameters], dtype=np.bool_)
        self.differences = np.asarray(self.deviations * np.where(lags, 0.1, 0.01))
        self.own_deviations = np.array([_START[NAMES[k]] for k in self.start] + [_CURRENT] * (2 * self.current))
        low, high = np.array([parameter.bounds for parameter in parameters]).reshape(-1, 2).T
        self.bounds = (low, high)
        self.origin = np.array([parameter.origin for parameter in parameters])
        self.own_origin = np.zeros((len(replay.recordings), len(self.own_deviations)))

    def changed(self, common: Floats) -> tuple[dict[str, Any], Corrections]:
        """Scene and corrections at coordinates (p,)."""
        scene, corrections = apply(self.scene, self.parameters, common, self.joints, self.thrusters)
        return scene, self.corrections or corrections

    def initial(self, own: Floats) -> tuple[Floats, Floats | None]:
        """States at the start (N, 12) and currents (N, 3) at the trials' own parameters (N, m)."""
        initial, current = self.replay.initial.copy(), None
        signs = np.where(np.isin(self.start, ANGLES), -1.0, 1.0)
        initial[:, self.start] += signs * own[:, : len(self.start)]
        if self.current:
            current = np.concatenate([own[:, -2:], np.zeros((len(own), 1))], axis=1)
        return initial, current

    def residuals(self, common: Floats, own: Floats) -> Floats:
        """(N, R) residuals in deviations of the noise; 0 where unknown."""
        scene, corrections = self.changed(common)
        measured = self.replay.measured_with(corrections)
        if self.static:
            errors = self.replay.balance(scene, corrections) - measured
        else:
            errors = self.replay.run(scene, corrections, *self.initial(own)) - measured
        for column in ANGLES:
            if column in self.start:
                errors[:, :, column] += own[:, self.start.index(column), None]
        r = errors[:, :, self.columns] / self.noise
        # (A replay that diverges is worse than any other.)
        r = np.clip(np.where(np.isfinite(r), r, _DIVERGED), -_DIVERGED, _DIVERGED)
        return np.where(np.isfinite(measured[:, :, self.columns]), r, 0.0).reshape(len(r), -1)


def predict(scene: dict[str, Any], replay: Replay, channels: Sequence[str], corrections: Corrections) -> Floats:
    """(N, T + 1, 12) predicted channels; the states at the start are those that fit the first second."""
    own: dict[str, Any] = {"thrusters": replay.thrusters, "prescribed": replay.prescribed}
    first = Replay([r.first(WINDOW) for r in replay.recordings], **own, **replay.integration)
    problem = ReplayProblem(scene, first, [], channels, corrections=corrections)
    return replay.run(scene, corrections, *problem.initial(minimise(problem).own))


def counting(
    recordings: Sequence[Recording], given: Sequence[str] | None = None, thrusters: bool = True
) -> tuple[str, ...]:
    """Channels that count: those given, or all that are measured with thrusters, and `FLOATING` without."""
    known = np.any([np.isfinite(r.measured).any(axis=0) for r in recordings], axis=0)
    measured = [name for name, present in zip(NAMES, known) if present]
    if given is None:
        driven = thrusters and all(r.log.thrusters is not None for r in recordings)
        return tuple(name for name in measured if driven or name in FLOATING)
    for name in given:
        if name not in measured:
            raise ValueError(f"no samples of a channel {name!r}; channels: {', '.join(measured)}")
    return tuple(given)


def rms(errors: Floats) -> Floats:
    """RMS (N, 12) of errors (N, T, 12) in the units of `CHANNELS`; NaN for channels without samples."""
    known = np.isfinite(errors)
    squares = np.where(known, errors, 0.0) ** 2
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(squares.sum(axis=1) / known.sum(axis=1)) * _UNITS)
