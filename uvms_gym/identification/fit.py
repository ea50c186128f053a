"""Fits of a scene to logs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from uvms_gym._core import load_scene
from uvms_gym.identification.intervals import Uncertainty, uncertainty
from uvms_gym.identification.least_squares import Solution, minimise
from uvms_gym.identification.parameters import Parameter, make_parameters
from uvms_gym.identification.problem import FLOATING, ReplayProblem, counting, predict, rms
from uvms_gym.identification.recordings import PERIOD, Floats, record
from uvms_gym.identification.replay import Corrections, Replay, check, stated_step
from uvms_gym.identification.validation import Table, select
from uvms_gym.logs import Log
from uvms_gym.logs.log import Scene

#: Called with the stage ("dynamics", "balance"), the number of the iteration, and the cost.
Report = Callable[[str, int, float], None]


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of a fit of p parameters.

    Attributes
    ----------
    start : dict
        Scene before the fit.
    scene : dict
        Fitted scene.
    corrections : Corrections
        Corrections of the logs by the parameters of the map.
    parameters : list of Parameter
        Free numbers with priors.
    solution : Solution
        Minimum.
    uncertainty : Uncertainty
        Covariance of the coordinates.
    channels : tuple of str
        Channels that counted.
    train : tuple of str
        Names of the trials that were fitted.
    held_out : tuple of str
        Names of the trials that the fit did not see.
    table : Table
        Errors of all trials, by predictor: "fitted", "start", "balance fitted", "balance" (with the fitted scene),
        "constant".
    """

    start: dict[str, Any]
    scene: dict[str, Any]
    corrections: Corrections
    parameters: list[Parameter]
    solution: Solution
    uncertainty: Uncertainty
    channels: tuple[str, ...]
    train: tuple[str, ...]
    held_out: tuple[str, ...]
    table: Table

    @property
    def values(self) -> dict[str, float]:
        """Fitted values by key."""
        return {p.key: p.value(x) for p, x in zip(self.parameters, self.solution.common.tolist())}

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % intervals of the values by key, within the bounds."""
        half, bounds = self.uncertainty.quantile * self.uncertainty.deviations, [p.bounds for p in self.parameters]
        ends = np.clip(self.solution.common + np.array([-half, half]), *np.transpose(bounds)).T.tolist()
        return {p.key: (p.value(low), p.value(high)) for p, (low, high) in zip(self.parameters, ends)}

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the values by key, to first order, clustered by trial."""
        values, deviations = self.values, zip(self.parameters, self.uncertainty.deviations.tolist())
        return {p.key: d * values[p.key] if p.logarithmic else d for p, d in deviations}

    @property
    def at_bounds(self) -> list[str]:
        """Keys at a bound."""
        return [p.key for p, held in zip(self.parameters, self.solution.at_bound) if held]

    @property
    def undetermined(self) -> list[tuple[float, dict[str, float]]]:
        """Directions that the data leave open, with shares of the prior's variance and entries of 0.3 up by key."""
        return [
            (share, {p.key: float(d) for p, d in zip(self.parameters, direction) if abs(d) >= 0.3})
            for share, direction in self.uncertainty.undetermined
        ]

    def strongest_correlations(self, minimum: float = 0.7) -> list[tuple[str, str, float]]:
        """Pairs of keys with a correlation of magnitude `minimum` up, strongest first."""
        C = self.uncertainty.correlations
        pairs = [(i, j) for i in range(len(C)) for j in range(i) if abs(C[i, j]) >= minimum]
        keys = [p.key for p in self.parameters]
        return [(keys[j], keys[i], float(C[i, j])) for i, j in sorted(pairs, key=lambda p: -abs(C[p]))]


