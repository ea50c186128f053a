"""Interleaved timing: every case once per round, so that other load on the machine affects all of them alike."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.progress import tracked

#: Minimum duration of a sample, s, by repeated calls: the first one, with caches filled by the case before, is one of
#: several.
SAMPLE = 3e-2


class Times(NamedTuple):
    """Seconds per unit of work, by the clock and in CPU time of the process; numbers, or (repeats,) each."""

    wall: Any
    cpu: Any

    def fair(self, threads: int) -> Any:
        """Time that is minimum disturbed by other load: CPU time for one thread, else wall-clock time."""
        return self.cpu if threads == 1 else self.wall

    def per(self, work: float) -> "Times":
        """Time per unit of `work`."""
        return Times(self.wall / work, self.cpu / work)


class Case:
    """A case to time: a sample is `calls` calls of `step`, each with `work` units of work."""

    work: float
    #: Name of the scene, and of the results, for messages.
    name: str
    timed = "the timed motion"

    @cached_property
    def calls(self) -> int:
        """Number of calls for a sample of the minimum duration, by the second of two calls."""
        self.step()
        return max(1, round(SAMPLE / max(float(timed(self.step, 1).wall), 1e-7)))

    def step(self) -> None:
        """One call."""

    def sample(self) -> Times:
        """Time per unit of work."""
        return timed(self.step, self.calls).per(self.work)

    def results(self) -> Iterable[Any]:
        """Arrays that must be finite."""
        return ()

    def check(self) -> None:
        """Raise ValueError if results are not finite: NaN is fast."""
        if not all(np.isfinite(part).all() for part in self.results()):
            raise ValueError(f"{self.name}: {self.timed} is not finite")


def require(module: str, package: str, extra: str) -> None:
    """Raise ImportError with the installation command if a module cannot be imported."""
    try:
        import_module(module)
    except ImportError as error:
        raise ImportError(f"{package} is missing ({error}); run: pip install 'uvms-gym[{extra}]'") from None


def interleave(cases: Mapping[Any, Case], repeats: int) -> dict[Any, Times]:
    """Times of every case, after a discarded round."""
    samples: dict[Any, list[Times]] = {name: [] for name in cases}
    for _ in tracked(range(repeats + 1), f"{len(cases)} cases in turns"):
        for name, case in cases.items():
            samples[name].append(case.sample())
            case.check()
    return {name: Times(*np.array(values[1:]).T) for name, values in samples.items()}


def timed(call: Callable[[], object], calls: int) -> Times:
    """Time per call."""
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(calls):
        call()
    return Times(time.perf_counter() - wall, time.process_time() - cpu).per(calls)


def summary(samples: Floats | Sequence[float]) -> dict[str, float]:
    """Median, quartiles and minimum."""
    values = np.asarray(samples, dtype=np.float64)
    low, median, high = (float(x) for x in np.quantile(values, (0.25, 0.5, 0.75)))
    return {"median": median, "low": low, "high": high, "minimum": float(values.min())}
