"""Search by CMA-ES in the logarithms of positive numbers, in ranges that grow; files that are whole at any time."""

import json
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cma
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Share of a range, at either end, that counts as its edge; how far the range is widened there.
EDGE, WIDEN = 0.05, 0.5
#: Standard deviation of the first generation, over the width of a range; how much less where the start is known.
SIGMA, KNOWN = 0.15, 0.4
#: How many values a search ends with.
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
        """Values of places (..., n), which are moved into the range first."""
        places = np.clip(places, self.low, self.high)
        return np.exp(self._start + places * (self._end - self._start))

    def places(self, values: Floats) -> Floats:
        """Places of values (..., n)."""
        return (np.log(values) - self._start) / (self._end - self._start)

    def outside(self, places: Floats) -> Floats:
        """Square of the distance of places (..., n) from the range."""
        return np.square(places - np.clip(places, self.low, self.high)).sum(axis=-1)

    def edges(self, place: Floats) -> list[tuple[int, bool]]:
        """Numbers of a place (n,) that are at an edge, and whether it is the upper one."""
        margin = EDGE * (self.high - self.low)
        lower = (place < self.low + margin) & ~self._floor
        upper = place > self.high - margin
        return [(int(i), False) for i in np.flatnonzero(lower)] + [(int(i), True) for i in np.flatnonzero(upper)]

    def widen(self, place: Floats) -> None:
        """Make room where a place is at an edge."""
        for i, upper in self.edges(place):
            if upper:
                self.high[i] += WIDEN
            else:
                self.low[i] -= WIDEN
            self.widened.append(f"{self.labels[i]} {'up' if upper else 'down'}")

    @property
    def ranges(self) -> dict[str, list[float]]:
        """Ends of the ranges as they are now."""
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
    """Seek the least score by CMA-ES.

    Parameters
    ----------
    space
        Where to look; its ranges are widened where the search leads to an edge.
    evaluate : callable
        Scores of a generation: of its number and the values (population, n) of its candidates.
    start : numpy.ndarray (n,) or None
        Where to begin; NaN: anywhere, so from the middle of the range; None: that for all.
    seed : int
        The same scores lead to the same search.

    Returns
    -------
    list of numpy.ndarray (n,)
        Values worth another look: means of the last generations, late to early, and the best of the very last.
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
        # What a widened range holds must still be looked at.
        if generation < 0.8 * generations:
            space.widen(means[-1])
    back = np.unique(np.linspace(0, generations // 4, FINALISTS - 1).astype(int))
    return [*(space.values(means[-1 - i]) for i in back), space.values(best)]


def write(path: Path, data: dict[str, Any]) -> None:
    """Write JSON, each list of numbers on a line, so that the file is whole whenever that is interrupted."""
    text = json.dumps(data, indent=1, allow_nan=False)
    text = re.sub(
        r"\[[^][{}\"]*\]", lambda numbers: re.sub(r"\s+", " ", numbers[0]).replace("[ ", "[").replace(" ]", "]"), text
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(text + "\n")
    os.replace(part, path)


def store(file: Path, name: str, gains: dict[str, Any], record: dict[str, Any]) -> None:
    """Put a controller's entry into `gains.json`, and leave the others alone."""
    known = json.loads(file.read_text()) if file.exists() else {}
    write(file, {**known, name: {"gains": gains, "tuning": record}})


def rounded(x: float) -> float:
    """Four digits of a number."""
    return float(f"{x:.4g}")
