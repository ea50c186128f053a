"""`uvms accuracy --hard`: every hard case by every integrator in both precisions, as a table, JSON and a picture."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from uvms_gym.cli.common import circumstances, console, fail, prepare, progress, say, table, write_json
from uvms_gym.cli.hard import CASES, Case
from uvms_gym.cli.hard.case import BAR, BAR_FLOAT32, COARSEST, DTYPES, GROSS, Run, judge, methods

FILES = ("hard.json", "hard.png")
SHORT = {"float64": "f64", "float32": "f32"}


def run_hard(out: Path | None, json_file: Path | None, only: Sequence[str] = ()) -> int:
    """Run the hard cases, print what comes of them, and write hard.json and hard.png to `out`.

    Returns the exit status: 1 if a run misses its bar without a warning, or a coarser step is grossly wrong without
    one. `only` picks cases by parts of their names.

    Raises
    ------
    TyperException
        No case is called so, or a folder cannot be written to.
    """
    cases = [case for case in CASES if not only or any(part in case.name for part in only)]
    if not cases:
        raise fail(f"no hard case has {' or '.join(map(repr, only))} in its name; there are: {_names()}")
    prepare(out, json_file, FILES)
    with progress() as bar:
        task = bar.add_task("hard cases", total=len(cases) * len(methods()) * len(DTYPES))
        runs = run_all(cases, lambda: bar.advance(task))
    _print(cases, runs)
    data = {"circumstances": circumstances("accuracy --hard", {"only": list(only)}), "results": as_data(cases, runs)}
    if json_file is not None:
        write_json(json_file, data)
    if out is not None:
        write_json(out / "hard.json", data)
        _draw(out / "hard.png", cases, runs)
        console.print(f"{out}: {', '.join(FILES)}", markup=False, soft_wrap=True)
    return int(any(run.verdict == "SILENT" for run in runs))


def run_all(cases: Sequence[Case], tick: Callable[[], None] = lambda: None) -> list[Run]:
    """Run cases by every method in both precisions, at the recommended step and at coarser ones."""
    runs = []
    for case in cases:
        for dtype in DTYPES:
            for method in methods():
                runs.append(judge(case, method, dtype))
                runs += [judge(case, method, dtype, step) for step in case.coarser_steps(method)]
                tick()
    return runs


def as_data(cases: Sequence[Case], runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Everything about cases and runs, for JSON."""
    rows = []
    for case in cases:
        truth = case.truth()
        rows.append(
            {
                "case": case.name,
                "tests": case.tests,
                "truth": truth.how,
                "doubt": truth.doubt,
                "reason": case.reason,
                "runs": [
                    {
                        "integrator": run.method,
                        "dtype": run.dtype,
                        "step": run.step,
                        "recommended": run.recommended,
                        "error": run.error,
                        "errors": run.errors,
                        "bar": run.bar,
                        "verdict": run.verdict,
                        "warnings": run.warnings[:1],
                    }
                    for run in runs
                    if run.case == case.name
                ],
            }
        )
    return rows


def _names() -> str:
    return ", ".join(case.name for case in CASES)


