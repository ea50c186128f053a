"""Statistics of scores with confidence intervals, as defined by rliable.

Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice", 2021: interquartile means,
probability of improvement and performance profiles, with percentile intervals of a bootstrap within each task.

Scores of a controller in one task are a matrix (S, N): training seeds by episodes, S = 1 without training. All seeds
and all controllers run the same N episodes, so their scores are paired. A resample draws seeds and episodes, each with
replacement and independently of one another, and takes the scores at their crossings; its episodes are the same for all
controllers. Intervals thus hold for other training seeds as well as for other episodes, and intervals of ratios
and differences use the pairing.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym.studies.numerics import Floats

RESAMPLES = 1000
CONFIDENCE = 0.95
#: Share that interquartile means leave out at either end.
QUARTER = 0.25
#: Scores in a chunk of resamples, which fits into the processor's cache.
_CHUNK = 1 << 19


class Estimate(NamedTuple):
    """A statistic with the ends of its confidence interval."""

    value: float
    low: float
    high: float


class Sample(NamedTuple):
    """Value of a statistic, and its values for the resamples (R,)."""

    value: float
    resampled: Floats

    def estimate(self, confidence: float = CONFIDENCE) -> Estimate:
        """Value with its percentile interval, NaN if a resample has no value."""
        if not np.isfinite(self.resampled).all():
            return Estimate(self.value, float("nan"), float("nan"))
        tail = 0.5 * (1.0 - confidence)
        low, high = np.quantile(self.resampled, [tail, 1.0 - tail])
        return Estimate(self.value, float(low), float(high))

    def over(self, other: Self) -> "Sample":
        """Ratio by resample; NaN where the other is 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            resampled = np.where(other.resampled == 0.0, np.nan, self.resampled / other.resampled)
        return Sample(self.value / other.value if other.value else float("nan"), resampled)


class Profile(NamedTuple):
    """Share of scores up to each of T thresholds (T,), with the ends of its confidence intervals (T,)."""

    value: Floats
    low: Floats
    high: Floats


