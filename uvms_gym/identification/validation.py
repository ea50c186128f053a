"""Validation: replays of logs beside predictors that any model must beat."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from uvms_gym._core import load_scene
from uvms_gym.identification.problem import counting, predict, rms
from uvms_gym.identification.recordings import CHANNELS, PERIOD, Floats, Recording, record
from uvms_gym.identification.replay import Corrections, Replay, check, stated_step
from uvms_gym.logs import Log
from uvms_gym.logs.log import Scene


@dataclass(frozen=True, eq=False)
class Table:
    """Errors by trial and channel.

    Attributes
    ----------
    trials : tuple of str
        Names of the N trials.
    errors : dict of str to numpy.ndarray (N, 12)
        RMS of every channel of `CHANNELS`, in its unit, by predictor; NaN where a channel has no samples.
    """

    trials: tuple[str, ...]
    errors: Mapping[str, Floats]

    @property
    def channels(self) -> list[str]:
        """Channels with samples in any trial."""
        known = np.any([np.isfinite(errors).any(axis=0) for errors in self.errors.values()], axis=0)
        return [name for name, present in zip(CHANNELS, known) if present]

    @property
    def means(self) -> dict[str, dict[str, float]]:
        """Mean over the trials of the RMS of each channel, by predictor."""
        names, shown = list(CHANNELS), self.channels
        return {
            predictor: {name: float(np.nanmean(errors[:, names.index(name)])) for name in shown}
            for predictor, errors in self.errors.items()
        }

    def of(self, trials: Sequence[str]) -> Table:
        """Table of some trials."""
        rows = [self.trials.index(trial) for trial in trials]
        return Table(tuple(trials), {name: errors[rows] for name, errors in self.errors.items()})

    def as_data(self) -> dict[str, Any]:
        """Numbers by predictor, trial and channel."""
        names, shown = list(CHANNELS), self.channels
        by_trial = {
            predictor: {
                trial: {name: float(row[names.index(name)]) for name in shown}
                for trial, row in zip(self.trials, errors)
            }
            for predictor, errors in self.errors.items()
        }
        return {"units": {name: CHANNELS[name][0] for name in shown}, "means": self.means, "trials": by_trial}


@dataclass(frozen=True, eq=False)
class Validation:
    """Replays of a scene.

    Attributes
    ----------
    recordings : list of Recording
        The N trials.
    predicted : dict of str to numpy.ndarray (N, T + 1, 12)
        Channels in SI units by predictor: "replay", "balance", "constant", "constant velocity" and, with thrusters,
        "double integrator".
    measured : numpy.ndarray (N, T + 1, 12)
        Measured channels, NaN where unknown.
    table : Table
        Errors.
    """

    recordings: list[Recording]
    predicted: Mapping[str, Floats]
    measured: Floats
    table: Table


def validate(
    scene: Scene,
    logs: Sequence[Log],
    *,
    joints: Literal["prescribed", "servos"] = "prescribed",
    thrusters: Literal["log", "off"] = "log",
    period: float = PERIOD,
    integrator: str | None = None,
    dt: float | None = None,
) -> Validation:
    """Replay logs with a scene and compare.

    Every trial starts from the state that fits its first second; nothing else of the vehicle's motion is used.

    Parameters
    ----------
    scene : str, os.PathLike or dict
        Scene.
    logs : sequence of Log
        Trials, read with that scene.
    joints : {"prescribed", "servos"}
        Joints that move as logged, or servos of the scene that follow the logs.
    thrusters : {"log", "off"}
        Thrust as commanded in the logs, or none.
    period : float
        Interval between compared samples, s.
    integrator : str, optional
        Integrator; default: the scene's.
    dt : float, optional
        Maximum step, s; default: 0.05 of a floating vehicle, 0.0125 with thrusters, 0.005 with servos, or the scene's
        where it is shorter.

    Raises
    ------
    SceneError, LogError
        Scene or log that cannot be used.
    """
    loaded = load_scene(scene)
    recordings = [record(log, period) for log in logs]
    check(loaded, recordings)
    inputs = {"thrusters": thrusters == "log", "prescribed": joints == "prescribed"}
    replay = Replay(recordings, **inputs, step=stated_step(loaded), dt=dt, integrator=integrator)
    channels = counting(recordings, thrusters=thrusters == "log")
    replayed = predict(loaded, replay, channels, Corrections())
    predicted = {
        "replay": replayed,
        "balance": replay.balance(loaded),
        "constant": replay.constant(),
        "constant velocity": replay.constant_velocity(),
    }
    if replay.thrusters:
        predicted["double integrator"] = replay.double_integrator(loaded)
    errors = {name: rms(channels - replay.measured) for name, channels in predicted.items()}
    return Validation(recordings, predicted, replay.measured, Table(tuple(r.name for r in recordings), errors))


def select(names: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """Names that match patterns, such as "004-*"."""
    found: list[str] = []
    for pattern in patterns:
        matching = fnmatch.filter(names, pattern)
        if not matching:
            raise ValueError(f"no trial is named {pattern!r}; trials: {', '.join(names)}")
        found += [name for name in matching if name not in found]
    return found
