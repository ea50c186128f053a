"""Figures of comparisons."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uvms_gym.controllers.families import FAMILIES, LEVELS, canonical, is_bound, is_learned, true_state
from uvms_gym.studies.comparison.conditions import DESIGN
from uvms_gym.studies.comparison.metrics import HEADLINE, METRICS
from uvms_gym.studies.comparison.study import Comparison
from uvms_gym.studies.comparison.summary import Summary, short_names
from uvms_gym.studies.plotting import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    VERMILION,
    label_points,
    legend_below,
    log_ticks,
    picture,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Comparisons with their summaries.
Results = Sequence[tuple[Comparison, Summary]]
#: Estimates by controller: of a summary, or of a file.
Controllers = Mapping[str, Any]

#: Metrics of the bar charts.
_BARS = ("pose", "position", "attitude", "end_effector", "power", "variation", "recovery", "within")
#: Colours of learned controllers, which stand out, and of classical ones.
_LEARNED: tuple[str, ...] = (VERMILION, ORANGE, PURPLE, "#7a1f00", "#e7298a", "#b8860b", "#ff9896", "#6a0d4f")
_LEARNED += ("#ffb347", "#a0522d", "#8b0000", "#ff6f61", "#c71585", "#f4a3c0", "#d8a0ff", "#e9967a", "#9b2335")
_LEARNED += ("#f08030",)
_CLASSICAL: tuple[str, ...] = (BLUE, "#56b4e9", GREEN, BLACK, "#7f7f7f", "#8c6d31", "#1f4e79", "#17becf")
_CLASSICAL += ("#a6c96a", "#5f9ea0", "#9aa7d6", "#3d5a00", "#b5b5d9", "#004b49", "#c9a66b", "#5a5a8c")
_CLASSICAL += ("#3b8ea5", "#708238", "#c0c0a0")
_NONE = "#bdbdbd"
#: Families along the frontier, with their settings in its order, and colours.
_FRONTIERS = {
    key: [canonical(key, level) for level in LEVELS if level in family.settings] for key, family in FAMILIES.items()
}
_FAMILY = {
    "dob": BLUE,
    "resolved-dob": BLUE,
    "mpc": GREEN,
    "ppo": ORANGE,
    "shac": VERMILION,
    "shac-distilled": VERMILION,
}
_LINES = ("-", "--", "-.", ":")


def colours(names: Sequence[str]) -> dict[str, str]:
    """Distinct colours of controllers, warm for learned ones."""
    learned = [name for name in names if is_learned(name)]
    classical = [name for name in names if name not in learned and name != "none"]
    found = {name: _LEARNED[k % len(_LEARNED)] for k, name in enumerate(learned)}
    found |= {name: _CLASSICAL[k % len(_CLASSICAL)] for k, name in enumerate(classical)}
    return {name: found.get(name, _NONE) for name in names}


def plot_bars(path: Path, results: Results) -> None:
    """Every metric of every controller with its interval, and 95th percentiles of the errors, by comparison."""
    from matplotlib.lines import Line2D

    count = max(len(summary.controllers) for _, summary in results)
    height = 0.24 * count + 0.75
    with picture(path, 12.5, (2 * height + 0.35) * len(results) + 0.4) as figure:
        parts = np.atleast_1d(np.array(figure.subfigures(len(results), 1), dtype=object))
        for part, (comparison, summary) in zip(parts, results, strict=True):
            episodes = next(iter(summary.controllers.values()))["episodes"]
            title = f"{comparison.condition.name}: {episodes} episodes"
            part.suptitle(title, x=0.01, ha="left", fontweight="bold", fontsize=11.0)
            for axes, metric in zip(part.subplots(2, 4, sharey=True).flat, _BARS, strict=True):
                _bars(axes, summary, metric)
        # One legend: the marks mean the same everywhere.
        handles = [
            Line2D([], [], color="#333333", linewidth=1.4, label="95 % interval of the interquartile mean"),
            Line2D([], [], color="#333333", marker="D", mfc="white", ls="", ms=4.5, label="95th percentile"),
        ]
        parts[-1].legend(handles=handles, loc="outside lower center", ncols=2)


def _bars(axes: "Axes", summary: Summary, metric: str) -> None:
    names, description = short_names(summary.controllers), METRICS[metric]
    colour = colours(list(names))
    for k, name in enumerate(names):
        estimates = summary.controllers[name]["metrics"][metric]["whole"]
        value, low, high = (description.scale * x for x in estimates.get("iqm", estimates.get("mean")))
        axes.barh(k, value, color=colour[name], height=0.68)
        reach = [[max(0.0, value - low)], [max(0.0, high - value)]]
        axes.errorbar(value, k, xerr=reach, color="#333333", capsize=3.0, lw=1.4)
        if description.error:
            tail = description.scale * estimates["p95"].value
            axes.plot(tail, k, "D", color="#333333", mfc="white", markersize=4.5)
    axes.set(title=description.label, ylim=(len(names) - 0.4, -0.6))
    axes.set_yticks(range(len(names)), list(names.values()))
    for label in axes.get_yticklabels():
        label.set_fontweight("bold" if label.get_text() == names[summary.winner] else "normal")
    axes.grid(axis="y", visible=False)
    axes.set_axisbelow(True)
    axes.set_xlim(left=0.0)
    axes.locator_params(axis="x", nbins=5)
    # Long numbers have their power of ten at the end of the axis.
    axes.ticklabel_format(axis="x", scilimits=(-2, 4), useMathText=True)
    if description.error:
        _cut(axes, summary, metric)


def _cut(axes: "Axes", summary: Summary, metric: str) -> None:
    """Limit the axis to controlled episodes, where errors without control are far greater."""
    scale = METRICS[metric].scale
    all_of = {name: entry["metrics"][metric]["whole"] for name, entry in summary.controllers.items()}
    controlled = [entry["p95"].value for name, entry in all_of.items() if name != "none"]
    if not controlled or "none" not in all_of:
        return
    end = 1.15 * scale * max(controlled)
    value = scale * all_of["none"]["iqm"].value
    if value > 1.3 * end:
        axes.set_xlim(right=end)
        place = list(all_of).index("none")
        axes.text(0.98 * end, place, f"{value:.0f} →", ha="right", va="center", fontsize=8.0, color="black")


def plot_profiles(path: Path, results: Results) -> None:
    """Share of episodes with an error up to a threshold, with 95 % bands, by comparison."""
    columns = min(3, len(results))
    rows = -(-len(results) // columns)
    names = list(dict.fromkeys(name for _, summary in results for name in summary.profiles))
    across = 2 + 2 * columns
    legend = 0.2 * -(-len(names) // across)
    with picture(path, max(8.0, 4.6 * columns), 3.5 * rows + 0.5 + legend) as figure:
        grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
        colour, short = colours(names), short_names(names)
        classical = [name for name in names if not is_learned(name)]
        for axes, (comparison, summary) in zip(grid.flat, results, strict=False):
            taus = METRICS[HEADLINE].scale * summary.thresholds
            for name, profile in summary.profiles.items():
                learned = name not in classical
                style = "-" if learned else _LINES[classical.index(name) % len(_LINES)]
                value, low, high = (100.0 * shares for shares in profile)
                weight: Any = {"lw": 2.2, "zorder": 3} if learned else {"lw": 1.3, "zorder": 2}
                axes.plot(taus, value, style, color=colour[name], label=short[name], **weight)
                axes.fill_between(taus, low, high, color=colour[name], alpha=0.22, linewidth=0.0)
            axes.set_xscale("log")
            log_ticks(axes.xaxis)
            title = comparison.condition.label if len(results) > 1 else comparison.condition.name
            axes.set(title=title, ylim=(0.0, 101.0), xlabel="RMS pose error up to, mm")
        for axes in grid.flat[len(results) :]:
            axes.set_visible(False)
        for axes in grid[:, 0]:
            axes.set_ylabel("episodes (%)")
        legend_below(figure, min(across, len(names)))


def plot_frontier(path: Path, panels: Mapping[str, Controllers]) -> None:
    """Error of every controller against the variation of its commands and against its effort, by title of comparison.

    Lines join the members of a family, whose names are left out, in the order of their costs.
    """
    small = {"font__size": 9.0, "legend__fontsize": 8.0}
    with picture(path, 8.4, 4.4 * len(panels), **small) as figure:
        parts = np.atleast_1d(np.array(figure.subfigures(len(panels), 1), dtype=object))
        labelled = []
        for part, (title, controllers) in zip(parts, panels.items(), strict=True):
            part.suptitle(title, x=0.01, ha="left", fontsize=10.0)
            grid = part.subplots(1, 2, sharey=True)
            for axes, cost in zip(grid, ("variation", "power"), strict=True):
                labelled.append((axes, _frontier(axes, controllers, cost)))
            grid[0].set_ylabel("RMS " + METRICS[HEADLINE].label)
            part.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
        for axes, points in labelled:
            label_points(axes, points, fontsize=7.5)


def stored_panels(files: Sequence[Path]) -> dict[str, Controllers]:
    """Panels of `plot_frontier` from files of comparisons, of the design, by title."""
    found = (entry for file in files for entry in json.loads(file.read_text())["results"])
    return {f"{e['env']}, {e['scene']}, {e['condition']}": e["controllers"] for e in found if e["condition"] == DESIGN}


def _frontier(axes: "Axes", controllers: Controllers, cost: str) -> list[tuple[float, float, str, str]]:
    """Draw points and lines; points that need names: place, name and colour."""
    names = [name for name in controllers if name != "none"]
    families = {label: [name for name in members if name in names] for label, members in _FRONTIERS.items()}
    families = {label: members for label, members in families.items() if len(members) > 1}
    family = {name: label for label, members in families.items() for name in members}
    short = short_names(names)

    def estimate(name: str, metric: str) -> list[float]:
        iqm = controllers[name]["metrics"][metric]["whole"]["iqm"]
        numbers = [iqm[end] for end in ("value", "low", "high")] if isinstance(iqm, dict) else iqm
        return [METRICS[metric].scale * x for x in numbers]

    points: list[tuple[float, float, str, str]] = []
    bounds = [name for name in names if is_bound(name)]
    for name in (name for name in names if name not in bounds):
        (x, *_), (y, low, high) = estimate(name, cost), estimate(name, HEADLINE)
        colour = _FAMILY.get(family.get(name, ""), VERMILION if is_learned(name) else BLUE)
        axes.errorbar(
            x, y, yerr=[[max(0.0, y - low)], [max(0.0, high - y)]], fmt="o", ms=4.5, color=colour, capsize=2.5
        )
        if name not in family:
            points.append((x, y, short[name], colour))
    for label, members in families.items():
        course = sorted((estimate(name, cost)[0], estimate(name, HEADLINE)[0]) for name in members)
        axes.plot(*np.transpose(course), color=_FAMILY[label], lw=1.2, label=label)
    for name in bounds:
        style, label = ("--" if true_state(name) == "late" else ":"), f"{name}: true, {true_state(name)} state"
        axes.axhline(estimate(name, HEADLINE)[0], ls=style, color=BLACK, lw=1.2, label=label)
    axes.set(xscale="log", xlabel=METRICS[cost].label, ylim=(0.0, None))
    axes.margins(x=0.12)
    log_ticks(axes.xaxis)
    return points


def plot_departures(path: Path, groups: Mapping[str, Results]) -> None:
    """Errors by condition and controller, coloured by the ratio to the baseline's; one panel per group."""
    sizes = [len(results) for results in groups.values()]
    widest = max(len(controllers_of(results)) for results in groups.values())
    size = (1.9 + 0.95 * widest, sum(0.42 * size + 1.1 for size in sizes) + 0.8)
    with picture(path, *size, axes__grid=False) as figure:
        grid = figure.subplots(len(groups), 1, squeeze=False, height_ratios=sizes)[:, 0]
        image: Any = None
        for axes, (group, results) in zip(grid, groups.items(), strict=True):
            image = _heat(axes, results)
            axes.set_title(f"{group}: pose error, mm (boxed: minimum)", pad=26.0)
        bar = figure.colorbar(image, ax=list(grid), location="bottom", shrink=0.5, aspect=40, pad=0.03)
        bar.set_ticks([-2.0, -1.0, 0.0, 1.0, 2.0], labels=["1/4", "1/2", "1", "2", "4"])
        bar.set_label(f"ratio to {results[0][1].baseline}")


