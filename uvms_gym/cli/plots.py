"""Pictures of what the commands find. Agg only: no window, no global state of pyplot."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uvms_gym.cli.common import fail

# Okabe and Ito's colours: told apart by everyone.
BLACK, ORANGE, BLUE, GREEN, VERMILION, PURPLE = "#000000", "#e69f00", "#0072b2", "#009e73", "#d55e00", "#cc79a7"
COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, BLACK)
STYLE: Any = {
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.6,
    "figure.constrained_layout.use": True,
}


def figure_2(path: Path, data: Mapping[str, Any]) -> None:
    """Yaw at the end of the run, and the greatest difference from the reference so far."""
    time, reference = data["time"], data["reference"]
    last = time >= time[-1] - 15.0
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.0, 7.6))
        top, bottom = figure.subplots(2, 1)
        top.plot(time[last], _cut(reference[last]), color=BLACK, linewidth=4.0, alpha=0.25, label="reference")
        for (name, difference), colour in zip(data["difference"].items(), COLOURS, strict=False):
            yaw = np.mod(reference + difference, 2.0 * np.pi)
            top.plot(time[last], _cut(yaw[last]), color=colour, linewidth=1.2, label=name)
            greatest = np.maximum.accumulate(np.abs(difference))
            bottom.semilogy(time[1:], np.maximum(greatest[1:], 1e-16), color=colour)
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
        bottom.set(
            title="Greatest difference from the reference so far",
            xlabel="time (s)",
            ylabel="|yaw - reference| (rad)",
            ylim=(1e-16, 30.0),
        )
        figure.legend(loc="outside lower center", ncols=3)
        save(figure, path)


def gamma_sweep(path: Path, data: Mapping[str, Any], printed: float, truth: float) -> None:
    """Yaw at 499.9 s by the gain of eq. 14, for either update."""
    titles = {"quaternion-rk4": "eq. 14 by RK4", "quaternion-euler": "eq. 14 by Euler"}
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 3.8))
        for axes, (integrator, sweep) in zip(figure.subplots(1, 2), data.items(), strict=True):
            gamma = [row["gamma"] for row in sweep["rows"]]
            yaw = [row["yaw_499_9"] for row in sweep["rows"]]
            axes.axhline(
                printed, color=VERMILION, linestyle="--", linewidth=1.0, label=f"printed for Fossen: {printed}"
            )
            axes.axhline(truth, color=BLACK, linestyle=":", linewidth=1.2, label=f"reference: {truth:.5f}")
            axes.plot(gamma, yaw, "o-", color=BLUE, markersize=4.0)
            axes.set(
                title=titles[integrator],
                xlabel="gain gamma of eq. 14 (1/s)",
                ylabel="yaw at 499.9 s (rad)",
                ylim=(3.5, 3.8),
            )
            if integrator == "quaternion-rk4":
                axes.axvline(27.85, color="#888888", linewidth=1.0, label="limit of stability, h gamma = 2.785")
            axes.legend(loc="upper left" if integrator == "quaternion-rk4" else "center right")
        save(figure, path)


def tumbling(path: Path, data: Mapping[str, Any]) -> None:
    """Attitude error by step size and method, when no axis is special."""
    steps = np.array(data["steps"])
    markers = ("o", "s", "x", "^", "D")
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.6))
        axes = figure.subplots()
        for (name, errors), colour, marker in zip(data["errors"].items(), COLOURS, markers, strict=False):
            axes.loglog(steps, errors, marker=marker, color=colour, label=f"{name} (order {data['orders'][name]:.2f})")
        axes.loglog(
            steps,
            data["errors"]["MK4"][-1] / 3.0 * (steps / steps[-1]) ** 4,
            color="#888888",
            linestyle=":",
            label="h⁴",
        )
        title = f"Tumbling about three axes: attitude error after {data['time']:g} s"
        axes.set(title=title, xlabel="step h (s)", ylabel="angle from the reference (rad)")
        _step_ticks(axes, steps)
        axes.legend()
        save(figure, path)


def momentum(path: Path, data: Mapping[str, Any], bar: float) -> None:
    """Drift over time at each step, and the greatest by step."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 6.8))
        rows = figure.subplots(2, 2, width_ratios=(3, 2))
        for (over_time, by_step), (name, study) in zip(rows, data.items(), strict=True):
            for run, colour in zip(study["runs"], COLOURS, strict=False):
                over_time.semilogy(
                    run["time"][1:],
                    np.maximum(run["drift"][1:, 1], 1e-17),
                    color=colour,
                    label=f"h = {run['step']:g} s",
                )
            over_time.set(title=f"Angular momentum, {name}", xlabel="time (s)", ylabel="relative drift")
            over_time.legend(loc="lower right", ncols=2)
            steps = np.array([run["step"] for run in study["runs"]])
            for kind, marker, colour in (("linear", "s", GREEN), ("angular", "o", BLUE)):
                label = f"{kind} (order {study['orders'][kind]:.2f})"
                by_step.loglog(steps, [run[kind] for run in study["runs"]], marker=marker, color=colour, label=label)
            by_step.axhline(
                bar, color=VERMILION, linestyle="--", linewidth=1.0, label=f"{bar:.0e}, the most at h = 0.01 s"
            )
            by_step.set(title="Greatest drift in 100 s", xlabel="step h (s)", ylabel="relative drift")
            _step_ticks(by_step, steps)
            by_step.legend(loc="lower right")
        save(figure, path)


