"""Tables of `uvms compare`."""

import math
from collections.abc import Sequence
from typing import Any

from uvms_gym.cli.common import console, line
from uvms_gym.cli.output import table
from uvms_gym.controllers.families import is_bound, is_learned, true_state
from uvms_gym.studies.comparison.conditions import DEPARTURES
from uvms_gym.studies.comparison.metrics import HEADLINE, METRICS, SETTLED
from uvms_gym.studies.comparison.plots import Results, controllers_of
from uvms_gym.studies.comparison.statistics import Estimate
from uvms_gym.studies.comparison.study import Comparison
from uvms_gym.studies.comparison.summary import Summary, baselines, closed_share, short_names

_ERRORS = [name for name, metric in METRICS.items() if metric.error]
_COSTS = ("power", "saturation", "variation", "recovery", "within", "success", "diverged")

NOTES = (
    "Errors are root mean squares over an episode's steps; pose is sqrt(position^2 + (0.5 m attitude)^2). Numbers are "
    "interquartile means over training seeds and episodes (success and diverged: means) with 95 % bootstrap intervals "
    "that resample both; p95 and p99.9 are percentiles, worst is the worst episode. P(better) is the probability that "
    "an episode has a smaller error than one of the baseline (rliable's probability of improvement). Power is the mean "
    "of |T/T_max|^1.5; variation the mean squared change of the action between steps; recovery the time of the last "
    "stay outside the tolerance; success the share of episodes that end within it."
)


def print_detail(comparison: Comparison, summary: Summary) -> None:
    """Print all statistics of a comparison."""
    names, short = list(summary.controllers), short_names(summary.controllers)
    episodes = next(iter(summary.controllers.values()))["episodes"]
    console.rule(f"{comparison.condition.name}: {episodes} episodes", style="dim")
    _margins(summary, names)
    _overview(summary, names)
    rows = [
        (short[name], *(cell for metric in _ERRORS[1:] for cell in _with_p95(summary, name, metric))) for name in names
    ]
    header = [word for metric in _ERRORS[1:] for word in (METRICS[metric].label, "p95")]
    table("Errors, whole episode", ("controller", *header), rows)
    rows = [(short[name], *(_mean(summary, name, metric) for metric in _COSTS)) for name in names]
    table("Power and outcomes, whole episode", ("controller", *(METRICS[m].label for m in _COSTS)), rows)
    shown = (*_ERRORS, "power")
    rows = [(short[name], *(_mean(summary, name, metric, "settled") for metric in shown)) for name in names]
    table(f"After {SETTLED:g} s", ("controller", *(METRICS[metric].label for metric in shown)), rows)
    own = [name for name in baselines(names) if summary.controllers[name]["origin"].get("tuned", 0) is None]
    if own:
        line(f"not tuned, default gains: {', '.join(short[name] for name in own)}")
    for reason in dict.fromkeys(comparison.missing.values()):
        line(f"{reason}: {', '.join(name for name, found in comparison.missing.items() if found == reason)}")
    print_files(names)
    console.print()


def print_files(names: Sequence[str]) -> None:
    """Print the whole names of controllers from files, which tables shorten."""
    for name, short in short_names(names).items():
        if short != name:
            line(f"{short}: {name}")


def _margins(summary: Summary, names: Sequence[str]) -> None:
    """Print differences of learned controllers (all, if none is learned) from classical ones."""
    controlled = [name for name in names if name not in ("none", summary.baseline)]
    contenders = [name for name in names if is_learned(name)] or controlled
    others = [name for name in baselines(names) if contenders != [name]]
    if not contenders or not others:
        return
    rows, short = [], short_names(names)
    for other in others:
        ratios = summary.against[other]
        cells = ["" if name == other else percent(ratios[name][HEADLINE]["whole"]["ratio"]) for name in contenders]
        rows.append((f"against {short[other]}", *cells))
    table("Pose error relative to classical controllers", ("", *(short[name] for name in contenders)), rows)