class Draws:
    """Resamples of N episodes, and of training seeds, as counts of each.

    Parameters
    ----------
    episodes : int
        N.
    seed : int
        Seed of the resampling.
    resamples : int
        R.
    """

    def __init__(self, episodes: int, seed: int, resamples: int = RESAMPLES) -> None:
        self._seed, self.resamples = seed, resamples
        #: Counts of each episode in each resample, (R, N).
        self.episodes = _copies(np.random.default_rng([seed, 0]), episodes, resamples)

    def seeds(self, count: int) -> NDArray[np.uint8]:
        """Counts of each of `count` training seeds in each resample, (R, S)."""
        return _copies(np.random.default_rng([self._seed, count]), count, self.resamples)

    def counts(
        self, shape: tuple[int, ...], order: NDArray[np.intp], width: int
    ) -> Iterator[tuple[slice, NDArray[np.int32]]]:
        """Chunks (k, S N) of the counts of scores of a matrix (S, N), taken in an order (S N,), in each resample.

        A chunk holds `width` numbers per resample.
        """
        seeds, episodes = shape
        step = max(1, _CHUNK // width)
        drawn = self.seeds(seeds)
        for start in range(0, self.resamples, step):
            chunk = slice(start, min(start + step, self.resamples))
            counts = self.episodes[chunk].take(order % episodes, axis=1).astype(np.int32)
            if seeds > 1:
                counts *= drawn[chunk].take(order // episodes, axis=1)
            yield chunk, counts


class Scores:
    """Scores (S, N) of a controller in a task, with their resamples.

    Raises
    ------
    ValueError
        Scores are empty, or of another number of episodes than the draws.
    """

    def __init__(self, scores: ArrayLike, draws: Draws) -> None:
        self.scores = np.atleast_2d(np.asarray(scores, dtype=np.float64))
        if self.scores.size == 0:
            raise ValueError("no scores")
        if self.scores.shape[1] != draws.episodes.shape[1]:
            raise ValueError(f"{self.scores.shape[1]} episodes, but {draws.episodes.shape[1]} are drawn")
        self._draws = draws
        self._order = np.argsort(self.scores, axis=None, kind="stable")
        self._sorted = self.scores.ravel()[self._order]

    def statistics(
        self, cut: float = QUARTER, quantile: float = 0.95, thresholds: Sequence[float] = ()
    ) -> tuple[Sample, Sample, Profile]:
        """Mean without a share `cut` (rounded down) at either end, a quantile, and the performance profile."""
        n, draws = self._sorted.size, self._draws
        first, last = int(cut * n), n - int(cut * n)
        rank = quantile * (n - 1)
        below = int(rank)
        # With cumulative counts of the sorted scores, a mean over ranks is a sum over the scores' increments.
        steps = np.diff(self._sorted, append=self._sorted[-1])
        places = np.searchsorted(self._sorted, np.asarray(thresholds), side="right")
        means, quantiles = np.empty(draws.resamples), np.empty(draws.resamples)
        shares = np.empty((draws.resamples, len(places)))
        for chunk, counts in draws.counts(self.scores.shape, self._order, n):
            upto = np.cumsum(counts, axis=1, dtype=np.int32)
            ends = np.array([np.searchsorted(row, (below, min(below + 1, n - 1)), side="right") for row in upto])
            low, high = self._sorted[ends].T
            quantiles[chunk] = low + (rank - below) * (high - low)
            if len(places):
                shares[chunk] = np.where(places == 0, 0.0, upto[:, np.maximum(places, 1) - 1]) / n
            np.clip(upto, first, last, out=upto)
            upto -= first
            # A matrix product would use several threads.
            summed = np.einsum("rn,n->r", upto, steps)
            means[chunk] = self._sorted[-1] - summed / (last - first)
        value = float(self._sorted[first:last].mean())
        tail = 0.5 * (1.0 - CONFIDENCE)
        low, high = np.quantile(shares, [tail, 1.0 - tail], axis=0)
        return (
            Sample(value, means),
            Sample(float(np.quantile(self._sorted, quantile)), quantiles),
            Profile(places / n, low, high),
        )

    def improvement(self, other: Self) -> Sample:
        """Probability that a score is less than one of another controller's; ties count half.

        This is the Mann-Whitney statistic over all pairs of scores. Less is better: scores are errors and efforts.
        """
        below = np.searchsorted(other._sorted, self._sorted, side="left")
        upto = np.searchsorted(other._sorted, self._sorted, side="right")
        pairs = float(self._sorted.size * other._sorted.size)
        resampled = np.empty(self._draws.resamples)
        width = self._sorted.size + other._sorted.size
        ours, theirs = (x._draws.counts(x.scores.shape, x._order, width) for x in (self, other))
        for (chunk, counts), (_, others) in zip(ours, theirs, strict=True):
            passed = np.zeros((len(others), other._sorted.size + 1), dtype=np.int32)
            np.cumsum(others, axis=1, out=passed[:, 1:])
            both = passed.take(below, axis=1)
            both += passed.take(upto, axis=1)
            resampled[chunk] = 1.0 - 0.5 * np.einsum("rn,rn->r", both, counts, dtype=np.float64) / pairs
        return Sample(1.0 - 0.5 * float((below + upto).sum()) / pairs, resampled)


def interquartile_mean(scores: ArrayLike) -> float:
    """Mean without a quarter of the scores (rounded down) at either end.

    Raises
    ------
    ValueError
        Scores are empty.
    """
    ordered = np.sort(np.asarray(scores, dtype=np.float64), axis=None)
    if ordered.size == 0:
        raise ValueError("no scores")
    cut = int(QUARTER * ordered.size)
    return float(ordered[cut : ordered.size - cut].mean())


def _copies(rng: np.random.Generator, n: int, resamples: int) -> NDArray[np.uint8]:
    """Counts (resamples, n) of each of n in each resample of n."""
    copies = np.empty((resamples, n), dtype=np.uint8)
    for row in copies:
        row[:] = np.bincount(rng.integers(n, size=n), minlength=n)
    return copies