def _print(cases: Sequence[Case], runs: Sequence[Run]) -> None:
    default = methods()[0].name
    rows = []
    for case in cases:
        own = [run for run in runs if run.case == case.name and run.recommended]
        coarser = [run for run in runs if run.case == case.name and not run.recommended]
        first = {run.dtype: run for run in own if run.method == default}
        double, single = (first[dtype] for dtype in DTYPES)
        worst = max(own, key=lambda run: run.error / run.bar)
        verdicts = Counter(run.verdict for run in own)
        wrong = Counter(run.verdict for run in coarser if run.verdict != "meets")
        rows.append(
            (
                case.name,
                f"{double.step:g}",
                _number(double.error),
                _number(single.error),
                f"{double.bar:.0e}",
                f"{worst.method} {SHORT[worst.dtype]}",
                _number(worst.error),
                f"{worst.bar:.0e}",
                _counts(verdicts),
                _counts(wrong) if wrong else "none" if coarser else "",
            )
        )
    header = ("case", "step s", f"{default} f64", "f32", "bar", "worst", "error", "bar", "verdicts", "coarser")
    table("Hard cases: relative error at the recommended step", header, rows)
    say(
        f"Every case by {len(methods())} integrators in two precisions. Bars: {BAR:g} for order 4 in f64, its p/4-th "
        f"power for order p < 4, at least {BAR_FLOAT32:g} in f32, or as the case says; each order's step was then "
        "chosen to keep them. A run meets its bar, or a warning names scene, rate and step; SILENT is neither. Steps "
        f"up to 200 times coarser, of at most {COARSEST:g} s, may miss the bar but must not err by more than "
        f"{GROSS:g} without a warning: the last column counts those that err so."
    )
    for run in runs:
        if run.recommended and run.verdict != "meets":
            quantity = max(run.errors, key=lambda name: run.errors[name])
            text = run.warnings[0] if run.warnings else "no warning"
            say(
                f"{run.case}, {run.method} {SHORT[run.dtype]} at {run.step:g} s: {run.verdict}, "
                f"{quantity} errs by {_number(run.error)} against {run.bar:.0e}: {text}"
            )


def _counts(verdicts: Counter[str]) -> str:
    return ", ".join(f"{verdicts[name]} {name}" for name in ("meets", "warned", "SILENT") if verdicts[name])


def _number(error: float) -> str:
    return f"{error:.1e}" if math.isfinite(error) else "not finite"


def _draw(path: Path, cases: Sequence[Case], runs: Sequence[Run]) -> None:
    """Decades from the bar, by case, integrator and precision: at the recommended step above all others."""
    columns = [(method.name, dtype) for dtype in DTYPES for method in methods()]
    found = {(run.case, run.method, run.dtype): run for run in runs if run.recommended}
    ratio = np.array([[_decades(found[case.name, *column]) for column in columns] for case in cases])
    # Blue meets, vermilion misses; the nearer to the bar, the paler.
    colours = mpl.colormaps["RdBu_r"](np.linspace(0.0, 1.0, 256))
    with mpl.rc_context({"font.size": 9.0, "figure.constrained_layout.use": True}):
        figure = Figure(figsize=(3.5 + 0.55 * len(columns), 2.2 + 0.32 * len(cases)))
        axes = figure.subplots()
        image = axes.imshow(ratio, cmap=ListedColormap(colours), vmin=-6.0, vmax=6.0, aspect="auto")
        for i, case in enumerate(cases):
            for j, column in enumerate(columns):
                run = found[case.name, *column]
                mark = {"meets": "", "warned": "w", "SILENT": "!"}[run.verdict]
                exponent = f"{math.log10(max(run.error, 1e-17)):.0f}" if math.isfinite(run.error) else "inf"
                dark = abs(ratio[i, j]) > 4.0
                axes.text(j, i, exponent + mark, ha="center", va="center", color="white" if dark else "black")
        axes.set_xticks(
            range(len(columns)), [f"{name} {SHORT[dtype]}" for name, dtype in columns], rotation=60, ha="right"
        )
        axes.set_yticks(range(len(cases)), [case.name for case in cases])
        axes.axvline(len(methods()) - 0.5, color="black", linewidth=1.0)
        title = "Hard cases: decimal exponent of the relative error at the recommended step"
        axes.set_title(f"{title}\n(w: misses its bar with a warning, !: without one)", loc="left")
        figure.colorbar(image, label="decades above (red) or below (blue) the bar", shrink=0.6)
        try:
            figure.savefig(path, dpi=130)
        except OSError as error:
            raise fail(f"cannot write {path}: {error.strerror}") from None


def _decades(run: Run) -> float:
    ratio = run.error / run.bar
    return float(np.clip(math.log10(max(ratio, 1e-12)), -6.0, 6.0)) if math.isfinite(ratio) else 6.0
