"""Certificate of integration accuracy of an environment: errors of its own episodes, and a recommended step.

Episodes run under the same recorded actions by a configuration (integrator, precision, step) and by a reference of the
same environment, so policies and their feedback do not add to the differences, and seeds, disturbances and sensor noise
are the same draws. Each quantity is one number per episode, over its steps up to the end of either run:

- vehicle position (m), attitude (rad), joints (rad or m), end effector (m): maximum error of the state;
- observation: error in standard deviations of the sensor noise, in the worst entry, at 95 % of the steps;
- reward: error of the episode's sum of rewards, over the standard deviation of that sum between episodes.

A configuration is certified where 95 % of the episodes of every drive are within `LIMITS`, the step is
`STABILITY_MARGIN` times smaller than the maximum stable one, no step warning occurs, and 95 % of the episodes end at
the same step. The limits are far below anything that a simulation is used for:

- 1 mm and 1 mrad: a fifth of the noise of position and attitude, half the joints' noise, and a fiftieth and a hundredth
  of the default tolerance of a reached pose. A model's coefficients are uncertain by far more. Episodes run open loop
  here; in a closed loop the controller corrects most of such an error.
- 0.1 of the noise: noise and error together deviate 0.5 % more than the noise. No filter or policy sees a difference.
- 0.001 of the spread: a comparison resolves this difference with a million episodes.

Entries without noise (references, previous action) have no unit in that sense and are left out. So is the integral of
the errors: white noise averages out in it, so its noise is small, and its error follows from the pose, which is judged.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from uvms_gym.studies.accuracy.episodes import (
    Case,
    Configuration,
    Frame,
    Recording,
    divides,
    frame,
    noise_deviation,
    record,
)
from uvms_gym.studies.accuracy.work_precision import PRECISIONS, QUANTITIES, STABILITY_MARGIN, by_method
from uvms_gym.studies.numerics import Floats, state_errors
from uvms_gym.studies.progress import tracked

#: Candidate steps, s; those that divide the control period are used.
STEPS = (0.001, 0.002, 0.005, 0.01, 0.0125, 0.02, 0.025, 0.05)
#: Integrators in question beside the environment's own.
INTEGRATORS = ("ros2",)
#: Reference, and the check of its uncertainty: half the step and another update of the attitude.
REFERENCE = Configuration("mk4", "float64", 2.5e-4)
CHECK = Configuration("rk4-normalise", "float64", 1.25e-4)
#: Maximum errors of a certified configuration, and their units.
LIMITS = {
    "position": 1e-3,
    "attitude": 1e-3,
    "joints": 1e-3,
    "end_effector": 1e-3,
    "observation": 0.1,
    "reward": 1e-3,
}
UNITS = {**QUANTITIES, "observation": "noise", "reward": "spread"}
#: Share of episodes, and of steps for observations, within the limits.
SHARE = 0.95
#: Maximum uncertainty of the reference over the limits.
CONVERGED = 0.1
#: Block of an observation that is left out.
INTEGRAL = "error_integral"


def candidates(about: Frame) -> list[Configuration]:
    """Configurations of the table: every candidate step and precision of the default integrator and `INTEGRATORS`."""
    steps = sorted({h for h in STEPS if divides(h, about.period)} | {about.default.step})
    names = dict.fromkeys((about.default.integrator, *INTEGRATORS))
    return [Configuration(name, dtype, step) for name in names for dtype in PRECISIONS.values() for step in steps]


def certify(
    case: Case,
    chosen: Sequence[Configuration] | None = None,
    *,
    reference: Configuration = REFERENCE,
    check: Configuration = CHECK,
) -> dict[str, Any]:
    """Errors of configurations over the episodes of an environment, verdicts, and recommended steps.

    `chosen` is by default `candidates`. The difference of `check` from `reference` is the uncertainty; their steps are
    reduced to divide the control period.

    Returns
    -------
    dict
        `env`, `task`, `control_period`, `steps`, `default`, `stable_steps`; `drives` by name, each with the `spread` of
        the sum of rewards, the reference's `uncertainty` and `warned`; `rows` by configuration with the errors by
        drive, those at `SHARE` of the episodes of the worst drive, and `exceeded`, the reasons against it (none:
        certified); `recommended` steps by integrator and precision.
    """
    about = frame(case)
    chosen = candidates(about) if chosen is None else list(chosen)
    for configuration in chosen:
        if not divides(configuration.step, about.period):
            raise ValueError(
                f"step is {configuration.step:g} s, but must divide the control period of {about.period:g} s"
            )
    reference, check = (_dividing(one, about.period) for one in (reference, check))
    drives: dict[str, Any] = {}
    found: list[dict[str, Any]] = [{} for _ in chosen]
    deviation: Floats | None = None
    for name, drive in about.drives.items():
        truth = record(case, about, reference, drive)
        if deviation is None:
            deviation = noise_deviation(case, about, truth.actions)
            for block in about.layout:
                if block.name == INTEGRAL:
                    deviation[block.slice] = 0.0
        other = compare(record(case, about, check, truth.actions), truth, deviation)
        for quantity, limit in LIMITS.items():
            if not (most := other[quantity][_KEY]) <= CONVERGED * limit:
                raise ValueError(
                    f"reference not converged under {name} actions: {quantity} uncertain by {most:.1e} "
                    f"{UNITS[quantity]}, but must be within {CONVERGED * limit:g}"
                )
        drives[name] = {
            "spread": _spread(truth),
            "ended_early": int((~truth.running[-1]).sum()),
            "uncertainty": other,
            "warned": truth.warned,
        }
        for errors, configuration in tracked(list(zip(found, chosen)), f"{case.env}, {name} actions"):
            errors[name] = compare(record(case, about, configuration, truth.actions), truth, deviation)
    rows = [_row(*pair, about) for pair in zip(chosen, found, strict=True)]
    return {
        "env": case.env,
        "task": about.task,
        "control_period": about.period,
        "steps": about.steps,
        "default": about.default,
        "reference": reference,
        "check": check,
        "limits": LIMITS,
        "stable_steps": about.stable_steps,
        "drives": drives,
        "rows": rows,
        "recommended": recommend(rows),
    }


def compare(run: Recording, truth: Recording, deviation: Floats) -> dict[str, Any]:
    """Errors of a run over its episodes.

    Returns
    -------
    dict
        By quantity the `median`, `p95` and `worst` of the episodes, infinite where a number is not finite; `return`,
        the same of the error of the sum of rewards itself; `ends_differ`, the number of episodes that end at another
        step; `warned`.
    """
    both = run.running & truth.running
    seen = deviation > 0.0
    # A diverging run may overflow.
    with np.errstate(over="ignore", invalid="ignore"):
        noise = _finite(np.abs(run.observations - truth.observations)[..., seen]) / deviation[seen]
        gains = np.abs(_finite(np.where(both, run.rewards - truth.rewards, 0.0)).sum(axis=0))
    errors = {name: np.where(both, error, 0.0).max(axis=0) for name, error in state_errors(run, truth).items()}
    errors["observation"] = np.array([_quantile(noise[both[:, i], i]).max(initial=0.0) for i in range(both.shape[1])])
    with np.errstate(divide="ignore", invalid="ignore"):
        errors["reward"] = np.nan_to_num(gains / _spread(truth), nan=0.0, posinf=np.inf)
    errors["return"] = gains
    ends = (run.running.sum(axis=0) != truth.running.sum(axis=0)).sum()
    return {name: _over_episodes(error) for name, error in errors.items()} | {
        "ends_differ": int(ends),
        "episodes": both.shape[1],
        "warned": run.warned,
    }


def recommend(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Maximum certified step of every integrator and precision; None where no step is."""
    return [
        {"integrator": name, "dtype": dtype}
        | {"step": max((float(row["step"]) for row in mine if not row["exceeded"]), default=None)}
        for (name, dtype), mine in by_method(rows, "dtype").items()
    ]


