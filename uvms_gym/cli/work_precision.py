"""Error against cost: every integrator, step and precision over the driven motion of `uvms_gym.cli.motion`."""

import copy
import statistics
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import uvms_gym
from uvms_gym import Simulator
from uvms_gym.cli.free_body import order
from uvms_gym.cli.motion import PERIOD, Motion, Track, bodies, character, driven_motion, follow

Floats = NDArray[np.float64]
Tick = Callable[[], None]

PRECISIONS = {"f64": "float64", "f32": "float32"}
STEPS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
#: Single precision cannot meet a smaller tolerance.
LEAST_SINGLE_TOLERANCE = 1e-6
#: Quantities and their units.
QUANTITIES = {"position": "m", "attitude": "rad", "joints": "rad", "end_effector": "m"}
#: An instance that ends this far off, m or rad, counts as diverged: about a tenth of its way.
LOST = 0.3
#: An error below so many times the doubt of the reference is not to be told from it.
FLOOR = 10.0
#: Measurement of cost: instances, interleaved repeats, control periods that are timed, and those left out before.
TIMED, REPEATS, TIMED_PERIODS, WARM_PERIODS = 256, 5, 3, 1
#: An order is the slope over this many of the finest steps whose error is above the floor.
POINTS = 4
#: Greatest median error at the end effector at the recommended step, m, and its distance from the greatest stable one.
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


#: What stands for the truth, and what tells how far to trust it: another tableau and step, and another attitude.
REFERENCE = Setting("mk4", "f64", 2e-4)
CHECKS = (Setting("mk54", "f64", 0.005, 1e-12), Setting("rk4-normalise", "f64", 2.5e-4))


def integrators() -> dict[str, dict[str, Any]]:
    """All integrators by name."""
    return {entry["name"]: dict(entry) for entry in uvms_gym.integrators()}


def settings(names: Iterable[str], steps: Sequence[float], tolerances: Sequence[float]) -> list[Setting]:
    """Lay out all settings of the integrators: an adaptive one is swept over tolerances."""
    known = integrators()
    result = []
    for name in names:
        for precision in PRECISIONS:
            if known[name]["adaptive"]:
                least = LEAST_SINGLE_TOLERANCE if precision == "f32" else 0.0
                result += [Setting(name, precision, PERIOD, t) for t in tolerances if t >= least]
            else:
                result += [Setting(name, precision, step) for step in steps]
    return result


def ticks(chosen: Sequence[Setting], repeats: int) -> int:
    """How often `study` ticks."""
    return 1 + len(CHECKS) + len(chosen) + repeats


def study(
    scene: dict[str, Any],
    chosen: Sequence[Setting],
    *,
    episodes: int,
    seconds: float,
    seed: int,
    repeats: int = REPEATS,
    tick: Tick = lambda: None,
) -> dict[str, Any]:
    """Follow the motion by every setting, and set it against a reference that other methods check.

    Without repeats no cost is measured.

    Raises
    ------
    ValueError
        Even the reference leaves the finite numbers.
    """
    motion = driven_motion(scene, episodes, seconds, seed)
    # One a second, where that comes out even.
    periods = len(motion.wrench)
    samples = periods // 10 if periods % 10 == 0 else periods

    def run(setting: Setting) -> Track:
        track = follow(motion, setting.options(), samples)
        tick()
        return track

    truth = run(REFERENCE)
    if not np.isfinite(truth.end_effector).all():
        raise ValueError(f"its motion leaves the finite numbers by {REFERENCE.title}: the scene is too stiff")
    off = [_errors(run(check), truth) for check in CHECKS]
    doubt = {
        name: {
            "median": max(float(np.median(errors[name][-1])) for errors in off),
            "worst": max(float(errors[name][-1].max()) for errors in off),
        }
        for name in QUANTITIES
    }
    floor = FLOOR * doubt["end_effector"]["median"]
    rows = [_row(setting, run(setting), truth, floor) for setting in chosen]
    if repeats:
        for row, cost in zip(rows, _costs(motion, chosen, repeats, tick), strict=True):
            row["cost"] = cost
    # The joints' servos are on, and no end stop is run into.
    stable = Simulator(scene).stable_steps(vehicle_servo=False, end_stops=False)
    return {
        "character": character(motion, truth),
        "reference": {"method": REFERENCE.title, "checks": [check.title for check in CHECKS], "doubt": doubt},
        "rows": rows,
        "orders": orders(rows, stable),
        "stable_steps": stable,
    }