def controllers_of(results: Results) -> list[str]:
    """Names of all controllers of a group, missing ones last."""
    names = dict.fromkeys(name for _, summary in results for name in summary.controllers)
    return list(names | dict.fromkeys(name for comparison, _ in results for name in comparison.missing))


def _heat(axes: "Axes", results: Results) -> Any:
    from matplotlib.patches import Rectangle

    names = controllers_of(results)
    ratios = np.full((len(results), len(names)), np.nan)
    for row, (comparison, summary) in enumerate(results):
        values = {name: entry["metrics"][HEADLINE]["whole"]["iqm"].value for name, entry in summary.controllers.items()}
        for column, name in enumerate(names):
            if name in values:
                ratios[row, column] = np.log2(values[name] / values[summary.baseline])
                value = METRICS[HEADLINE].scale * values[name]
                words = f"{value:.{0 if value >= 100.0 else 1}f}"
            else:
                words = comparison.missing.get(name, "-")
            dark = abs(ratios[row, column]) > 1.2
            style: Any = {"color": "white" if dark else "black" if name in values else "#888888", "ha": "center"}
            style |= {"fontsize": 9.0 if name in values else 7.5, "va": "center"}
            axes.text(column, row, words, fontweight="bold" if name == summary.winner else "normal", **style)
            if name == summary.winner:
                corner = (column - 0.47, row - 0.45)
                axes.add_patch(Rectangle(corner, 0.94, 0.9, fill=False, edgecolor="black", linewidth=1.8))
    image = axes.imshow(np.clip(ratios, -2.0, 2.0), cmap="RdBu_r", vmin=-2.0, vmax=2.0, aspect="auto")
    axes.set_xticks(range(len(names)), list(short_names(names).values()), rotation=0)
    axes.set_yticks(range(len(results)), [comparison.condition.label for comparison, _ in results])
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    return image
