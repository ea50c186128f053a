"""Repeatability: fits to parts of the trials, against each other and on trials held out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from uvms_gym import Log
from uvms_gym.identification import Fit, fit
from uvms_gym.identification.validation import select
from uvms_gym.logs.log import Scene


@dataclass(frozen=True, eq=False)
class Halves:
    """Fits to two halves of the trials.

    Attributes
    ----------
    first, second : Fit
        Fits to every other trial, and to the rest.
    scores : dict of str to float
        Difference of the coordinates in standard deviations of the difference, by key.
    """

    first: Fit
    second: Fit
    scores: dict[str, float]

    @property
    def rms(self) -> float:
        """RMS of the scores; 1 is expected where deviations are right, less where priors hold a parameter."""
        return float(np.sqrt(np.mean(np.square(list(self.scores.values())))))


def halves(scene: Scene, logs: Sequence[Log], free: Sequence[str], **options: Any) -> Halves:
    """Fit every other trial, and the rest; `options` are those of `identification.fit`."""
    first, second = (fit(scene, part, free, balance=False, **options) for part in (logs[::2], logs[1::2]))
    difference = first.solution.common - second.solution.common
    deviation = np.hypot(first.uncertainty.deviations, second.uncertainty.deviations)
    keys = [p.key for p in first.parameters]
    return Halves(first, second, dict(zip(keys, (difference / deviation).tolist())))


def few_trials(
    scene: Scene,
    logs: Sequence[Log],
    free: Sequence[str],
    *,
    hold_out: Sequence[str],
    trials: int = 4,
    fits: int = 10,
    seed: int = 0,
    **options: Any,
) -> list[dict[str, float]]:
    """Mean RMS errors, by channel, on trials held out, of fits to a few random trials each.

    Parameters
    ----------
    scene, logs, free, hold_out, **options
        As of `identification.fit`.
    trials : int
        Trials per fit.
    fits : int
        Number of fits.
    seed : int
        Seed of the choice of trials.
    """
    rng = np.random.default_rng(seed)
    held = select([log.name for log in logs], hold_out)
    others = [log for log in logs if log.name not in held]
    kept = [log for log in logs if log.name in held]
    found = []
    for _ in range(fits):
        chosen = [others[k] for k in rng.choice(len(others), trials, replace=False)]
        result = fit(scene, [*chosen, *kept], free, hold_out=held, balance=False, **options)
        found.append(result.table.of(result.held_out).means["fitted"])
    return found