def without_kinks(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene without quadratic drag, whose v |v| has a kink at 0 that no method can follow at its full order."""
    smooth = copy.deepcopy(scene)
    smooth["provenance"] = {}
    for body in bodies(smooth):
        body["damping"] = {"linear": body.get("damping", {}).get("linear", [0.0] * 6)}
    return smooth


def orders(rows: Sequence[dict[str, Any]], stable: dict[str, float]) -> dict[str, dict[str, Any]]:
    """Order of every fixed-step method in double precision, by least squares over its finest steps above the floor."""
    result = {}
    for name in dict.fromkeys(row["integrator"] for row in rows if row["tolerance"] is None):
        most = stable.get(name, np.inf) / STABILITY_MARGIN
        mine = [row for row in rows if row["integrator"] == name and row["precision"] == "f64" and row["step"] <= most]
        sound = sorted((row["step"], row["end_effector"]["median"]) for row in mine if _tells(row))[:POINTS]
        if len(sound) > 1:
            steps, errors = zip(*sound, strict=True)
            result[name] = {"order": order(steps, list(errors)), "steps": steps}
    return result


def recommend(result: dict[str, Any], precision: str) -> dict[str, Any] | None:
    """Find the greatest step of MK4 that errs by less than its bar, is stable with a margin and is not warned of."""
    most = result["stable_steps"]["mk4"] / STABILITY_MARGIN
    fit = [
        row
        for row in result["rows"]
        if (row["integrator"], row["precision"]) == ("mk4", precision)
        and row["end_effector"]["median"] < RECOMMENDED[precision]
        and row["step"] <= most
        and not (row["diverged"] or row["warned_early"] or row["warned_later"])
    ]
    return max(fit, key=lambda row: float(row["step"]), default=None)


def at_cost(rows: Sequence[dict[str, Any]], integrator: str, cost: float) -> float | None:
    """Error at the end effector of a method at a cost: on its line of log error over log cost, extended at its ends."""
    line = sorted(
        (row["cost"], row["end_effector"]["median"])
        for row in rows
        if (row["integrator"], row["precision"]) == (integrator, "f64") and _tells(row) and np.isfinite(row["cost"])
    )
    if len(line) < 2:
        return None
    costs, errors = np.log(np.array(line)).T
    k = int(np.clip(np.searchsorted(costs, np.log(cost)), 1, len(costs) - 1))
    slope = (errors[k] - errors[k - 1]) / (costs[k] - costs[k - 1])
    return float(np.exp(errors[k] + slope * (np.log(cost) - costs[k])))


def find(rows: Sequence[dict[str, Any]], integrator: str, precision: str, step: float) -> dict[str, Any] | None:
    """The row of a setting, if there is one."""
    wanted = (integrator, precision, step)
    return next((row for row in rows if (row["integrator"], row["precision"], row["step"]) == wanted), None)


def _tells(row: dict[str, Any]) -> bool:
    """Whether an error says something of its method: not lost, and above the floor."""
    return not (row["diverged"] or row["floor"])


def _errors(track: Track, truth: Track) -> dict[str, Floats]:
    """Errors of every quantity, (samples, N); infinite where a number is not finite."""
    # What diverges may overflow on its way.
    with np.errstate(over="ignore", invalid="ignore"):
        turn = np.linalg.norm(track.rotation - truth.rotation, axis=(-2, -1)) / np.sqrt(8.0)
        errors = {
            "position": np.linalg.norm(track.position - truth.position, axis=-1),
            # |R - R_ref| = 2 sqrt(2) sin(angle / 2): accurate for small ones too.
            "attitude": 2.0 * np.arcsin(np.minimum(turn, 1.0)),
            "joints": np.abs(track.q - truth.q).max(axis=-1, initial=0.0),
            "end_effector": np.linalg.norm(track.end_effector - truth.end_effector, axis=-1),
        }
    return {name: np.where(np.isfinite(error), error, np.inf) for name, error in errors.items()}


def _row(setting: Setting, track: Track, truth: Track, floor: float) -> dict[str, Any]:
    errors = _errors(track, truth)
    lost = np.any([error[-1] > LOST for error in errors.values()], axis=0)
    row: dict[str, Any] = setting._asdict()
    for name, error in errors.items():
        with np.errstate(over="ignore"):
            rms = np.sqrt((error**2).mean(axis=0))
        row[name] = {
            "median": float(np.median(error[-1])),
            "worst": float(error[-1].max()),
            "rms_median": float(np.median(rms)),
            "rms_worst": float(rms.max()),
        }
    row["diverged"] = int(lost.sum())
    row["floor"] = row["end_effector"]["median"] < floor
    row["warned_early"], row["warned_later"] = track.warned_early, track.warned_later
    return row


def _costs(motion: Motion, chosen: Sequence[Setting], repeats: int, tick: Tick) -> list[float]:
    """CPU time of each setting, ns per simulated second and instance; NaN where it leaves the finite numbers.

    Taken from the start of the motion on, on one thread, in whole calls with their inputs, as the median of repeats
    that go round all settings.
    """
    motion = motion.tiled(TIMED)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        simulators = [Simulator(motion.scene, TIMED, threads=1, **setting.options()) for setting in chosen]
        spent: list[list[float]] = [[] for _ in chosen]
        for _ in range(repeats):
            for simulator, samples in zip(simulators, spent, strict=True):
                samples.append(_cost(motion, simulator))
            tick()
    return [statistics.median(samples) for samples in spent]


def _cost(motion: Motion, simulator: Simulator) -> float:
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
