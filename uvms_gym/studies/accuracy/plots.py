"""Figures of the accuracy study: error against cost, and drift against step."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from uvms_gym.studies.accuracy.conservation import QUANTITIES
from uvms_gym.studies.accuracy.work_precision import DIVERGED, FLOOR, by_method
from uvms_gym.studies.plotting import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILION,
    legend_below,
    log_ticks,
    picture,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Line(NamedTuple):
    """Line of an integrator in a precision: rows of the study, label, and settings of matplotlib."""

    integrator: str
    precision: str
    rows: list[Any]
    label: str
    settings: dict[str, Any]


#: Colour, marker and label of integrators in figures; tables have them all. Methods with coincident lines are left out.
STYLES = {
    "mk4": (BLUE, "o", "MK4"),
    "mk54": (GREEN, "D", "MK5(4) by tolerance"),
    "ros2": (ORANGE, "s", "linearly implicit"),
    "mk2": (PURPLE, "^", "MK2"),
    "semi-implicit-euler": (VERMILION, "v", "semi-implicit Euler"),
    "lagged-added-mass": (BLACK, "x", "added mass lagged"),
}


def plot_work_precision(path: Path, results: Mapping[str, Any], seconds: float) -> None:
    """Median error at the end effector over CPU time: the first scene large, the others small."""
    first, *others = results
    columns = (len(others) + 1) // 2
    with picture(path, 7.6 + 2.7 * columns, 6.2, dpi=105) as figure:
        grid = figure.add_gridspec(2, 1 + columns, width_ratios=(2.75, *[1.0] * columns))
        large = figure.add_subplot(grid[:, 0])
        _draw(large, results[first], large=True)
        _compare(large, results[first])
        title = f"{first}: error after {seconds:g} s of driven motion against cost"
        large.set_title(title, fontweight="bold")
        large.set(
            xlabel="CPU time per simulated second and instance (µs, one thread)",
            ylabel="median error at the end effector (m)",
        )
        for k, name in enumerate(others):
            small = figure.add_subplot(grid[k % 2, 1 + k // 2])
            _draw(small, results[name], large=False)
            small.set_title(name)
            small.tick_params(labelsize=8.0)


def plot_drift(path: Path, results: Mapping[str, Any], seconds: float) -> None:
    """Maximum drift of energy and impulse over the step without dissipation, one row per scene."""
    titles = {"energy": "kinetic energy", "linear": "linear impulse", "angular": "angular impulse"}
    with picture(path, 11.0, 2.9 * len(results) + 0.6) as figure:
        rows = figure.subplots(len(results), len(QUANTITIES), squeeze=False, sharex=True)
        for panels, (name, result) in zip(rows, results.items(), strict=True):
            for axes, quantity in zip(panels, QUANTITIES, strict=True):
                _draw_drift(axes, result["drift"], quantity)
                axes.set_title(f"{name}: {titles[quantity]}", fontsize=9.5)
            panels[0].set_ylabel(f"relative drift in {seconds:g} s")
        for axes in rows[-1]:
            axes.set_xlabel("step (s)")
        legend_below(figure, 7)


def _draw(axes: "Axes", result: Mapping[str, Any], large: bool) -> None:
    """Draw lines of error over cost; diverged runs are crosses on the upper edge."""
    axes.set(xscale="log", yscale="log")
    ends: list[tuple[float, float, str, str]] = []
    diverged: list[tuple[float, str]] = []
    for line in _lines(result["rows"]):
        valid = [row for row in line.rows if row["end_effector"]["median"] < DIVERGED]
        timed = [row["cost"] * row["step"] for row in line.rows if np.isfinite(row["cost"])]
        if line.precision == "f64" and timed:
            # Runs that are not finite are not timed: their steps cost the same as the others.
            per_step = float(np.median(timed))
            lost = [row for row in line.rows if row not in valid]
            diverged += [(1e-3 * per_step / row["step"], line.settings["color"]) for row in lost]
        valid = [row for row in valid if np.isfinite(row["cost"])]
        if not valid:
            continue
        costs = [1e-3 * row["cost"] for row in valid]
        errors = [row["end_effector"]["median"] for row in valid]
        main = line.label == "MK4"
        weight: Any = {"linewidth": 2.4 if main else 1.4, "zorder": 3 if line.integrator == "mk4" else 2}
        axes.plot(costs, errors, markersize=5.5 if large else 3.5, **weight, **line.settings)
        last = int(np.argmax(costs))
        ends.append((costs[last], errors[last], line.label, line.settings["color"]))
        if large and main:
            _annotate_steps(axes, valid)
    floor = FLOOR * result["reference"]["uncertainty"]["end_effector"]["median"]
    low, high = axes.get_ylim()
    low = min(low, 0.3 * floor)
    axes.set_ylim(low, max(high, 1.0))
    axes.axhspan(low, floor, color="#eeeeee", zorder=0, linewidth=0.0)
    if diverged:
        left, right = axes.get_xlim()
        places, colours = zip(*diverged, strict=True)
        axes.set_xlim(min(left, 0.8 * min(places)), right)
        crosses: Any = {"marker": "x", "s": 28.0 if large else 12.0, "c": colours, "linewidths": 1.4}
        axes.scatter(places, [0.97] * len(places), transform=axes.get_xaxis_transform(), **crosses)
    if large:
        left, right = axes.get_xlim()
        # Room for the names at the right.
        axes.set_xlim(left, right * (right / left) ** 0.25)
        _label(axes, ends)
        grey: Any = {"color": GREY, "fontsize": 9.0}
        axes.text(0.01, floor, "uncertainty of the reference", transform=axes.get_yaxis_transform(), va="top", **grey)
        if diverged:
            axes.text(0.995, 0.97, "x: diverged", transform=axes.transAxes, ha="right", va="center", **grey)
    log_ticks(axes.xaxis)


def _lines(rows: Sequence[Mapping[str, Any]]) -> Iterator[Line]:
    """All lines in `STYLES`. Of MK4 single precision is drawn, too: its floor is the same with every method."""
    methods = by_method(rows)
    for name, (colour, marker, label) in STYLES.items():
        for precision in ("f64", "f32") if name == "mk4" else ("f64",):
            single = precision == "f32"
            settings = {"marker": marker, "color": colour}
            settings |= {"linestyle": "--" if single else "-", "markerfacecolor": "white" if single else colour}
            rows_of = methods.get((name, precision), [])
            yield Line(name, precision, rows_of, label + (" f32" if single else ""), settings)


def _annotate_steps(axes: "Axes", rows: Sequence[Mapping[str, Any]]) -> None:
    coarsest = max(row["step"] for row in rows)
    for row in rows:
        place = (1e-3 * row["cost"], row["end_effector"]["median"])
        # On the side without other lines.
        aside: Any = {"xytext": (-6.0, -4.0), "ha": "right", "va": "top"}
        if row["step"] == coarsest:
            aside = {"xytext": (8.0, 0.0), "ha": "left", "va": "center"}
        text = f"{1e3 * row['step']:g} ms"
        axes.annotate(text, place, textcoords="offset points", color=BLUE, fontsize=8.5, **aside)


def _label(axes: "Axes", ends: Sequence[tuple[float, float, str, str]]) -> None:
    """Write names beside the ends of lines, without overlaps."""
    low, high = np.log10(axes.get_ylim())
    gap = 0.042 * (high - low)
    at = -np.inf
    for cost, error, label, colour in sorted(ends, key=lambda end: end[1]):
        at = max(np.log10(error), at + gap)
        beside: Any = {"xytext": (8.0, 0.0), "textcoords": "offset points", "va": "center"}
        weight = "bold" if label == "MK4" else "normal"
        axes.annotate(label, (cost, 10.0**at), color=colour, fontsize=9.5, fontweight=weight, **beside)


def _compare(axes: "Axes", result: Mapping[str, Any]) -> None:
    """Draw the span between MK4 and the baseline method at equal cost."""
    if comparison := result["comparison"]:
        cost = 1e-3 * comparison["cost"]
        low, high = comparison["error"], comparison["baseline_error"]
        ratio = float(f"{comparison['ratio']:.1g}")
        arrow = {"arrowstyle": "<->", "color": GREY, "linewidth": 1.2, "shrinkA": 5.0, "shrinkB": 2.0}
        axes.annotate("", (cost, low), (cost, high), arrowprops=arrow, zorder=1)
        axes.annotate(
            f"equal cost:\n{ratio:,.0f} times\nless error",
            (cost, high),
            xytext=(6.0, -22.0),
            textcoords="offset points",
            va="top",
            color="#444444",
            fontsize=9.0,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.8},
        )


def _draw_drift(axes: "Axes", rows: Sequence[Mapping[str, Any]], quantity: str) -> None:
    for line in _lines(rows):
        mine = [row for row in line.rows if row["tolerance"] is None and quantity in row]
        if mine:
            medians = np.array([row[quantity]["median"] for row in mine])
            medians[~np.isfinite(medians)] = np.nan
            axes.loglog([row["step"] for row in mine], medians, markersize=4.0, label=line.label, **line.settings)


def plot_certificates(path: Path, results: Mapping[str, Any], limits: Mapping[str, float]) -> None:
    """Errors at 95 % of the episodes over the step, in shares of their limits, one row per certificate."""
    panels = {
        "state (mm or mrad)": ("position", "attitude", "joints", "end_effector"),
        "observation (0.1 noise)": ("observation",),
        "reward (0.001 spread)": ("reward",),
    }
    colours = (BLUE, ORANGE, GREEN)
    with picture(path, 9.6, 2.5 * len(results) + 0.5) as figure:
        grid = figure.subplots(len(results), 3, squeeze=False)
        for axes_row, (name, result) in zip(grid, results.items(), strict=True):
            methods = by_method(result["rows"], "dtype")
            integrators = list(dict.fromkeys(integrator for integrator, _ in methods))
            for axes, (title, quantities) in zip(axes_row, panels.items(), strict=True):
                for (integrator, dtype), rows in methods.items():
                    shares = np.array([max(row["judged"][part] / limits[part] for part in quantities) for row in rows])
                    shown = np.where(np.isfinite(shares) & (shares > 0.0), shares, np.nan)
                    style: Any = {"color": colours[integrators.index(integrator) % len(colours)], "markersize": 3.5}
                    line, label = "o-" if dtype == "float64" else "s:", f"{integrator} {dtype}"
                    axes.plot([row["step"] for row in rows], shown, line, label=label, **style)
                axes.axhline(1.0, color=BLACK, linewidth=1.0)
                axes.axvline(result["default"].step, color=GREY, linewidth=1.0, linestyle="--")
                axes.set(xscale="log", yscale="log", xlabel="step (s)")
                axes.set_title(title, fontsize=9.5)
            axes_row[0].set_ylabel(f"{name.replace(', ', chr(10))}\nerror over limit", fontsize=8.5)
        legend_below(figure, 4)
