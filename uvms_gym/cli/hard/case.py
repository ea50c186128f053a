"""What a hard case is, and how a run of one is judged."""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

import uvms_gym
from uvms_gym import Simulator

Floats = NDArray[np.float64]
#: What a run is judged by, by name: each (k, ...), one row per instant or instance.
Quantities = dict[str, Floats]
Scene = dict[str, Any]

DTYPES = ("float64", "float32")
#: Bar of a fourth-order method in float64, and the least bar in float32; relative. A method of order p < 4 has to
#: keep the p/4-th power of the former: the error of an order-p method where a fourth-order one is just good enough.
BAR, BAR_FLOAT32 = 1e-6, 1e-3
#: Relative error beyond which a result is grossly wrong, in its first digit: none may come about without a warning, at
#: any step. Warnings begin where steps get 5 % of the speed wrong, as estimated to within a few times.
GROSS = 0.1
#: The coarser steps that each case is run at too, as multiples of the recommended one, and the coarsest, s.
COARSER, COARSEST = (2, 5, 10, 20, 50, 100, 200), 0.1
#: Tolerances asked of integrators that choose their own step.
TOLERANCE = {"float64": 1e-10, "float32": 1e-6}


@dataclass(frozen=True)
class Method:
    """An integrator, as the cases need to know it."""

    name: str
    order: int = 4
    adaptive: bool = False
    implicit: bool = False


#: For a reference: the default, and a method that moves the attitude in another way.
MK4, SECOND = Method("mk4"), Method("rk4-normalise")


@cache
def methods() -> tuple[Method, ...]:
    """All integrators that are offered for use, rivals left out."""
    offered = [row for row in uvms_gym.integrators() if row["kind"] == "production"]
    return tuple(Method(row["name"], row["order"], row["adaptive"], row["implicit"]) for row in offered)


class Lost(Exception):
    """A state that is not finite, where a case cannot go on with it."""


@dataclass(frozen=True)
class Lab:
    """How a case is run: it makes simulators and steps them."""

    method: Method
    dtype: str
    step: float

    def simulator(self, scene: str | Scene, num_envs: int = 1) -> Simulator:
        """Make a simulator."""
        options: dict[str, Any] = {"tolerance": TOLERANCE[self.dtype]} if self.method.adaptive else {}
        return Simulator(
            scene, num_envs, dt=self.step, integrator=self.method.name, dtype=self.dtype, threads=1, **options
        )

    def advance(self, simulator: Simulator, time: float, **inputs: Any) -> None:
        """Step for `time` seconds under held inputs."""
        steps = round(time / self.step)
        if not math.isclose(steps * self.step, time, rel_tol=1e-9):
            raise ValueError(f"a step of {self.step:g} s does not divide {time:g} s")
        simulator.step(substeps=steps, **inputs)

    def sampled(
        self, simulator: Simulator, interval: float, count: int, look: Callable[[], Quantities], **inputs: Any
    ) -> Quantities:
        """Advance `count` times by `interval`; what `look` gives after each, one row per time."""
        rows = []
        for _ in range(count):
            self.advance(simulator, interval, **inputs)
            rows.append(look())
        return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


@dataclass(frozen=True)
class Truth:
    """What a case ought to give, how that is known, and how far it is in doubt (relative; 0 for a closed form)."""

    values: Quantities
    how: str
    doubt: float = 0.0


@dataclass(frozen=True)
class Case:
    """A hard case."""

    name: str
    #: What it tests, and what it is judged by.
    tests: str
    run: Callable[[Lab], Quantities]
    truth: Callable[[], Truth]
    #: Recommended step by order, s: that of the greatest order that is not above the method's. Methods are accurate at
    #: different steps: each has one at which its theory promises the bar.
    steps: Mapping[int, float]
    #: What every step has to divide, s.
    interval: float
    #: Recommended step of linearly implicit methods, s, where it is not that of their order.
    implicit_step: float | None = None
    #: Order that the motion lets any method have: forces with kinks or jumps within a step allow no more.
    smoothness: int = 4
    #: Why the bars, or the steps of some methods, are other than usual.
    reason: str = ""
    #: Bars of their own by dtype, for a law whose bar is given.
    bars: Mapping[str, float] = field(default_factory=dict)
    #: Whether coarser steps mean anything.
    coarser: bool = True
    #: The coarsest that does, s.
    coarsest: float = COARSEST

    def step(self, method: Method) -> float:
        """Recommended step of a method, s."""
        if method.implicit and self.implicit_step is not None:
            return self.implicit_step
        return self.steps[max(order for order in self.steps if order <= max(method.order, min(self.steps)))]

    def bar(self, method: Method, dtype: str) -> float:
        """Greatest relative error at the recommended step."""
        if dtype in self.bars:
            return self.bars[dtype]
        bar: float = BAR ** (min(method.order, self.smoothness, 4) / 4.0)
        return max(bar, BAR_FLOAT32) if dtype == "float32" else bar

    def coarser_steps(self, method: Method) -> Iterator[float]:
        """Coarser steps that divide the case's interval, s."""
        if not self.coarser:
            return
        recommended = self.step(method)
        candidates = [factor * recommended for factor in COARSER]
        for step in [*(step for step in candidates if step < 0.99 * self.coarsest), self.coarsest]:
            count = self.interval / step
            if step > 1.01 * recommended and abs(count - round(count)) < 1e-6:
                yield step


