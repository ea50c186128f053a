"""Residuals of replays against recordings, weighted by the noise."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from uvms_gym.identification.parameters import Parameter, apply
from uvms_gym.identification.recordings import CHANNELS, NAMES, Floats
from uvms_gym.identification.replay import Corrections, Replay

_DEG = np.pi / 180.0
#: Deviations of noise and of what no model explains, by channel, in SI units. In 32 pool trials attitudes at the same pose
#: of the arm repeat to 0.25 degrees.
NOISE: dict[str, float] = {
    **dict.fromkeys(("roll", "pitch", "yaw"), 0.25 * _DEG),
    **dict.fromkeys(("gyro x", "gyro y", "gyro z"), 0.15 * _DEG),
    **dict.fromkeys(("x", "y", "z"), 0.005),
    **dict.fromkeys(("velocity x", "velocity y", "velocity z"), 0.005),
}
#: Channels that count in a fit where the thrusters are off: yaw and drift depend on an unknown current.
FLOATING = ("roll", "pitch", "gyro x", "gyro y")
#: Time over which residuals are correlated, s.
CORRELATION = 2.0
#: Deviations of the state at the start from its estimate, by channel, in SI units.
_START = {
    **dict.fromkeys(("roll", "pitch", "yaw"), 0.25 * _DEG),
    **dict.fromkeys(("gyro x", "gyro y", "gyro z"), 0.2 * _DEG),
    **dict.fromkeys(("x", "y", "z"), 0.005),
    **dict.fromkeys(("velocity x", "velocity y", "velocity z"), 0.02),
}
#: Deviation of the current along each horizontal axis, m/s.
_CURRENT = 0.1
_UNITS = np.array([factor for _, factor in CHANNELS.values()])


class ReplayProblem:
    """Residuals of dynamics or, with `static`, of the attitude at which weight and buoyancy balance.

    Parameters
    ----------
    scene : dict
        Complete scene.
    replay : Replay
        Trials.
    parameters : sequence of Parameter
        Free numbers of scene and map.
    channels : sequence of str
        Channels that count.
    static : bool
        True: balance alone.
    """

    def __init__(
        self,
        scene: dict[str, Any],
        replay: Replay,
        parameters: Sequence[Parameter],
        channels: Sequence[str],
        static: bool = False,
    ) -> None:
        self.scene, self.replay, self.parameters, self.static = scene, replay, list(parameters), static
        self.joints = list(replay.recordings[0].log.joints.names) if replay.recordings[0].log.joints else []
        self.thrusters = list(replay.recordings[0].log.thrusters.names) if replay.recordings[0].log.thrusters else []
        self.columns = [NAMES.index(name) for name in channels]
        self.noise = np.array([NOISE[name] for name in channels])
        moving = any(column >= 6 for column in self.columns)
        # The trials' own parameters: the start of every channel that counts (velocity where position does), the current.
        start = [name for name in NAMES if name in channels or (moving and name.startswith("velocity"))]
        self.start = [] if static else [NAMES.index(name) for name in start]
        self.current = moving and not static
        self.share = replay.period / CORRELATION

    @property
    def deviations(self) -> Floats:
        """(p,) standard deviations of the priors."""
        return np.array([parameter.deviation for parameter in self.parameters])

    @property
    def own_deviations(self) -> Floats:
        """(m,) standard deviations of the trials' own parameters."""
        return np.array([_START[NAMES[k]] for k in self.start] + [_CURRENT] * (2 * self.current))

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Bounds of the parameters, each (p,)."""
        low, high = zip(*(parameter.bounds for parameter in self.parameters))
        return np.array(low), np.array(high)

    @property
    def origin(self) -> Floats:
        """(p,) coordinates of the start."""
        return np.array([parameter.origin for parameter in self.parameters])

    @property
    def own_origin(self) -> Floats:
        """(N, m) start of the trials' own parameters."""
        return np.zeros((len(self.replay.recordings), len(self.own_deviations)))

    def changed(self, common: Floats) -> tuple[dict[str, Any], Corrections]:
        """Scene and corrections at coordinates (p,)."""
        return apply(self.scene, self.parameters, common, self.joints, self.thrusters)

    def errors(self, common: Floats, own: Floats) -> Floats:
        """(N, T + 1, 12) predicted less measured channels in SI units; NaN where unknown."""
        scene, corrections = self.changed(common)
        measured = self.replay.measured_with(corrections)
        if self.static:
            return self.replay.balance(scene, corrections) - measured
        initial, current = self.replay.initial.copy(), None
        initial[:, self.start] += own[:, : len(self.start)]
        if self.current:
            current = np.concatenate([own[:, -2:], np.zeros((len(own), 1))], axis=1)
        return self.replay.run(scene, corrections, initial, current) - measured

    def residuals(self, common: Floats, own: Floats) -> Floats:
        """(N, R) residuals in deviations of the noise; 0 where unknown."""
        r = self.errors(common, own)[:, :, self.columns] / self.noise
        return np.nan_to_num(r.reshape(len(r), -1), nan=0.0)


def rms(errors: Floats) -> Floats:
    """RMS (N, 12) of errors (N, T, 12) in the units of `CHANNELS`; NaN for channels without samples."""
    known = np.isfinite(errors)
    count = known.sum(axis=1)
    squares = np.where(known, errors, 0.0) ** 2
    with np.errstate(invalid="ignore"):
        return np.sqrt(squares.sum(axis=1) / count) * _UNITS
