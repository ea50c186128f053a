"""Hard cases: description, runs by a method at a step, and their evaluation."""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

import uvms_gym
from uvms_gym import Simulator
from uvms_gym.studies.hard_cases.scenes import Scene
from uvms_gym.studies.numerics import Floats

#: Results of a run by name: each (k, ...), one row per instant or instance.
Quantities = dict[str, Floats]
#: Names in `OBSERVED`, or a function of the simulator.
Observe = Sequence[str] | Callable[[Simulator], Quantities]

DTYPES = ("float64", "float32")
#: Error bound of a fourth-order method in float64, and the minimum bound in float32; relative. For a method of order
#: p < 4 the bound is the p/4-th power of the former: its error where a fourth-order method is just accurate enough.
BOUND, BOUND_FLOAT32 = 1e-6, 1e-3
#: Relative error beyond which no run may get without a warning, at any step, and that below which a warning is a false
#: alarm.
GROSS, SMALL = 0.05, 0.005
#: Coarser steps of each case, as multiples of the recommended one, and the coarsest, s.
COARSER, COARSEST = (2, 5, 10, 20, 50, 100, 200), 0.1
#: Tolerances of integrators with adaptive steps.
TOLERANCE = {"float64": 1e-10, "float32": 1e-6}
#: Observed quantities of a single instance; velocity and momentum in world axes, twist and rate in body axes.
OBSERVED: dict[str, Callable[[Simulator], Floats]] = {
    "position": lambda s: s.position[0],
    "attitude": lambda s: s.rotation[0],
    "twist": lambda s: s.twist[0],
    "rate": lambda s: s.twist[0, 3:],
    "velocity": lambda s: s.rotation[0] @ s.twist[0, :3],
    "impulse": lambda s: s.momentum()[0],
    "energy": lambda s: s.energy()["total"],
    "q": lambda s: s.q[0],
    "q'": lambda s: s.qd[0],
}


@dataclass(frozen=True)
class Method:
    """An integrator: name, order, and kind."""

    name: str
    order: int = 4
    adaptive: bool = False
    implicit: bool = False


#: Methods of numerical references: the default, and one with another update of the attitude.
MK4, SECOND = Method("mk4"), Method("rk4-normalise")


@cache
def methods() -> tuple[Method, ...]:
    """All integrators for production use, baseline methods left out."""
    offered = [row for row in uvms_gym.integrators() if row["kind"] == "production"]
    return tuple(Method(row["name"], row["order"], row["adaptive"], row["implicit"]) for row in offered)


class NonFinite(Exception):
    """A state that is not finite, from which a case cannot continue."""


@dataclass(frozen=True)
class CaseRunner:
    """Simulators and steps of a case, by one method in one precision at one step."""

    method: Method
    dtype: str
    step: float
    #: Option of the simulators.
    error_estimate: bool | None = None

    def simulator(self, scene: str | Scene, num_envs: int = 1) -> Simulator:
        """Make a simulator."""
        options: dict[str, Any] = {"tolerance": TOLERANCE[self.dtype]} if self.method.adaptive else {}
        return Simulator(
            scene,
            num_envs,
            dt=self.step,
            integrator=self.method.name,
            dtype=self.dtype,
            threads=1,
            error_estimate=self.error_estimate,
            **options,
        )

    def advance(self, simulator: Simulator, time: float, **inputs: Any) -> None:
        """Step for `time` seconds under constant inputs."""
        steps = round(time / self.step)
        if not math.isclose(steps * self.step, time, rel_tol=1e-9):
            raise ValueError(f"a step of {self.step:g} s does not divide {time:g} s")
        simulator.step(substeps=steps, **inputs)

    def sampled(self, simulator: Simulator, times: Floats, observe: Observe, **inputs: Any) -> Quantities:
        """Advance to multiples of `times[0]`, and stack what `observe` gives at each."""
        rows = []
        for _ in times:
            self.advance(simulator, times[0], **inputs)
            named = observe if callable(observe) else lambda s: {name: OBSERVED[name](s) for name in observe}
            rows.append(named(simulator))
        return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


@dataclass(frozen=True)
class Reference:
    """Exact results of a case, their source, and their relative uncertainty (0 for a closed form)."""

    values: Quantities
    source: str
    uncertainty: float = 0.0


