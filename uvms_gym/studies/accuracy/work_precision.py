"""Error against cost of every integrator, step and precision over the driven motion of `driven_motion`."""

import copy
import statistics
import time
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

import uvms_gym
from uvms_gym import Simulator
from uvms_gym._scene import bodies
from uvms_gym.studies.accuracy.driven_motion import PERIOD, Motion, Track, character, driven_motion, follow
from uvms_gym.studies.numerics import convergence_order, loglog_interpolation, median_and_worst, state_errors
from uvms_gym.studies.progress import tracked

PRECISIONS = {"f64": "float64", "f32": "float32"}
STEPS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
#: Minimum tolerance in single precision.
MIN_SINGLE_TOLERANCE = 1e-6
#: Quantities and their units.
QUANTITIES = {"position": "m", "attitude": "rad", "joints": "rad", "end_effector": "m"}
#: Error at the end, m or rad, beyond which an instance counts as diverged: about a tenth of its path.
DIVERGED = 0.3
#: Minimum error that can be resolved, over the uncertainty of the reference.
FLOOR = 10.0
#: Measurement of cost: instances, interleaved repeats, timed control periods, and periods before them.
TIMED, REPEATS, TIMED_PERIODS, WARM_PERIODS = 256, 5, 3, 1
#: Number of finest steps, of those with errors above the floor, for the slope of an order.
POINTS = 4
#: Maximum median error at the end effector at the recommended step, m, and its distance from the maximum stable one.
RECOMMENDED = {"f64": 1e-6, "f32": 1e-5}
STABILITY_MARGIN = 1.5


class Setting(NamedTuple):
    """An integrator at a step, or at a tolerance over a control period, in a precision."""

    integrator: str
    precision: str
    step: float
    tolerance: float | None = None

    @property
    def title(self) -> str:
        """Integrator with step or tolerance."""
        return f"{self.integrator} at " + (f"{self.step:g} s" if self.tolerance is None else f"tol. {self.tolerance:g}")

    def options(self) -> dict[str, Any]:
        """Arguments of a simulator."""
        options = {"integrator": self.integrator, "dtype": PRECISIONS[self.precision], "dt": self.step}
        return options if self.tolerance is None else options | {"tolerance": self.tolerance}


#: Reference, and checks of its uncertainty: another tableau and step, and another update of the attitude.
REFERENCE = Setting("mk4", "f64", 2e-4)
CHECKS = (Setting("mk54", "f64", 0.005, 1e-12), Setting("rk4-normalise", "f64", 2.5e-4))


def integrators() -> dict[str, dict[str, Any]]:
    """All integrators by name."""
    return {entry["name"]: dict(entry) for entry in uvms_gym.integrators()}


def settings(names: Iterable[str], steps: Sequence[float], tolerances: Sequence[float]) -> list[Setting]:
    """All settings of the integrators: adaptive ones at each tolerance, others at each step."""
    known = integrators()
    result = []
    for name in names:
        for precision in PRECISIONS:
            if known[name]["adaptive"]:
                minimum = MIN_SINGLE_TOLERANCE if precision == "f32" else 0.0
                result += [Setting(name, precision, PERIOD, t) for t in tolerances if t >= minimum]
            else:
                result += [Setting(name, precision, step) for step in steps]
    return result


def study(
    scene: dict[str, Any],
    chosen: Sequence[Setting],
    *,
    episodes: int,
    seconds: float,
    seed: int,
    repeats: int = REPEATS,
) -> dict[str, Any]:
    """Errors and cost of every setting over the driven motion, against a reference checked by other methods.

    `episodes` are instances of the ensemble, `repeats` interleaved measurements of cost (0: no cost is measured).

    Returns
    -------
    dict
        `character` of the motion, `reference`, `rows` by setting, `orders` and `stable_steps` by integrator.
    """
    motion = driven_motion(scene, episodes, seconds, seed)
    # One sample per second, if the motion has whole seconds.
    periods = len(motion.wrench)
    samples = periods // 10 if periods % 10 == 0 else periods

    def run(setting: Setting) -> Track:
        return follow(motion, setting.options(), samples)

    reference = run(REFERENCE)
    if not np.isfinite(reference.end_effector).all():
        raise ValueError(f"the motion is not finite by {REFERENCE.title}: the scene is too stiff")
    differences = [state_errors(run(check), reference) for check in CHECKS]
    ends = {name: [median_and_worst(errors[name][-1]) for errors in differences] for name in QUANTITIES}
    uncertainty = {name: {key: max(end[key] for end in ends[name]) for key in ends[name][0]} for name in QUANTITIES}
    floor = FLOOR * uncertainty["end_effector"]["median"]
    rows = [_row(setting, run(setting), reference, floor) for setting in tracked(chosen, f"{scene['name']}, errors")]
    if repeats:
        for row, cost in zip(rows, _costs(motion, chosen, repeats), strict=True):
            row["cost"] = cost
    # Joint servos are on, and no joint reaches an end stop.
    stable = Simulator(scene).stable_steps(vehicle_servo=False, end_stops=False)
    titles = {"method": REFERENCE.title, "checks": [check.title for check in CHECKS]}
    return {
        "character": character(motion, reference),
        "reference": titles | {"uncertainty": uncertainty},
        "rows": rows,
        "orders": orders(rows, stable),
        "stable_steps": stable,
    }