#: Statistic of the episodes that is compared with the limits.
_KEY = "p95"


def _row(configuration: Configuration, errors: Mapping[str, Any], about: Frame) -> dict[str, Any]:
    judged = {name: max(found[name][_KEY] for found in errors.values()) for name in LIMITS}
    exceeded = [name for name, limit in LIMITS.items() if not judged[name] <= limit]
    if not configuration.step <= about.stable_steps[configuration.integrator] / STABILITY_MARGIN:
        exceeded.append("stability")
    if any(found["warned"] for found in errors.values()):
        exceeded.append("warning")
    if any(found["ends_differ"] > (1.0 - SHARE) * found["episodes"] for found in errors.values()):
        exceeded.append("end")
    return {**configuration._asdict(), "errors": dict(errors), "judged": judged, "exceeded": exceeded}


def _dividing(configuration: Configuration, period: float) -> Configuration:
    """Copy with the maximum step that divides the control period and is no greater."""
    return configuration._replace(step=period / int(np.ceil(period / configuration.step * (1.0 - 1e-9))))


def _finite(values: Floats) -> Floats:
    return np.where(np.isfinite(values), values, np.inf)


def _quantile(values: Floats) -> Floats:
    # No interpolation: values may be infinite.
    return np.asarray(np.quantile(values, SHARE, axis=0, method="higher"))


def _over_episodes(values: Floats) -> dict[str, float]:
    middle = np.quantile(values, 0.5, method="higher")
    return {"median": float(middle), _KEY: float(_quantile(values)), "worst": float(values.max())}


def _spread(truth: Recording) -> float:
    """Standard deviation of the sum of rewards between episodes."""
    return float(np.where(truth.running, truth.rewards, 0.0).sum(axis=0).std())
