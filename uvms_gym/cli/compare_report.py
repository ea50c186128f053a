"""Tables of a comparison."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from uvms_gym.cli.common import console, table
from uvms_gym.cli.compare_cells import CONDITIONS, Cell
from uvms_gym.cli.compare_runs import METRICS, SETTLED
from uvms_gym.cli.compare_summary import HEADLINE, Summary, is_learned, rivals
from uvms_gym.cli.statistics import Estimate

_ERRORS = [name for name, metric in METRICS.items() if metric.error]
_COSTS = ("effort", "saturation", "variation", "recovery", "within", "success", "diverged")

NOTES = (
    "Errors are root mean squares over an episode's steps; pose is sqrt(position^2 + (0.5 m attitude)^2). Numbers are "
    "interquartile means over training seeds and episodes (success and diverged: means) with 95 % bootstrap intervals "
    "that resample both; p95 is the 95th percentile. P(better) is the chance that an episode has less of an error than "
    "any of the baseline (rliable's probability of improvement). Effort is the mean of |T/T_max|^1.5; variation that "
    "of the squared change of the action between steps; recovery how long the last stay outside the tolerance took; "
    "success the share of episodes that end within it."
)


def detail(cell: Cell, summary: Summary, missing: Mapping[str, str]) -> None:
    """Print all of a cell."""
    names = list(summary.controllers)
    episodes = next(iter(summary.controllers.values()))["episodes"]
    console.rule(f"{cell.name}: {episodes} episodes", style="dim")
    _margins(summary, names)
    _overview(summary, names)
    rows = []
    for name in names:
        metrics = summary.controllers[name]["metrics"]
        texts = []
        for metric in _ERRORS[1:]:
            whole, scale = metrics[metric]["whole"], METRICS[metric].scale
            texts += [text(whole["iqm"], scale), _brief(whole["p95"], scale)]
        rows.append((name, *texts))
    header = [word for metric in _ERRORS[1:] for word in (METRICS[metric].label, "p95")]
    table("Errors, whole episode", ("controller", *header), rows)
    rows = [(name, *(_cost(summary, name, metric) for metric in _COSTS)) for name in names]
    table("Effort and what came of it, whole episode", ("controller", *(METRICS[m].label for m in _COSTS)), rows)
    rows = []
    shown = (*_ERRORS, "effort")
    for name in names:
        metrics = summary.controllers[name]["metrics"]
        rows.append((name, *(text(metrics[metric]["settled"]["iqm"], METRICS[metric].scale) for metric in shown)))
    table(f"After {SETTLED:g} s", ("controller", *(METRICS[metric].label for metric in shown)), rows)
    own = [
        name for name in names if name in rivals(names) and summary.controllers[name]["origin"].get("tuned", 0) is None
    ]
    if own:
        console.print(f"not tuned, but with their own gains: {', '.join(own)}", markup=False)
    for why in dict.fromkeys(missing.values()):
        console.print(f"{why}: {', '.join(name for name in missing if missing[name] == why)}", markup=False)
    console.print()


def _margins(summary: Summary, names: Sequence[str]) -> None:
    """Print by how much learned controllers (all, if none is) differ from classical ones."""
    controlled = [name for name in names if name not in ("none", summary.baseline)]
    contenders = [name for name in names if is_learned(name)] or controlled
    others = [name for name in rivals(names) if contenders != [name]]
    if not contenders or not others:
        return
    rows = []
    for rival in others:
        ratios = summary.against[rival]
        cells = ["" if name == rival else percent(ratios[name][HEADLINE]["whole"]["ratio"]) for name in contenders]
        rows.append((f"against {rival}", *cells))
    table("Pose error, less (-) or more (+) than the classical controllers'", ("", *contenders), rows)


def _overview(summary: Summary, names: Sequence[str]) -> None:
    first = summary.baseline
    rows = []
    for name in names:
        metrics = summary.controllers[name]["metrics"][HEADLINE]["whole"]
        scale = METRICS[HEADLINE].scale
        row = [name, text(metrics["iqm"], scale), _brief(metrics["p95"], scale)]
        if name != first:
            ratios = summary.against[first][name]
            pose = ratios[HEADLINE]["whole"]
            row += [
                percent(pose["ratio"]),
                f"{pose['probability_of_improvement'].value:.2f}",
                text(pose["p95_ratio"], 1.0, 2),
                *(text(ratios[metric]["whole"]["ratio"], 1.0, 2) for metric in ("effort", "variation")),
            ]
        else:
            row += ["", "", "1", "1", "1"]
        rows.append(row)
    header = ("controller", METRICS[HEADLINE].label, "p95, mm", f"against {first}", "P(better)")
    table("Pose error and its price", (*header, f"p95 / {first}", f"effort / {first}", f"variation / {first}"), rows)


def _cost(summary: Summary, name: str, metric: str) -> str:
    estimates = summary.controllers[name]["metrics"][metric]["whole"]
    scale = METRICS[metric].scale
    return text(estimates["iqm"], scale) if "iqm" in estimates else _brief(estimates["mean"], scale)


def across(
    group: str, cells: Sequence[Cell], summaries: Sequence[Summary], missing: Sequence[Mapping[str, str]]
) -> None:
    """Print a group's cells next to one another: errors, and who wins by how much."""
    names = list(dict.fromkeys(name for summary in summaries for name in summary.controllers))
    names += [name for name in dict.fromkeys(n for lacks in missing for n in lacks) if name not in names]
    console.rule(f"{group}: all conditions", style="dim")
    rows, verdicts = [], []
    for cell, summary, lacks in zip(cells, summaries, missing, strict=True):
        row = [cell.label]
        for name in names:
            if name in summary.controllers:
                value = METRICS[HEADLINE].scale * _headline(summary, name).value
                row.append(f"{value:.{0 if value >= 100 else 1}f}" + ("*" if name == summary.winner else ""))
            else:
                row.append(lacks.get(name, "-"))
        rows.append(row)
        verdicts.append(_verdict(cell, summary))
    table(f"Pose error, {METRICS[HEADLINE].unit}, interquartile mean (* least)", ("", *names), rows)
    header = ("", "what it is", "least", "next", "least against next", "best learned against best classical")
    table("Who wins, by how much", header, verdicts, text_columns=4)