@dataclass(frozen=True)
class Case:
    """A hard case."""

    name: str
    #: Motion and evaluated quantities, for reports.
    description: str
    run: Callable[[CaseRunner], Quantities]
    reference: Callable[[], Reference]
    #: Recommended step by order, s: a method uses the step of the maximum order not above its own, at which its theory
    #: predicts an error within the bound.
    steps: Mapping[int, float]
    #: Time that every step divides, s.
    interval: float
    #: Recommended step of linearly implicit methods by order, s, if different from the step of their order.
    implicit_steps: Mapping[int, float] = field(default_factory=dict)
    #: Maximum order on this motion: forces with kinks or jumps within a step reduce the order of any method.
    smoothness: int = 4
    #: Reason for unusual bounds or steps.
    reason: str = ""
    #: Given bounds by dtype: for conservation laws, and in float32 where the rounding of many steps adds up.
    bounds: Mapping[str, float] = field(default_factory=dict)
    #: False where coarser steps mean nothing.
    coarser: bool = True
    #: False where the errors do not judge a warning, as they are relative to more than the motion: conservation laws,
    #: angles of many turns.
    judges_warnings: bool = True
    #: The coarsest meaningful step, s.
    coarsest: float = COARSEST

    def step(self, method: Method) -> float:
        """Recommended step of a method, s."""
        steps = self.implicit_steps if method.implicit and self.implicit_steps else self.steps
        return steps[max(order for order in steps if order <= max(method.order, min(steps)))]

    def bound(self, method: Method, dtype: str) -> float:
        """Bound on the relative error at the recommended step."""
        if dtype in self.bounds:
            return self.bounds[dtype]
        bound: float = BOUND ** (min(method.order, self.smoothness, 4) / 4.0)
        return max(bound, BOUND_FLOAT32) if dtype == "float32" else bound

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
    """Results of a case by one method, in one precision, at one step."""

    case: str
    method: str
    dtype: str
    step: float
    recommended: bool
    errors: dict[str, float]
    bound: float
    warnings: list[str]
    judges_warnings: bool = True

    @property
    def error(self) -> float:
        """Maximum error of all quantities; infinite if a value is not finite."""
        error = float(np.max(list(self.errors.values())))
        return math.inf if math.isnan(error) else error

    @property
    def verdict(self) -> str:
        """ "meets" the bound (at a coarse step: no gross error), else "warned" or "SILENT"."""
        if self.error <= self.bound:
            return "meets"
        return "warned" if self.warnings else "SILENT"

    @property
    def false_alarm(self) -> bool:
        """True where a warning came with a small error."""
        return self.judges_warnings and bool(self.warnings) and self.error < SMALL


def evaluate(case: Case, method: Method, dtype: str, step: float | None = None) -> Run:
    """Run a case, at the recommended step unless another is given."""
    recommended = step is None
    at = case.step(method) if step is None else step
    reference = case.reference().values
    with warnings.catch_warnings(record=True) as caught, np.errstate(all="ignore"):
        warnings.simplefilter("always")
        try:
            found = errors(case.run(CaseRunner(method, dtype, at)), reference)
        except NonFinite:
            found = {"state": math.inf}
    messages = [str(w.message) for w in caught if issubclass(w.category, uvms_gym.StepWarning)]
    bound = case.bound(method, dtype) if recommended else max(GROSS, case.bound(method, dtype))
    return Run(case.name, method.name, dtype, at, recommended, found, bound, messages, case.judges_warnings)


def errors(values: Quantities, reference: Quantities) -> dict[str, float]:
    """Relative errors by quantity: the maximum difference over the maximum magnitude; rad for rotations (k, 3, 3).

    Infinite where a value is not finite.
    """
    if values.keys() != reference.keys():
        raise ValueError(f"quantities {list(values)} differ from the reference's, {list(reference)}")
    return {name: _error(values[name], reference[name]) for name in reference}


def _error(value: Floats, reference: Floats) -> float:
    if value.shape != reference.shape:
        raise ValueError(f"shape {value.shape} differs from the reference's, {reference.shape}")
    if not np.isfinite(value).all():
        return math.inf
    difference, magnitude = (
        np.linalg.norm(x.reshape(len(x), -1), axis=1).max() for x in (value - reference, reference)
    )
    # A small rotation by an angle has the Frobenius norm sqrt(2) times the angle.
    scale = math.sqrt(2.0) if reference.shape[1:] == (3, 3) else magnitude
    return float(difference / scale)


def converged(run: Callable[[CaseRunner], Quantities], step: float, note: str = "") -> Reference:
    """Make a numerical reference: mk4 at a fine step; its uncertainty is the difference of `SECOND` at half of it."""
    values = run(CaseRunner(MK4, "float64", step, False))
    other = run(CaseRunner(SECOND, "float64", 0.5 * step, False))
    source = f"{MK4.name} at {step:g} s against {SECOND.name} at {0.5 * step:g} s" + (f"; {note}" if note else "")
    return Reference(values, source, max(errors(other, values).values()))


def instants(interval: float, count: int) -> Floats:
    """Multiples 1, 2, ... of an interval, (count,)."""
    return interval * np.arange(1, count + 1, dtype=np.float64)


def motion(
    scene: Scene | Callable[[], Scene],
    times: Floats,
    observe: Observe,
    start: Mapping[str, Any],
    num_envs: int = 1,
    inputs: Mapping[str, Any] = {},
) -> Callable[[CaseRunner], Quantities]:
    """Make the run of a case: from a state under constant inputs, observed at multiples of `times[0]`."""

    def run(runner: CaseRunner) -> Quantities:
        simulator = runner.simulator(scene() if callable(scene) else scene, num_envs)
        simulator.set_state(**start)
        return runner.sampled(simulator, times, observe, **inputs)

    return run


def motion_case(
    name: str,
    description: str,
    scene: Scene | Callable[[], Scene],
    times: Floats,
    reference: Callable[[Floats], Reference | Quantities],
    steps: Mapping[int, float],
    start: Mapping[str, Any],
    observe: Observe = (),
    num_envs: int = 1,
    inputs: Mapping[str, Any] = {},
    **options: Any,
) -> Case:
    """Make the case of a motion (see `motion`) with exact values at its times; `options` are further fields of `Case`.

    `reference` gives the values at the times, by a closed form unless it names another source. By default the
    quantities of the same names are observed.
    """

    @cache
    def exact() -> Reference:
        found = reference(times)
        return found if isinstance(found, Reference) else Reference(found, "closed form")

    def run(runner: CaseRunner) -> Quantities:
        return motion(scene, times, observe or list(exact().values), start, num_envs, inputs)(runner)

    return Case(name, description, run, exact, steps, float(times[0]), **options)
