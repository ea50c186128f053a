"""Figures of the paper's results."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uvms_gym.studies.paper import free_body
from uvms_gym.studies.paper.momentum import BAR
from uvms_gym.studies.plotting import BLACK, BLUE, COLOURS, GREEN, ORANGE, VERMILION, legend_above, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_figure_2(path: Path, data: Mapping[str, Any]) -> None:
    """Yaw over the last 15 s, and the maximum difference from the reference so far."""
    time, reference = data["time"], data["reference"]
    last = time >= time[-1] - 15.0
    with picture(path, 8.0, 7.6) as figure:
        top, bottom = figure.subplots(2, 1)
        top.plot(time[last], _cut(reference[last]), color=BLACK, linewidth=4.0, alpha=0.25, label="reference")
        for (name, difference), colour in zip(data["difference"].items(), COLOURS, strict=False):
            yaw = np.mod(reference + difference, 2.0 * np.pi)
            top.plot(time[last], _cut(yaw[last]), color=colour, linewidth=1.2, label=name)
            maximum = np.maximum.accumulate(np.abs(difference))
            bottom.semilogy(time[1:], np.maximum(maximum[1:], 1e-16), color=colour)
        top.axvline(499.9, color="#888888", linestyle=":", linewidth=1.0)
        top.text(499.8, 0.1, "499.9 s", ha="right", color="#666666", fontsize=9.0)
        top.set(
            title="Fig. 2: yaw of a free body at 1 rad/s, h = 0.1 s (last 15 s)",
            xlabel="time (s)",
            ylabel="yaw (rad), modulo 2π",
            ylim=(-0.2, 2.0 * np.pi + 0.2),
            yticks=[0.0, np.pi, 2.0 * np.pi],
            yticklabels=["0", "π", "2π"],
        )
        title, label = "Maximum difference from the reference so far", "|yaw - reference| (rad)"
        bottom.set(title=title, xlabel="time (s)", ylabel=label, ylim=(1e-16, 30.0))
        figure.legend(loc="outside lower center", ncols=3)


def plot_gamma_sweep(path: Path, data: Mapping[str, Any]) -> None:
    """Yaw at 499.9 s over the gain of eq. 14, for both updates."""
    titles = {"quaternion-rk4": "eq. 14 by RK4", "quaternion-euler": "eq. 14 by Euler"}
    printed, exact = free_body.PRINTED["Fossen"], float(free_body.exact_yaw(free_body.STEPS - 1))
    with picture(path, 9.0, 3.8) as figure:
        for axes, (integrator, sweep) in zip(figure.subplots(1, 2), data.items(), strict=True):
            gamma = [row["gamma"] for row in sweep["rows"]]
            yaw = [row["yaw_499_9"] for row in sweep["rows"]]
            label = f"printed for Fossen: {printed}"
            axes.axhline(printed, color=VERMILION, linestyle="--", linewidth=1.0, label=label)
            axes.axhline(exact, color=BLACK, linestyle=":", linewidth=1.2, label=f"reference: {exact:.5f}")
            axes.plot(gamma, yaw, "o-", color=BLUE, markersize=4.0)
            label = "yaw at 499.9 s (rad)"
            axes.set(title=titles[integrator], xlabel="gain gamma of eq. 14 (1/s)", ylabel=label, ylim=(3.5, 3.8))
            if integrator == "quaternion-rk4":
                axes.axvline(27.85, color="#888888", linewidth=1.0, label="limit of stability, h gamma = 2.785")
            legend_above(axes, columns=1)


def plot_tumbling(path: Path, data: Mapping[str, Any]) -> None:
    """Attitude error over the step of each method, for a tumble about all three axes."""
    steps = np.array(data["steps"])
    markers = ("o", "s", "x", "^", "D")
    with picture(path, 6.4, 4.6) as figure:
        axes = figure.subplots()
        for (name, errors), colour, marker in zip(data["errors"].items(), COLOURS, markers, strict=False):
            axes.loglog(steps, errors, marker=marker, color=colour, label=f"{name} (order {data['orders'][name]:.2f})")
        fourth_order = data["errors"]["MK4"][-1] / 3.0 * (steps / steps[-1]) ** 4
        axes.loglog(steps, fourth_order, color="#888888", linestyle=":", label="h⁴")
        title = f"Tumbling about three axes: attitude error after {data['time']:g} s"
        axes.set(title=title, xlabel="step h (s)", ylabel="angle from the reference (rad)")
        _step_ticks(axes, steps)
        legend_above(axes, columns=3)


def plot_momentum(path: Path, data: Mapping[str, Any]) -> None:
    """Drift of momentum over time at each step, and the maximum drift over the step."""
    with picture(path, 10.0, 6.8) as figure:
        rows = figure.subplots(2, 2, width_ratios=(3, 2))
        for (over_time, by_step), (name, study) in zip(rows, data.items(), strict=True):
            for run, colour in zip(study["runs"], COLOURS, strict=False):
                drift = np.maximum(run["drift"][1:, 1], 1e-17)
                over_time.semilogy(run["time"][1:], drift, color=colour, label=f"h = {run['step']:g} s")
            over_time.set(title=f"Angular momentum, {name}", xlabel="time (s)", ylabel="relative drift")
            legend_above(over_time, columns=4)
            steps = np.array([run["step"] for run in study["runs"]])
            for kind, marker, colour in (("linear", "s", GREEN), ("angular", "o", BLUE)):
                label = f"{kind} (order {study['orders'][kind]:.2f})"
                by_step.loglog(steps, [run[kind] for run in study["runs"]], marker=marker, color=colour, label=label)
            label = f"{BAR:.0e}, the most at h = 0.01 s"
            by_step.axhline(BAR, color=VERMILION, linestyle="--", linewidth=1.0, label=label)
            by_step.set(title="Maximum drift in 100 s", xlabel="step h (s)", ylabel="relative drift")
            _step_ticks(by_step, steps)
            legend_above(by_step, columns=1)


def plot_vehicle_motion(path: Path, title: str, columns: Mapping[str, Any]) -> None:
    """Position and attitude of the vehicle over time, as in figs. 5 and 6."""
    with picture(path, 8.0, 6.4) as figure:
        top, bottom = figure.subplots(2, 1, sharex=True)
        _three(top, columns["time"], 1e3 * columns["position"], ("x", "y", "z"))
        top.set(title=title, ylabel="position (mm)")
        _three(bottom, columns["time"], np.rad2deg(columns["rpy"]), ("roll", "pitch", "yaw"))
        bottom.set(ylabel="attitude (deg)", xlabel="time (s)")


def plot_end_effector(path: Path, cases: Mapping[str, Mapping[str, Any]]) -> None:
    """End effector in the world, and its distance from the end effector of a fixed vehicle, as in fig. 7."""
    styles = {"uncontrolled": (VERMILION, "-"), "PD-controlled": (BLUE, "-"), "vehicle held": (BLACK, "--")}
    ideal = cases["vehicle held"]["end_effector"]
    with picture(path, 8.0, 7.6) as figure:
        x, z, error = figure.subplots(3, 1, sharex=True)
        for case, (colour, line) in styles.items():
            columns = cases[case]
            for axes, k in ((x, 0), (z, 2)):
                axes.plot(columns["time"], columns["end_effector"][:, k], line, color=colour, label=case)
            if case != "vehicle held":
                distance = 1e3 * np.linalg.norm(columns["end_effector"] - ideal, axis=1)
                error.plot(columns["time"], distance, line, color=colour, label=case)
        x.set(title="Fig. 7: end effector, world axes (y stays 0)", ylabel="x (m)")
        z.set(ylabel="z (m)")
        error.set(ylabel="distance from ideal (mm)", xlabel="time (s)", ylim=(0.0, None))
        legend_above(x)


def _three(axes: "Axes", time: Any, values: Any, names: Sequence[str]) -> None:
    # Curves may coincide: dashes leave the lower one visible.
    for k, (name, colour, line) in enumerate(zip(names, (BLUE, ORANGE, VERMILION), ("-", "--", "-."), strict=True)):
        axes.plot(time, values[:, k], line, color=colour, label=name)
    legend_above(axes)


def _step_ticks(axes: "Axes", steps: Any) -> None:
    axes.set_xticks(steps, [f"{step:g}" for step in steps])
    axes.minorticks_off()


def _cut(angle: Any) -> Any:
    """Angle with NaN at its jumps from 2 pi to 0."""
    return np.where(np.abs(np.diff(angle, prepend=angle[0])) > np.pi, np.nan, angle)