def _verdict(cell: Cell, summary: Summary) -> list[str]:
    what = CONDITIONS[cell.condition].summary
    learned, classical = best(summary)
    row = [cell.label, what, summary.winner, summary.runner_up or ""]
    row.append(percent(summary.margin) if summary.margin is not None else "")
    if learned is not None and classical is not None:
        ratio = summary.against[classical][learned][HEADLINE]["whole"]["ratio"]
        row.append(f"{learned} {percent(ratio)} {classical}")
    else:
        row.append("")
    return row


def best(summary: Summary) -> tuple[str | None, str | None]:
    """Learned controller and classical rival with the least error, where there are any."""
    names = sorted(summary.controllers, key=lambda name: _headline(summary, name).value)
    learned = next((name for name in names if is_learned(name)), None)
    return learned, next((name for name in names if name in summary.against), None)


def _headline(summary: Summary, name: str) -> Estimate:
    estimate: Estimate = summary.controllers[name]["metrics"][HEADLINE]["whole"]["iqm"]
    return estimate


def text(estimate: Any, scale: float = 1.0, digits: int | None = None) -> str:
    """Write a value with its interval, to two digits of the interval's width unless told."""
    value, low, high = (scale * number for number in estimate)
    if not math.isfinite(high - low) or high - low <= 1e-12 * abs(value):
        return f"{value:.4g}"
    if digits is None:
        digits = max(0, 1 - math.floor(math.log10(high - low)))
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def _brief(estimate: Any, scale: float) -> str:
    """Write a value alone, to three digits or more."""
    value = scale * estimate[0]
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def percent(ratio: Any) -> str:
    """Write a ratio as what it is more or less than 1."""
    value, low, high = (100.0 * (number - 1.0) for number in ratio)
    digits = 0 if not math.isfinite(high - low) or high - low >= 1.0 else 1
    if not math.isfinite(high - low):
        return f"{value:+.0f} %" if math.isfinite(value) else "-"
    return f"{value:+.{digits}f} % [{low:+.{digits}f}, {high:+.{digits}f}]"
