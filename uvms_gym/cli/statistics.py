"""Interquartile means, stratified-bootstrap intervals and probability of improvement, as rliable defines them.

Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice", 2021. Scores come as strata:
one array (n,) of independent episodes per task.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

RESAMPLES = 2000
CONFIDENCE = 0.95
# Numbers that a chunk of resamples may hold, so that memory stays small whatever the number of episodes.
_CHUNK = 1_000_000


class Estimate(NamedTuple):
    """A statistic with the ends of its confidence interval."""

    value: float
    low: float
    high: float


def interquartile_mean(scores: ArrayLike) -> Floats:
    """Mean along the last axis of what is left when a quarter (rounded down) is cut off at either end.

    Raises
    ------
    ValueError
        There are no scores.
    """
    ordered = np.sort(np.asarray(scores, dtype=np.float64), axis=-1)
    n = ordered.shape[-1]
    if n == 0:
        raise ValueError("no scores")
    cut = n // 4
    return np.asarray(ordered[..., cut : n - cut].mean(axis=-1))


def bootstrap(
    strata: Sequence[ArrayLike],
    seed: int,
    statistic: Callable[[Floats], Floats] = interquartile_mean,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
) -> Estimate:
    """Estimate a statistic of all scores, with the percentile interval of a stratified bootstrap.

    Parameters
    ----------
    strata : sequence of array_like (n,)
        Scores per task; each is resampled within itself.
    seed : int
        Seed of the resampling.
    statistic : callable
        Maps (..., sum of n) to (...).
    """
    groups = [np.asarray(stratum, dtype=np.float64) for stratum in strata]
    rng = np.random.default_rng(seed)
    total = sum(len(group) for group in groups)
    values = [
        statistic(np.concatenate([group[rng.integers(len(group), size=(k, len(group)))] for group in groups], axis=1))
        for k in _chunks(resamples, total)
    ]
    return _estimate(float(statistic(np.concatenate(groups))), np.concatenate(values), confidence)


def improvement_probability(
    pairs: Sequence[tuple[ArrayLike, ArrayLike]],
    seed: int,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
) -> Estimate:
    """Estimate the probability that an episode of x scores less than one of y; ties count half.

    That is the Mann-Whitney statistic over all pairs of an episode of x with one of y, averaged over tasks, with the
    interval of a bootstrap that resamples x and y of each task. Less is better here: scores are errors and efforts.

    Parameters
    ----------
    pairs : sequence of (array_like (n,), array_like (m,))
        Scores x and y per task.
    """
    rng = np.random.default_rng(seed)
    values = np.zeros(resamples)
    value = 0.0
    for given_x, given_y in pairs:
        x = np.asarray(given_x, dtype=np.float64)
        y = np.sort(np.asarray(given_y, dtype=np.float64))
        # A resample is a number of copies of each score; their running sum counts the copies of y up to a place.
        below, upto = np.searchsorted(y, x, "left"), np.searchsorted(y, x, "right")
        value += (1.0 - 0.5 * (below + upto).mean() / len(y)) / len(pairs)
        start = 0
        for k in _chunks(resamples, len(x) + len(y)):
            counts = np.zeros((k, len(y) + 1), dtype=np.int64)
            np.cumsum(_copies(rng, len(y), k), axis=1, out=counts[:, 1:])
            passed = (_copies(rng, len(x), k) * (counts[:, below] + counts[:, upto])).sum(axis=1) / len(x)
            values[start : start + k] += (1.0 - 0.5 * passed / len(y)) / len(pairs)
            start += k
    return _estimate(value, values, confidence)


def _copies(rng: np.random.Generator, n: int, resamples: int) -> NDArray[np.int64]:
    """How often each of n scores is in each resample: (resamples, n)."""
    drawn = rng.integers(n, size=(resamples, n)) + n * np.arange(resamples)[:, None]
    return np.bincount(drawn.ravel(), minlength=n * resamples).reshape(resamples, n)


def _chunks(resamples: int, width: int) -> Iterator[int]:
    """Sizes of chunks that add up to `resamples`."""
    size = max(1, _CHUNK // max(1, width))
    for start in range(0, resamples, size):
        yield min(size, resamples - start)


def _estimate(value: float, values: Floats, confidence: float) -> Estimate:
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(values, [tail, 1.0 - tail])
    return Estimate(value, float(low), float(high))
