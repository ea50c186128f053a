"""`uvms hard-cases`: every hard case by every integrator in both precisions."""

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from uvms_gym.cli.common import prepare, progress, user_errors
from uvms_gym.cli.options import Json, Out, several
from uvms_gym.cli.output import name_files, say, table, write_results
from uvms_gym.studies.hard_cases.case import (
    BOUND,
    BOUND_FLOAT32,
    COARSEST,
    DTYPES,
    GROSS,
    SMALL,
    Case,
    Run,
    methods,
)
from uvms_gym.studies.hard_cases.plots import SHORT, plot_hard_cases
from uvms_gym.studies.hard_cases.study import as_data, run_all, select
from uvms_gym.studies.records import circumstances

FILES = ("hard-cases.json", "hard-cases.png")


def hard_cases(
    case: Annotated[list[str] | None, several("Part of a case's name", "all cases")] = None,
    out: Out = Path("out/hard-cases"),
    json_file: Json = None,
) -> int:
    """Run the hard cases: motions in which simulators fail first, each against an exact or converged reference.

    Prints tables, and writes hard-cases.json and hard-cases.png to --out. The exit status is 1 if a run misses its
    bound without a warning, or a coarser step has a gross error without one.
    """
    with user_errors():
        cases = select(case or ())
    prepare(out, json_file, FILES)
    with progress():
        runs = run_all(cases)
    data = {"circumstances": circumstances("hard-cases", {"case": case or []}), "results": as_data(cases, runs)}
    write_results(out, FILES, json_file, data)
    with user_errors(verb="write"):
        plot_hard_cases(out / FILES[1], cases, runs)
    _print(cases, runs)
    name_files(out, FILES)
    return int(any(run.verdict == "SILENT" for run in runs))


def _print(cases: Sequence[Case], runs: Sequence[Run]) -> None:
    default = methods()[0].name
    rows = []
    for case in cases:
        own = [run for run in runs if run.case == case.name and run.recommended]
        coarser = [run for run in runs if run.case == case.name and not run.recommended]
        first = {run.dtype: run for run in own if run.method == default}
        double, single = (first[dtype] for dtype in DTYPES)
        worst = max(own, key=lambda run: run.error / run.bound)
        wrong = [run for run in coarser if run.verdict != "meets"]
        first_cells = (f"{double.step:g}", _number(double.error), _number(single.error), f"{double.bound:.0e}")
        worst_cells = (f"{worst.method} {SHORT[worst.dtype]}", _number(worst.error), f"{worst.bound:.0e}")
        verdicts = (_counts(own), _counts(wrong) if wrong else "none" if coarser else "")
        rows.append((case.name, *first_cells, *worst_cells, *verdicts))
    header = ("case", "step s", f"{default} f64", "f32", "bound", "worst", "error", "bound", "verdicts", "coarser")
    table("Hard cases: relative error at the recommended step", header, rows)
    say(
        f"Every case by {len(methods())} integrators in two precisions. Bounds: {BOUND:g} for order 4 in f64, its "
        f"p/4-th power for order p < 4, at least {BOUND_FLOAT32:g} in f32, or given by the case; the step of each "
        "order was chosen to meet them. A run meets its bound, or a warning names scene, rate and step; SILENT is "
        f"neither. Steps up to 200 times coarser, of at most {COARSEST:g} s, may miss the bound, but not by an error "
        f"above {GROSS:g} without a warning: the last column counts errors above it. All options are the "
        "defaults: errors are watched, not asked for."
    )
    alarms = sum(run.false_alarm for run in runs)
    say(f"False alarms, warnings of errors below {SMALL:g}: {alarms} of {len(runs)} runs.")
    for run in runs:
        if run.recommended and run.verdict != "meets":
            quantity = max(run.errors, key=lambda name: run.errors[name])
            text = run.warnings[0] if run.warnings else "no warning"
            say(
                f"{run.case}, {run.method} {SHORT[run.dtype]} at {run.step:g} s: {run.verdict}, error of "
                f"{quantity} {_number(run.error)}, bound {run.bound:.0e}: {text}"
            )


def _counts(runs: Sequence[Run]) -> str:
    verdicts = Counter(run.verdict for run in runs)
    return ", ".join(f"{verdicts[name]} {name}" for name in ("meets", "warned", "SILENT") if verdicts[name])


def _number(error: float) -> str:
    return f"{error:.1e}" if math.isfinite(error) else "not finite"