def vehicle_motion(path: Path, title: str, columns: Mapping[str, Any]) -> None:
    """Position and attitude of the vehicle over time, as the paper's figs. 5 and 6."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.0, 6.4))
        top, bottom = figure.subplots(2, 1, sharex=True)
        _three(top, columns["time"], 1e3 * columns["position"], ("x", "y", "z"))
        top.set(title=title, ylabel="position (mm)")
        _three(bottom, columns["time"], np.rad2deg(columns["rpy"]), ("roll", "pitch", "yaw"))
        bottom.set(ylabel="attitude (deg)", xlabel="time (s)")
        save(figure, path)


def end_effector(path: Path, cases: Mapping[str, Mapping[str, Any]]) -> None:
    """End effector in the world, and how far it is from where a held vehicle would have it, as the paper's fig. 7."""
    styles = {"uncontrolled": (VERMILION, "-"), "PD-controlled": (BLUE, "-"), "vehicle held": (BLACK, "--")}
    ideal = cases["vehicle held"]["end_effector"]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.0, 7.6))
        x, z, error = figure.subplots(3, 1, sharex=True)
        for case, (colour, line) in styles.items():
            columns = cases[case]
            for axes, k in ((x, 0), (z, 2)):
                axes.plot(columns["time"], columns["end_effector"][:, k], line, color=colour, label=case)
            if case != "vehicle held":
                missed = 1e3 * np.linalg.norm(columns["end_effector"] - ideal, axis=1)
                error.plot(columns["time"], missed, line, color=colour, label=case)
        x.set(title="Fig. 7: end effector, world axes (y stays 0)", ylabel="x (m)")
        z.set(ylabel="z (m)")
        error.set(ylabel="distance from ideal (mm)", xlabel="time (s)", ylim=(0.0, None))
        x.legend(loc="upper center")
        save(figure, path)


def _three(axes: Axes, time: Any, values: Any, names: Sequence[str]) -> None:
    # Curves may lie on one another: dashes let the one beneath be seen.
    for k, (name, colour, line) in enumerate(zip(names, (BLUE, ORANGE, VERMILION), ("-", "--", "-."), strict=True)):
        axes.plot(time, values[:, k], line, color=colour, label=name)
    axes.legend(loc="upper right", ncols=3)
    axes.margins(y=0.2)


def _step_ticks(axes: Axes, steps: Any) -> None:
    axes.set_xticks(steps, [f"{step:g}" for step in steps])
    axes.minorticks_off()


def _cut(angle: Any) -> Any:
    """Return an angle with its jumps from 2 pi to 0 left out."""
    return np.where(np.abs(np.diff(angle, prepend=angle[0])) > np.pi, np.nan, angle)


def save(figure: Figure, path: Path, dpi: float = 130) -> None:
    """Write a picture."""
    try:
        figure.savefig(path, dpi=dpi)
    except OSError as error:
        raise fail(f"cannot write {path}: {error.strerror}") from None


def disturbance(path: Path, title: str, profile: Mapping[str, Any]) -> None:
    """Velocity of the water, force, and what is left of the thrusters, over time."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.0, 6.4))
        water, force, rest = figure.subplots(3, 1, sharex=True)
        time = profile["time"]
        for k, (axis, colour) in enumerate(zip("xyz", (BLUE, VERMILION, GREEN), strict=True)):
            water.plot(time, profile["current"][:, k], color=colour, label=axis)
            force.plot(time, profile["wrench"][:, k], color=colour, drawstyle="steps-post")
        water.set(title=title, ylabel="water (m/s), world")
        water.legend(ncols=3, loc="upper right")
        force.set(ylabel="force (N), body")
        rest.plot(time, 100.0 * profile["gains"], color=PURPLE, linewidth=1.2)
        rest.set(ylabel="thrusters (%)", ylim=(-5.0, 105.0), xlabel="time (s)")
        mass = rest.twinx()
        mass.plot(time, profile["payload"], color=ORANGE, drawstyle="steps-post")
        mass.set_ylabel("payload (kg)", color=ORANGE)
        mass.set_ylim(bottom=0.0)
        mass.grid(visible=False)
        save(figure, path)


def disturbance_shapes(path: Path, shapes: Mapping[str, Mapping[str, Any]]) -> None:
    """One small picture of each shape: what of it changes."""
    with mpl.rc_context({**STYLE, "font.size": 8.0, "axes.titlesize": 9.0, "lines.linewidth": 1.1}):
        figure = Figure(figsize=(8.0, 5.4))
        for axes, (title, profile) in zip(figure.subplots(3, 3).flat, shapes.items(), strict=False):
            time = profile["time"]
            parts = {
                "N": profile["wrench"][:, :3],
                "kg": profile["payload"][:, np.newaxis],
                "share of thrust": profile["gains"],
                "m/s": profile["current"],
            }
            changes = {unit: lines for unit, lines in parts.items() if np.ptp(lines, axis=0).max() > 0.0}
            unit, lines = next(iter(changes.items()), ("m/s", profile["current"]))
            for line, colour in zip(lines.T, np.resize((BLUE, VERMILION, GREEN), lines.shape[1]), strict=True):
                axes.plot(time, line, color=str(colour), drawstyle="steps-post")
            axes.set(title=title, ylabel=unit)
            if axes.get_subplotspec().is_last_row():
                axes.set_xlabel("time (s)")
        save(figure, path)
