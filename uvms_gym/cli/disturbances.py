"""`uvms disturbances`: levels of disturbances, and pictures of them over time."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from typer import Argument, Option

import uvms_gym
from uvms_gym.cli.common import check_known, prepare, read_scene, user_errors
from uvms_gym.cli.options import Out, ranged
from uvms_gym.cli.output import name_files, say, table
from uvms_gym.studies.plotting import BLUE, GREEN, ORANGE, PURPLE, VERMILION, legend_above, picture

Profile = dict[str, NDArray[np.float64]]

#: Picture of each component: title, and components with numbers that show the shape.
SHAPES: dict[str, tuple[str, dict[str, Any]]] = {
    "current": ("steady current", {"current": {"speed": 0.3}}),
    "drift": ("drift: Gauss-Markov current", {"drift": {"deviation": 0.08, "time": 5.0}}),
    "gust": ("gust", {"gust": {"speed": 0.3, "duration": 4.0, "pause": 3.0}}),
    "waves": ("waves", {"waves": {"height": 0.5, "period": 5.0, "depth": 3.0}}),
    "impulse": ("impulse", {"impulse": {"share": 0.8, "pause": 4.0, "duration": 0.4}}),
    "tether": ("tether, in gusts", {"tether": {"slack": 0.02}, "gust": {"speed": 0.3, "duration": 4.0, "pause": 3.0}}),
    "payload": ("payload", {"payload": {"share": 0.08}}),
    "thrusters": ("thrusters that weaken", {"thrusters": {"count": 2, "gain": [0.2, 0.6], "time": 6.0, "fade": 3.0}}),
    "script": ("script", {"script": {"current": [[0.2 * np.sign(np.sin(k / 25)), 0, 0] for k in range(400)]}}),
}
#: Longest time of a picture, s.
LONGEST = 3600.0


def disturbances(
    name: Annotated[
        str | None, Argument(metavar="NAME", help="Level. [default: all, and the shape of each component]")
    ] = None,
    scene: Annotated[str, Option(metavar="SCENE", help="Scene: name or TOML file.")] = "petasus-pum",
    seed: Annotated[int, ranged("Seed of the episode.", 0, 2**64 - 1)] = 0,
    seconds: Annotated[float, ranged(f"Duration of the pictures, 1 to {LONGEST:g} s.", 1.0, LONGEST)] = 20.0,
    out: Out = Path("out/disturbances"),
) -> None:
    """List the levels of disturbances, and draw them over an episode.

    Pictures show the water's velocity, the force and the remaining gain of the thrusters, with the vehicle at its
    target.
    """
    levels = uvms_gym.disturbance_levels()
    check_known("level", [name] if name else [], levels)
    description = read_scene(scene)
    chosen = [name] if name is not None else list(levels)
    files = [f"{level}.png" for level in chosen] + ([] if name is not None else ["shapes.png"])
    prepare(out, None, files)
    rows = [(level, ", ".join(levels[level].components) or "-", levels[level].description) for level in chosen]
    table("Levels", ("name", "components", "description"), rows, text_columns=3)
    with user_errors(verb="write"):
        for level in chosen:
            title = f"{level}: {description['name']}, seed {seed}"
            _plot(out / f"{level}.png", title, disturbance_profile(description, level, seed, seconds))
        if name is None:
            shapes = {t: disturbance_profile(description, made, seed, seconds) for t, made in SHAPES.values()}
            _plot_shapes(out / "shapes.png", shapes)
    if name is None:
        say(
            "Levels with -hard are for evaluation: stronger, with shapes that the others lack. Noise, outliers, "
            "dropout, delay, the arm's motion and parameters have no shape over time; "
            "`pydoc uvms_gym.envs.station_keep` documents all."
        )
    name_files(out, files)


def disturbance_profile(scene: Any, disturbance: Any, seed: int, seconds: float) -> Profile:
    """Disturbance of an episode over time."""
    env = gymnasium.make("UVMS-StationKeep-v0", scene=scene, disturbance=disturbance)
    env.reset(seed=seed)
    task: Any = env.unwrapped
    profile: Profile = task.disturbance(0, round(seconds * env.metadata["render_fps"]))
    env.close()
    return profile


def _plot(path: Path, title: str, profile: Mapping[str, Any]) -> None:
    with picture(path, 8.0, 6.4) as figure:
        water, force, rest = figure.subplots(3, 1, sharex=True)
        time = profile["time"]
        for k, (axis, colour) in enumerate(zip("xyz", (BLUE, VERMILION, GREEN), strict=True)):
            water.plot(time, profile["current"][:, k], color=colour, label=axis)
            force.plot(time, profile["wrench"][:, k], color=colour, drawstyle="steps-post", label=axis)
        water.set(title=title, ylabel="water (m/s), world")
        force.set(ylabel="force (N), body")
        rest.plot(time, 100.0 * profile["gains"], color=PURPLE, linewidth=1.2)
        rest.set(ylabel="thrusters (%)", ylim=(-5.0, 105.0), xlabel="time (s)")
        mass = rest.twinx()
        mass.plot(time, profile["payload"], color=ORANGE, drawstyle="steps-post")
        mass.set_ylabel("payload (kg)", color=ORANGE)
        mass.set_ylim(bottom=0.0)
        mass.grid(visible=False)
        for axes in (water, force):
            legend_above(axes)


def _plot_shapes(path: Path, shapes: Mapping[str, Mapping[str, Any]]) -> None:
    small = {"font__size": 8.0, "axes__titlesize": 9.0, "legend__fontsize": 7.5, "lines__linewidth": 1.1}
    with picture(path, 8.0, 5.4, **small) as figure:
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
            for k, curve in enumerate(lines.T):
                axes.plot(
                    time, curve, color=(BLUE, VERMILION, GREEN)[k % 3], drawstyle="steps-post", label="xyz"[k % 3]
                )
            axes.set(title=title, ylabel=unit)
            if unit in ("N", "m/s"):
                legend_above(axes)
            if axes.get_subplotspec().is_last_row():
                axes.set_xlabel("time (s)")