def without_kinks(scene: dict[str, Any]) -> dict[str, Any]:
    """Copy of a scene without quadratic damping: the kink of v |v| at 0 reduces the order of any method."""
    smooth = copy.deepcopy(scene)
    smooth["provenance"] = {}
    for _, body in bodies(smooth):
        body["damping"] = {"linear": body.get("damping", {}).get("linear", [0.0] * 6)}
    return smooth


def orders(rows: Sequence[dict[str, Any]], stable: dict[str, float]) -> dict[str, dict[str, Any]]:
    """Order of every fixed-step method in double precision, by least squares over its finest steps above the floor."""
    result = {}
    for name in dict.fromkeys(row["integrator"] for row in rows if row["tolerance"] is None):
        most = stable.get(name, np.inf) / STABILITY_MARGIN
        mine = [row for row in rows if row["integrator"] == name and row["precision"] == "f64" and row["step"] <= most]
        valid = sorted((row["step"], row["end_effector"]["median"]) for row in mine if _resolved(row))[:POINTS]
        if len(valid) > 1:
            steps, errors = zip(*valid, strict=True)
            result[name] = {"order": convergence_order(steps, errors), "steps": steps}
    return result


def recommend(result: dict[str, Any], precision: str) -> dict[str, Any] | None:
    """Row of the maximum step of MK4 with an error below its bar, a stability margin and no warning."""
    most = result["stable_steps"]["mk4"] / STABILITY_MARGIN
    fit = [
        row
        for row in by_method(result["rows"]).get(("mk4", precision), ())
        if row["end_effector"]["median"] < RECOMMENDED[precision]
        and row["step"] <= most
        and not (row["diverged"] or row["warned_early"] or row["warned_later"])
    ]
    return max(fit, key=lambda row: float(row["step"]), default=None)


def at_cost(rows: Sequence[dict[str, Any]], integrator: str, cost: float) -> float | None:
    """Error at the end effector of a method at a cost, by its line of log error over log cost; None without a line."""
    line = sorted(
        (row["cost"], row["end_effector"]["median"])
        for row in by_method(rows).get((integrator, "f64"), ())
        if _resolved(row) and np.isfinite(row["cost"])
    )
    if len(line) < 2:
        return None
    costs, errors = np.transpose(line)
    return loglog_interpolation(costs, errors, cost)


def by_method(rows: Iterable[Mapping[str, Any]], precision: str = "precision") -> dict[tuple[str, str], list[Any]]:
    """Rows by integrator and precision, which has the given key."""
    found: dict[tuple[str, str], list[Any]] = {}
    for row in rows:
        found.setdefault((row["integrator"], row[precision]), []).append(row)
    return found


def find(rows: Sequence[dict[str, Any]], integrator: str, precision: str, step: float) -> dict[str, Any] | None:
    """Row of a setting, or None."""
    wanted = (integrator, precision, step)
    return next((row for row in rows if (row["integrator"], row["precision"], row["step"]) == wanted), None)


def _resolved(row: dict[str, Any]) -> bool:
    """True for an error of no diverged instance and above the floor."""
    return not (row["diverged"] or row["floor"])


def _row(setting: Setting, track: Track, reference: Track, floor: float) -> dict[str, Any]:
    errors = state_errors(track, reference)
    diverged = np.any([error[-1] > DIVERGED for error in errors.values()], axis=0)
    row: dict[str, Any] = setting._asdict()
    for name, error in errors.items():
        with np.errstate(over="ignore"):
            rms = median_and_worst(np.sqrt((error**2).mean(axis=0)))
        row[name] = median_and_worst(error[-1]) | {f"rms_{key}": value for key, value in rms.items()}
    row["diverged"] = int(diverged.sum())
    row["floor"] = row["end_effector"]["median"] < floor
    row["warned_early"], row["warned_later"] = track.warned_early, track.warned_later
    return row


def _costs(motion: Motion, chosen: Sequence[Setting], repeats: int) -> list[float]:
    """CPU time of each setting on one thread, ns per simulated second and instance: medians of interleaved repeats."""
    motion = motion.tiled(TIMED)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        simulators = [Simulator(motion.scene, TIMED, threads=1, **setting.options()) for setting in chosen]
        spent: list[list[float]] = [[] for _ in chosen]
        for _ in tracked(range(repeats), "costs"):
            for simulator, samples in zip(simulators, spent, strict=True):
                samples.append(_cost(motion, simulator))
    return [statistics.median(samples) for samples in spent]


def _cost(motion: Motion, simulator: Simulator) -> float:
    """CPU time at the start of the motion, in whole calls with their inputs; NaN where the state is not finite."""
    substeps = round(PERIOD / simulator.dt)
    simulator.set_state(**motion.start)
    begun = 0
    periods = len(motion.wrench)
    for i in range(WARM_PERIODS + TIMED_PERIODS):
        if i == WARM_PERIODS:
            begun = time.thread_time_ns()
        simulator.step(**motion.inputs(i % periods), substeps=substeps)
    passed = time.thread_time_ns() - begun
    finite = np.isfinite(simulator.twist).all() and np.isfinite(simulator.qd).all()
    return passed / (TIMED * TIMED_PERIODS * PERIOD) if finite else np.nan
