"""`uvms disturbances`: what there is to disturb episodes, and what it looks like."""

from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import typer
from numpy.typing import NDArray

import uvms_gym
from uvms_gym.cli import plots
from uvms_gym.cli.common import Out, check_range, console, fail, prepare, say, table
from uvms_gym.cli.scenes import read_scene

Profile = dict[str, NDArray[np.float64]]

#: What is drawn of each component: its title, and the component with numbers that show its shape.
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
#: Longest time that is drawn, s.
LONGEST = 3600.0


def disturbances(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="Level to draw; without it all, and each component's shape.")
    ] = None,
    scene: Annotated[str, typer.Option(help="Scene: name or TOML file.")] = "petasus-pum",
    seed: Annotated[int, typer.Option(help="Seed of the episode that is drawn.")] = 0,
    seconds: Annotated[float, typer.Option(help=f"Time that is drawn, 1 to {LONGEST:g} s.")] = 20.0,
    out: Out = Path("out/disturbances"),
) -> None:
    """List the levels of disturbances, and draw what an episode of them is disturbed by.

    Pictures show the water's velocity, the force and what is left of the thrusters, for a vehicle at its target.
    """
    levels = uvms_gym.disturbances()
    if name is not None and name not in levels:
        raise fail(f"there is no level {name!r}; known: {', '.join(levels)}")
    check_range("--seconds", seconds, 1.0, LONGEST)
    check_range("--seed", seed, 0, 2**64 - 1)
    description = read_scene(scene)
    chosen = [name] if name is not None else list(levels)
    files = [f"{level}.png" for level in chosen] + ([] if name is not None else ["shapes.png"])
    prepare(out, None, files)
    rows = [(level, ", ".join(levels[level].components) or "-", levels[level].description) for level in chosen]
    table("Levels", ("name", "components", "what it is"), rows, text_columns=3)
    for level in chosen:
        profile = look(description, level, seed, seconds)
        plots.disturbance(out / f"{level}.png", f"{level}: {description['name']}, seed {seed}", profile)
    if name is None:
        shapes = {title: look(description, made, seed, seconds) for title, made in SHAPES.values()}
        plots.disturbance_shapes(out / "shapes.png", shapes)
        say(
            "Levels with -hard are for evaluation: stronger, and of shapes that the others lack. Noise, delay, the "
            "arm's motion and parameters have no shape over time; `pydoc uvms_gym.envs.station_keep` tells of all."
        )
    console.print(f"{out}: {', '.join(files)}", markup=False, soft_wrap=True)


def look(scene: Any, disturbance: Any, seed: int, seconds: float) -> Profile:
    """Tell what an episode is disturbed by."""
    try:
        env = gymnasium.make("UVMS-StationKeep-v0", scene=scene, disturbance=disturbance)
    except (gymnasium.error.Error, ValueError, TypeError) as error:
        raise fail(str(error)) from None
    env.reset(seed=seed)
    task: Any = env.unwrapped
    profile: Profile = task.disturbance(0, round(seconds * env.metadata["render_fps"]))
    env.close()
    return profile