def fit(
    scene: Scene,
    logs: Sequence[Log],
    free: Sequence[str],
    *,
    hold_out: Sequence[str] = (),
    map_data: Mapping[str, Any] | None = None,
    priors: Mapping[str, float] | None = None,
    channels: Sequence[str] | None = None,
    balance: bool = True,
    period: float = PERIOD,
    integrator: str | None = None,
    dt: float | None = None,
    report: Report | None = None,
) -> Fit:
    """Fit numbers of a scene, and of the logs' map, to logs.

    All trials are replayed as one batch, from states at their starts that are fitted along; the joints move as logged.

    Parameters
    ----------
    scene : str, os.PathLike or dict
        Scene to start from; its values are the means of the priors.
    logs : sequence of Log
        Trials, read with that scene.
    free : sequence of str
        Keys of free numbers: of the scene, as `vehicle.body.damping.linear[3]`, `vehicle.body.center_of_buoyancy`
        (three numbers) or `vehicle.body.rotational_inertia[0]` (rigid and added), and of the map, as
        `map.joints.axes.wrist.zero` and `map.joints.time.lag`.
    hold_out : sequence of str
        Names or patterns ("004-*") of trials that the fit does not see.
    map_data : mapping, optional
        Data of the map that the logs were read with, for the values of its keys.
    priors : mapping of str to float, optional
        Standard deviations of priors by key, relative for positive quantities.
    channels : sequence of str, optional
        Channels of `CHANNELS` that count. Default: roll, pitch and their rates; all where the logs have thrusters.
    balance : bool
        Fit static balance as well, for comparison.
    period : float
        Interval between compared samples, s.
    integrator, dt : optional
        Integrator and maximum step, s, of the replays, as of `validate`.
    report : callable, optional
        Called after every iteration. KeyboardInterrupt ends the fit of the dynamics; the result is the best
        step so far.

    Raises
    ------
    ValueError
        A key, trial or channel that does not exist, or fewer than two trials to fit.
    SceneError, LogError
        Scene or log that cannot be used.
    """
    loaded = load_scene(scene)
    names = [log.name for log in logs]
    held = select(names, hold_out)
    recordings = [record(log, period) for log in logs]
    check(loaded, recordings)
    train = [r for r in recordings if r.name not in held]
    if len(train) < 2:
        raise ValueError(f"{len(train)} trials to fit, but at least 2 are needed")
    parameters = make_parameters(loaded, free, map_data, priors)
    chosen = counting(train, channels)
    steps: dict[str, Any] = {"step": stated_step(loaded), "dt": dt, "integrator": integrator}
    problem = ReplayProblem(loaded, Replay(train, **steps), parameters, chosen)
    solution = minimise(problem, report and partial(report, "dynamics"), stoppable=True)
    changed, corrections = problem.changed(solution.common)
    # (A free rotational inertia may have scaled the rigid one; `load_scene` checks the result as a whole.)
    changed = load_scene(changed)
    everything = Replay(recordings, **steps)
    measured = everything.measured_with(corrections)
    errors = {
        "fitted": predict(changed, everything, chosen, corrections) - measured,
        "start": predict(loaded, everything, chosen, Corrections()) - everything.measured,
        "balance": everything.balance(changed, corrections) - measured,
        "constant": everything.constant() - everything.measured,
    }
    if balance:
        errors["balance fitted"] = _fit_balance(loaded, Replay(train, **steps), everything, parameters, report)
    table = Table(tuple(names), {name: rms(e) for name, e in errors.items()})
    return Fit(
        start=loaded,
        scene=changed,
        corrections=corrections,
        parameters=parameters,
        solution=solution,
        uncertainty=uncertainty(solution, problem.deviations, problem.share),
        channels=chosen,
        train=tuple(r.name for r in train),
        held_out=tuple(held),
        table=table,
    )


def _fit_balance(
    scene: dict[str, Any],
    train: Replay,
    everything: Replay,
    parameters: Sequence[Parameter],
    report: Report | None,
) -> Floats:
    """Errors of static balance with the parameters that change it fitted for itself."""
    every = ReplayProblem(scene, train, parameters, FLOATING[:2], static=True)
    at, own = every.origin, every.own_origin
    nominal = every.residuals(at, own)

    def matters(k: int) -> bool:
        displaced = at.copy()
        displaced[k] += 0.01 * every.deviations[k]
        return bool(np.abs(every.residuals(displaced, own) - nominal).max() > 1e-6)

    chosen = [p for k, p in enumerate(parameters) if matters(k)]
    if not chosen:
        return everything.balance(scene) - everything.measured
    problem = ReplayProblem(scene, train, chosen, FLOATING[:2], static=True)
    solution = minimise(problem, report and partial(report, "balance"))
    changed, corrections = problem.changed(solution.common)
    return everything.balance(changed, corrections) - everything.measured_with(corrections)
