"""Bar charts of the speed study."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uvms_gym.studies.plotting import BLUE, COLOURS, GREEN, ORANGE, VERMILION, legend_above, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHORT = {"float64": "f64", "float32": "f32"}


def plot_speed(path: Path, results: Mapping[str, Any], many: int) -> None:
    """Steps per second by scene at `many` instances, and times per step beside the peers', if measured."""
    peers = results.get("peers", {}).get("scenes", {})
    with picture(path, 9.0, 3.9 + 3.3 * len(peers)) as figure:
        first, *others = figure.subplots(1 + len(peers), 1, squeeze=False)[:, 0]
        _rates(first, results["physics"], many)
        for axes, (scene, found) in zip(others, peers.items(), strict=True):
            _peers(axes, scene, found["step"])


def _rates(axes: "Axes", rows: Sequence[Mapping[str, Any]], many: int) -> None:
    substeps = max(row["substeps"] for row in rows)
    shown = [row for row in rows if (row["n"], row["substeps"], row["varied"]) == (many, substeps, False)]
    scenes = list(dict.fromkeys(row["scene"] for row in shown))
    kinds = list(dict.fromkeys((row["dtype"], row["instruction_set"], row["threads"]) for row in shown))
    width = 0.8 / len(kinds)
    for k, kind in enumerate(kinds):
        mine = {row["scene"]: row for row in shown if (row["dtype"], row["instruction_set"], row["threads"]) == kind}
        rates = [1e-6 * mine[scene]["steps_per_second"] for scene in scenes]
        ends = np.array([[1e-6 / mine[scene]["seconds"][end] for end in ("high", "low")] for scene in scenes]).T
        dtype, instruction_set, threads = kind
        places = np.arange(len(scenes)) + (k - 0.5 * (len(kinds) - 1)) * width
        label = f"{SHORT[dtype]}, {instruction_set}, {threads} thread{'s' if threads > 1 else ''}"
        spread = np.abs(ends - rates).tolist()
        colour = COLOURS[k % len(COLOURS)]
        bars = axes.bar(places, rates, 0.92 * width, yerr=spread, color=colour, ecolor="#444444", label=label)
        if len(kinds) * len(scenes) <= 24:
            axes.bar_label(bars, [f"{rate:.3g}" for rate in rates], fontsize=8.0, padding=2)
    axes.set(
        title=f"Steps per second: {many} instances, {substeps} substeps per call",
        ylabel="million steps per second",
        xticks=range(len(scenes)),
        xticklabels=scenes,
    )
    axes.set_axisbelow(True)
    axes.margins(y=0.1)
    axes.grid(axis="x", visible=False)
    legend_above(axes, columns=4)


def _peers(axes: "Axes", scene: str, step: Mapping[str, Any]) -> None:
    names = list(step["seconds"])
    times = np.array([1e9 * step["seconds"][name]["median"] for name in names])
    colours = [_colour(name) for name in names]
    bars = axes.barh(range(len(names)), times, color=colours)
    labels = []
    for name, time in zip(names, times, strict=True):
        ratios = [f"{step['ratios'][d][name]['median']:.0f}x" for d in SHORT if name in step["ratios"][d]]
        labels.append(f"{time:,.0f} ns" + (f"  ({' f64, '.join(ratios)} f32)" if ratios else ""))
    axes.bar_label(bars, labels, fontsize=8.5, padding=4)
    axes.set(
        title=f"{scene}: one step of one instance, one thread (times ours)",
        xlabel="ns",
        yticks=range(len(names)),
        yticklabels=names,
        xlim=(0.0, 1.5 * times.max()),
    )
    axes.set_axisbelow(True)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)


def _colour(name: str) -> str:
    if name.startswith("ours"):
        return BLUE
    if name.startswith("Pinocchio"):
        return GREEN
    return VERMILION if "RK4" in name else ORANGE