def _overview(summary: Summary, names: Sequence[str]) -> None:
    first, short = summary.baseline, short_names(names)
    rows = []
    for name in names:
        pose = summary.controllers[name]["metrics"][HEADLINE]["whole"]
        tails = (f"{METRICS[HEADLINE].scale * pose[tail]:.0f}" for tail in ("p999", "worst"))
        row = [short[name], *_with_p95(summary, name, HEADLINE), *tails]
        if name != first:
            ratios = summary.against[first][name]
            against = ratios[HEADLINE]["whole"]
            row += [
                percent(against["ratio"]),
                f"{against['probability_of_improvement'].value:.2f}",
                text(against["p95_ratio"], 1.0, 2),
                *(text(ratios[metric]["whole"]["ratio"], 1.0, 2) for metric in ("power", "variation")),
            ]
        else:
            row += ["", "", "1", "1", "1"]
        rows.append(row)
    header = ["controller", METRICS[HEADLINE].label, "p95, mm", "p99.9", "worst"]
    header += [f"against {short[first]}", "P(better)"]
    header += [f"{cost} / {short[first]}" for cost in ("p95", "power", "variation")]
    bounds = [name for name in names if is_bound(name)]
    if bounds:
        header.append("of the gap")
        for name, row in zip(names, rows, strict=True):
            share = closed_share(summary, name)
            row.append("" if share is None else f"{100.0 * share:.0f} %")
    table("Pose error and its costs", header, rows)
    if bounds:
        line(f"of the gap: share of the gap from {short[first]} to the bound, a late one if there is one;")
        line(f"bounds: {', '.join(f'{name} (shown the true, {true_state(name)} state)' for name in bounds)}")


def _mean(summary: Summary, name: str, metric: str, part: str = "whole") -> str:
    """Interquartile mean with its interval; of shares the mean alone."""
    estimates = summary.controllers[name]["metrics"][metric][part]
    scale = METRICS[metric].scale
    return text(estimates["iqm"], scale) if "iqm" in estimates else _brief(estimates["mean"], scale)


def _with_p95(summary: Summary, name: str, metric: str) -> tuple[str, str]:
    p95 = summary.controllers[name]["metrics"][metric]["whole"]["p95"]
    return _mean(summary, name, metric), _brief(p95, METRICS[metric].scale)


def print_across(group: str, results: Results) -> None:
    """Print the errors of a group under all conditions, and the winners with their margins."""
    names = controllers_of(results)
    console.rule(f"{group}: all conditions", style="dim")
    rows = []
    for comparison, summary in results:
        row = [comparison.condition.label]
        for name in names:
            if name in summary.controllers:
                value = METRICS[HEADLINE].scale * _headline(summary, name).value
                row.append(f"{value:.{0 if value >= 100 else 1}f}" + ("*" if name == summary.winner else ""))
            else:
                row.append(comparison.missing.get(name, "-"))
        rows.append(row)
    table(
        f"Pose error, {METRICS[HEADLINE].unit}, interquartile mean (* minimum)",
        ("", *short_names(names).values()),
        rows,
    )
    header = ("", "condition", "minimum", "second", "margin", "best learned against best classical")
    table("Winners and margins", header, [_verdict(*result) for result in results], text_columns=4)
    print_files(names)


def _verdict(comparison: Comparison, summary: Summary) -> list[str]:
    (learned, classical), short = best(summary), short_names(summary.controllers)
    condition = comparison.condition
    margin = percent(summary.margin) if summary.margin is not None else ""
    duel = ""
    if learned is not None and classical is not None:
        ratio = summary.against[classical][learned][HEADLINE]["whole"]["ratio"]
        duel = f"{short[learned]} {percent(ratio)} {short[classical]}"
    description = DEPARTURES[condition.departure].summary
    return [condition.label, description, short[summary.winner], short.get(summary.runner_up or "", ""), margin, duel]


def best(summary: Summary) -> tuple[str | None, str | None]:
    """Learned and classical controller with the minimum error, or None."""
    rivals = [name for name in summary.controllers if not is_bound(name)]
    names = sorted(rivals, key=lambda name: _headline(summary, name).value)
    learned = next((name for name in names if is_learned(name)), None)
    return learned, next((name for name in names if name in summary.against), None)


def _headline(summary: Summary, name: str) -> Estimate:
    estimate: Estimate = summary.controllers[name]["metrics"][HEADLINE]["whole"]["iqm"]
    return estimate


def text(estimate: Any, scale: float = 1.0, digits: int | None = None) -> str:
    """Write a value with its interval, by default to two digits of the interval's width."""
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
    """Write a ratio as its difference from 1 in percent."""
    value, low, high = (100.0 * (number - 1.0) for number in ratio)
    digits = 0 if not math.isfinite(high - low) or high - low >= 1.0 else 1
    if not math.isfinite(high - low):
        return f"{value:+.0f} %" if math.isfinite(value) else "-"
    return f"{value:+.{digits}f} % [{low:+.{digits}f}, {high:+.{digits}f}]"
