"""All hard cases by all methods, and their results as data."""

from collections.abc import Sequence
from itertools import product
from typing import Any

from uvms_gym.studies.hard_cases import CASES
from uvms_gym.studies.hard_cases.case import DTYPES, Case, Run, evaluate, methods
from uvms_gym.studies.progress import tracked

#: Attributes of runs in the data.
RUN_DATA = ("dtype", "step", "recommended", "error", "errors", "bound", "verdict", "false_alarm")


def select(parts: Sequence[str] = ()) -> list[Case]:
    """Cases with one of `parts` in their names; all without parts."""
    cases = [case for case in CASES if not parts or any(part in case.name for part in parts)]
    if not cases:
        known = ", ".join(case.name for case in CASES)
        raise ValueError(f"no hard case has {' or '.join(map(repr, parts))} in its name; known: {known}")
    return cases


def run_all(cases: Sequence[Case]) -> list[Run]:
    """Run cases by every method in both precisions, at the recommended step and at coarser ones."""
    runs = []
    for case, dtype, method in tracked(list(product(cases, DTYPES, methods())), "hard cases"):
        runs += [evaluate(case, method, dtype, step) for step in (None, *case.coarser_steps(method))]
    return runs


def as_data(cases: Sequence[Case], runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Cases, references and runs as dictionaries."""

    def described(run: Run) -> dict[str, Any]:
        named = {name: getattr(run, name) for name in RUN_DATA}
        return {"integrator": run.method, **named, "warnings": run.warnings[:1]}

    return [
        {
            "case": case.name,
            "description": case.description,
            "reference": case.reference().source,
            "uncertainty": case.reference().uncertainty,
            "reason": case.reason,
            "runs": [described(run) for run in runs if run.case == case.name],
        }
        for case in cases
    ]