@dataclass(frozen=True)
class Run:
    """What came of a case run by one method, in one precision, at one step."""

    case: str
    method: str
    dtype: str
    step: float
    recommended: bool
    errors: dict[str, float]
    bar: float
    warnings: list[str]

    @property
    def error(self) -> float:
        """Greatest error of all quantities; infinite if something is not finite."""
        return max(self.errors.values())

    @property
    def verdict(self) -> str:
        """ "meets" the bar (or a coarse step's: is not grossly wrong), else "warned" or "SILENT"."""
        if self.error <= self.bar:
            return "meets"
        return "warned" if self.warnings else "SILENT"


def judge(case: Case, method: Method, dtype: str, step: float | None = None) -> Run:
    """Run a case, at the recommended step unless another is given."""
    recommended = step is None
    at = case.step(method) if step is None else step
    truth = case.truth().values
    with warnings.catch_warnings(record=True) as caught, np.errstate(all="ignore"):
        warnings.simplefilter("always")
        try:
            found = errors(case.run(Lab(method, dtype, at)), truth)
        except Lost:
            found = {"state": math.inf}
    messages = [str(w.message) for w in caught if issubclass(w.category, uvms_gym.StepWarning)]
    bar = case.bar(method, dtype) if recommended else max(GROSS, case.bar(method, dtype))
    return Run(case.name, method.name, dtype, at, recommended, found, bar, messages)


def errors(values: Quantities, truth: Quantities) -> dict[str, float]:
    """Relative errors by quantity: the greatest difference over the greatest magnitude; rad for rotations (k, 3, 3).

    Infinite where something is not finite.
    """
    if values.keys() != truth.keys():
        raise ValueError(f"quantities {list(values)} are not those of the truth, {list(truth)}")
    return {name: _error(values[name], truth[name]) for name in truth}


def _error(value: Floats, truth: Floats) -> float:
    if value.shape != truth.shape:
        raise ValueError(f"shape {value.shape} is not that of the truth, {truth.shape}")
    if not np.isfinite(value).all():
        return math.inf
    difference, magnitude = (np.linalg.norm(x.reshape(len(x), -1), axis=1).max() for x in (value - truth, truth))
    # A small turn by an angle has the Frobenius norm sqrt(2) times the angle.
    scale = math.sqrt(2.0) if truth.shape[1:] == (3, 3) else magnitude
    return float(difference / scale)


def converged(run: Callable[[Lab], Quantities], step: float, how: str = "") -> Truth:
    """Make a reference: mk4 at a fine step, in doubt by what another method at half that step differs from it."""
    values = run(Lab(MK4, "float64", step))
    other = run(Lab(SECOND, "float64", 0.5 * step))
    text = f"{MK4.name} at {step:g} s against {SECOND.name} at {0.5 * step:g} s" + (f"; {how}" if how else "")
    return Truth(values, text, max(errors(other, values).values()))


def instants(interval: float, count: int) -> Floats:
    """Multiples of an interval: its end, and so on, (count,)."""
    return interval * np.arange(1, count + 1, dtype=np.float64)


def single_body(name: str, body: Scene, density: float = 0.0, **water: Any) -> Scene:
    """Make the scene of one body, without gravity unless given."""
    water = {"density": density, "gravity": [0.0, 0.0, 0.0]} | water
    return {"name": f"hard case {name}", "water": water, "vehicle": {"name": name, "body": body}}
