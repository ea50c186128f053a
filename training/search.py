"""Search by CMA-ES in the logarithms of positive numbers, in growing ranges; files."""

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cma
import numpy as np
from numpy.typing import NDArray

from uvms_gym import _files

Floats = NDArray[np.float64]

#: Width of a range's edge, and of its extension there, over that of the range.
EDGE, WIDEN = 0.05, 0.5
#: Standard deviation of the first generation, over the width of a range; factor on it for known starts.
SIGMA, KNOWN = 0.15, 0.4
#: Number of final values of a search.
FINALISTS = 8


class Space:
    """The logarithms of a controller's parameters, each from 0 to 1 over its range; the range may grow."""

    def __init__(self, labels: Sequence[str], low: Sequence[float], high: Sequence[float], floor: Sequence[bool]):
        self.labels = list(labels)
        self._start, self._end = np.log(low), np.log(high)
        self.low, self.high = np.zeros(len(labels)), np.ones(len(labels))
        self._floor = np.array(floor, dtype=np.bool_)
        self.widened: list[str] = []

    def values(self, places: Floats) -> Floats:
        """Values of places (..., n), clipped to the range."""
        places = np.clip(places, self.low, self.high)
        return np.exp(self._start + places * (self._end - self._start))

    def places(self, values: Floats) -> Floats:
        """Places of values (..., n)."""
        return (np.log(values) - self._start) / (self._end - self._start)

    def outside(self, places: Floats) -> Floats:
        """Squared distance of places (..., n) from the range."""
        return np.square(places - np.clip(places, self.low, self.high)).sum(axis=-1)

    def edges(self, place: Floats) -> list[tuple[int, bool]]:
        """Indices of entries of a place (n,) at an edge, each with True for the upper edge."""
        margin = EDGE * (self.high - self.low)
        lower = (place < self.low + margin) & ~self._floor
        upper = place > self.high - margin
        return [(int(i), False) for i in np.flatnonzero(lower)] + [(int(i), True) for i in np.flatnonzero(upper)]

    def widen(self, place: Floats) -> None:
        """Extend the range where a place is at an edge."""
        for i, upper in self.edges(place):
            if upper:
                self.high[i] += WIDEN
            else:
                self.low[i] -= WIDEN
            self.widened.append(f"{self.labels[i]} {'up' if upper else 'down'}")

    @property
    def ranges(self) -> dict[str, list[float]]:
        """Ends of the current ranges."""
        low, high = self.values(self.low), self.values(self.high)
        return {label: [rounded(low[i]), rounded(high[i])] for i, label in enumerate(self.labels)}


def search(
    space: Space,
    evaluate: Callable[[int, Floats], Sequence[float]],
    *,
    start: Floats | None = None,
    generations: int,
    population: int,
    seed: int,
) -> list[Floats]:
    """Minimise a score by CMA-ES.

    Parameters
    ----------
    space
        Search space; its ranges grow where the search reaches an edge.
    evaluate : callable
        Scores of a generation, from its number and the values (population, n) of its candidates.
    start : numpy.ndarray (n,) or None
        Start; NaN entries start in the middle of the range, and so do all for None.
    seed : int
        Seed of the candidates; equal scores give an equal search.

    Returns
    -------
    list of numpy.ndarray (n,)
        Finalists: means of the last generations, late to early, and the best candidate of the last one.
    """
    rng = np.random.default_rng(seed)
    given = np.full(len(space.labels), np.nan) if start is None else space.places(start)
    place = np.where(np.isnan(given), 0.5, given)
    options = {
        "popsize": population,
        "CMA_stds": np.where(np.isnan(given), 1.0, KNOWN),
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": np.nan,
        "verbose": -9,
    }
    strategy = cma.CMAEvolutionStrategy(place, SIGMA, options)
    means = [place]
    for generation in range(generations):
        places = np.array(strategy.ask())
        scores = np.asarray(evaluate(generation, space.values(places)), dtype=np.float64)
        best = places[np.argmin(scores)]
        strategy.tell(list(places), list(scores * (1.0 + space.outside(places))))
        means.append(np.array(strategy.mean))
        # Extended ranges need generations to be searched.
        if generation < 0.8 * generations:
            space.widen(means[-1])
    back = np.unique(np.linspace(0, generations // 4, FINALISTS - 1).astype(int))
    return [*(space.values(means[-1 - i]) for i in back), space.values(best)]


def write(path: Path, data: dict[str, Any]) -> None:
    """Write JSON, each list of numbers on one line."""
    text = json.dumps(data, indent=1, allow_nan=False)
    text = re.sub(
        r"\[[^][{}\"]*\]", lambda numbers: re.sub(r"\s+", " ", numbers[0]).replace("[ ", "[").replace(" ]", "]"), text
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    _files.write(path, text + "\n")


def store(file: Path, name: str, gains: dict[str, Any], record: dict[str, Any]) -> None:
    """Replace a controller's entry in `gains.json`; the others stay."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with _files.lock(file.parent, wait=True):
        known = json.loads(file.read_text()) if file.exists() else {}
        write(file, {**known, name: {"gains": gains, "tuning": record}})


def rounded(x: float) -> float:
    """Round to four digits."""
    return float(f"{x:.4g}")
