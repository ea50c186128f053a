"""`uvms compare`: controllers over the same seeded episodes."""

import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import gymnasium
import numpy as np
import typer
from numpy.typing import NDArray

from uvms_gym import Rollout
from uvms_gym.cli import plots
from uvms_gym.cli.common import (
    Json,
    Out,
    check_range,
    circumstances,
    console,
    fail,
    prepare,
    progress,
    say,
    table,
    write_json,
)
from uvms_gym.cli.scenes import read_scene
from uvms_gym.cli.statistics import Estimate, bootstrap, improvement_probability
from uvms_gym.controllers import MLP, PD, PID, Controller, Rest
from uvms_gym.envs import EPISODE_STEPS

Floats = NDArray[np.float64]

SCENES = ("petasus-pum", "bluerov2-heavy-alpha5")
#: Time after which the start counts no more in the second of the two numbers, s.
SETTLED = 3.0
#: Most episodes of one run, so that a slip of the keyboard does not ask for all memory.
MOST_EPISODES = 100_000
#: Greatest speed of the current that can be asked for, m/s.
MOST_CURRENT = 10.0


class Metric(NamedTuple):
    """A measure of an episode: root mean square or mean of an entry of `info` over its steps. Less is better.

    `scale` leads from the entry to the unit.
    """

    title: str
    unit: str
    entry: str
    square: bool
    scale: float = 1.0

    @property
    def label(self) -> str:
        """Title with unit."""
        return f"{self.title}, {self.unit}"


#: Saturation comes last: it is for the table alone.
METRICS = (
    Metric("position", "m", "position_error", True),
    Metric("attitude", "rad", "attitude_error", True),
    Metric("end effector", "m", "end_effector_position_error", True),
    Metric("effort", "%", "effort", False, 100.0),
    Metric("saturation", "%", "saturation", False, 100.0),
)


#: Controllers by name; `mlp:FILE` besides.
CONTROLLERS: dict[str, type[PD] | type[PID] | type[Rest]] = {"none": Rest, "pd": PD, "pid": PID}
#: What stands before the file of a neural policy.
MLP_PREFIX = "mlp:"
KNOWN = f"{', '.join(CONTROLLERS)}, {MLP_PREFIX}FILE"


def compare(
    env: Annotated[str, typer.Option(help="Environment, by Gymnasium's id.")] = "UVMS-StationKeep-v0",
    scene: Annotated[
        list[str] | None,
        typer.Option(help=f"Scene: name or TOML file; may be repeated. Without it: {', '.join(SCENES)}."),
    ] = None,
    episodes: Annotated[
        int, typer.Option(help=f"Episodes of each controller in each scene, 2 to {MOST_EPISODES}.")
    ] = 256,
    seed: Annotated[int, typer.Option(help="Episode i has the seed SEED + i.")] = 0,
    controllers: Annotated[
        str, typer.Option(help=f"Any of {KNOWN}; the others are set against the first.")
    ] = "none,pd",
    disturbance: Annotated[
        str | None,
        typer.Option(help="Level of disturbances, such as storm; `uvms disturbances` lists them. [default: a current]"),
    ] = None,
    current: Annotated[
        float, typer.Option(help=f"Greatest speed of the drawn current, 0 to {MOST_CURRENT:g} m/s.")
    ] = 0.3,
    action: Annotated[Literal["wrench", "thrusters"], typer.Option(help="What controllers command.")] = "wrench",
    out: Out = Path("out/compare"),
    json_file: Json = None,
) -> None:
    """Compare controllers over paired seeded episodes.

    Prints interquartile means with 95 % intervals, and writes a picture and compare.json to --out.
    """
    names = _controllers(controllers)
    check_range("--episodes", episodes, 2, MOST_EPISODES)
    check_range("--seed", seed, 0, math.inf)
    check_range("--current", current, 0.0, MOST_CURRENT)
    chosen = scene or list(SCENES)
    for name in chosen:
        if chosen.count(name) > 1:
            raise fail(f"scene {name!r} is given twice")
    loaded = {name: read_scene(name) for name in chosen}
    steps = _length(env)
    given = {"action": action, "max_current": current, "disturbance": disturbance}
    settings = {name: {"scene": scene, **given} for name, scene in loaded.items()}
    for options in settings.values():
        for controller in names:
            _controller(env, controller, options)
    prepare(out, json_file, ("compare.json", "compare.png"))
    results: dict[str, Any] = {}
    with progress() as bar:
        for name, description in loaded.items():
            runs = {}
            for controller in names:
                task = bar.add_task(f"{description['name']}, {controller}", total=steps)
                runs[controller] = run(env, settings[name], controller, episodes, seed, partial(bar.advance, task))
            results[name] = summarise(runs, seed)
        task = bar.add_task("picture", total=None)
        plots.comparison(out / "compare.png", results, METRICS[:-1])
    for name, result in results.items():
        _print(name, result, episodes)
    say(
        "Interquartile means over episodes with 95 % bootstrap intervals. Errors are root mean squares over an "
        f"episode's steps, of the whole episode and of what comes after {SETTLED:g} s; effort is the mean of "
        "|T/T_max|^1.5. The difference is over pairs of episodes with the same seed; P(better) is the chance that an "
        "episode of one beats any episode of the other (rliable's probability of improvement)."
    )
    arguments = {
        "env": env,
        "scene": chosen,
        "episodes": episodes,
        "seed": seed,
        "controllers": names,
        "current": current,
        "disturbance": disturbance,
        "action": action,
    }
    data = {"circumstances": circumstances("compare", arguments), "results": results}
    for path in {out / "compare.json", json_file or out / "compare.json"}:
        write_json(path, data)
    console.print(f"{out}: compare.json, compare.png", markup=False, soft_wrap=True)


def run(
    env: str,
    options: dict[str, Any],
    controller: str,
    episodes: int,
    seed: int,
    tick: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """Run one episode of every seed from `seed` on; `tick` is told of every part how many steps it had.

    Returns
    -------
    dict
        per metric's entry: whole and settled (episodes,); diverged, the number of episodes that ended early; seconds.
    """
    started = time.perf_counter()
    control = _controller(env, controller, options)
    try:
        batch = gymnasium.make_vec(env, num_envs=episodes, **options)
    except (gymnasium.error.Error, ValueError, TypeError) as error:
        raise fail(f"{env}: {error}") from None
    batch.reset(seed=seed)
    period = 1.0 / batch.metadata["render_fps"]
    begin, length = round(SETTLED / period), _length(env)
    rollout = Rollout(batch, control)
    tallies = []
    for steps in (min(begin, length), max(0, length - begin)):
        rollout.run(steps, tick)
        tallies.append(rollout.take())
    batch.close()
    early, late = tallies
    # An episode that ended before anything was settled has nothing but its whole to show.
    settled = late.steps > 0
    result: dict[str, Any] = {
        "diverged": int((early.terminated | late.terminated).sum()),
        "control_period": period,
        "seconds": time.perf_counter() - started,
    }
    for metric in METRICS:
        first, last = ((t.squares if metric.square else t.sums)[metric.entry] for t in tallies)
        whole = (first + last) / (early.steps + late.steps)
        after = np.where(settled, last / np.maximum(late.steps, 1), whole)
        parts = {"whole": whole, "settled": after}
        result[metric.entry] = {part: np.sqrt(mean) if metric.square else mean for part, mean in parts.items()}
    return result


def summarise(runs: dict[str, dict[str, Any]], seed: int) -> dict[str, Any]:
    """Estimate every metric of every controller, and set the others against the first."""
    first, *others = runs
    estimates: dict[str, Any] = {}
    against: dict[str, Any] = {name: {} for name in others}
    for metric in METRICS:
        scores = {name: run[metric.entry] for name, run in runs.items()}
        for name, parts in scores.items():
            estimates.setdefault(name, {})[metric.entry] = {part: bootstrap([x], seed) for part, x in parts.items()}
        for name in others:
            against[name][metric.entry] = {
                part: {
                    "difference": bootstrap([x - scores[first][part]], seed),
                    "probability_of_improvement": improvement_probability([(x, scores[first][part])], seed),
                }
                for part, x in scores[name].items()
            }
    return {"baseline": first, "estimates": estimates, "against_baseline": against, "runs": runs}


def _print(name: str, result: dict[str, Any], episodes: int) -> None:
    rows = [
        (metric.label, controller, *(_text(estimate, metric.scale) for estimate in by_entry[metric.entry].values()))
        for metric in METRICS
        for controller, by_entry in result["estimates"].items()
    ]
    header = ("metric", "controller", "whole episode", f"after {SETTLED:g} s")
    table(f"{name}: {episodes} episodes", header, rows, text_columns=2)
    baseline = result["baseline"]
    for controller, by_entry in result["against_baseline"].items():
        rows = []
        for metric in METRICS:
            settled = by_entry[metric.entry]["settled"]
            better = settled["probability_of_improvement"]
            rows.append((metric.label, _text(settled["difference"], metric.scale), _text(better)))
        title = f"{name}: {controller} against {baseline}, after {SETTLED:g} s"
        table(title, ("metric", f"{controller} - {baseline}", "P(better)"), rows)
    for controller, episode_run in result["runs"].items():
        if episode_run["diverged"]:
            console.print(f"{controller}: {episode_run['diverged']} of {episodes} episodes diverged", markup=False)


def _text(estimate: Estimate, scale: float = 1.0) -> str:
    """Write a value with its interval, to two digits of the interval's width."""
    value, low, high = (scale * number for number in estimate)
    if high == low:
        return f"{value:g}"
    digits = max(0, 1 - math.floor(math.log10(high - low)))
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def _controllers(given: str) -> list[str]:
    names = [name.strip() for name in given.split(",") if name.strip()]
    if not names:
        raise fail(f"no controllers given; known: {KNOWN}")
    for name in names:
        if name not in CONTROLLERS and not name.startswith(MLP_PREFIX):
            raise fail(f"unknown controller {name!r}; known: {KNOWN}")
        if names.count(name) > 1:
            raise fail(f"controller {name!r} is given twice")
    return names


def _controller(env: str, name: str, options: dict[str, Any]) -> Controller:
    """Make a controller by its name, for the environment with these options."""
    chosen = {key: value for key, value in options.items() if key in ("scene", "action")}
    try:
        if name in CONTROLLERS:
            return CONTROLLERS[name](**chosen)
        return MLP.load(name.removeprefix(MLP_PREFIX), **chosen)
    except OSError as error:
        raise fail(f"cannot read {error.filename}: {error.strerror}") from None
    except (ValueError, TypeError) as error:
        raise fail(f"{env}: {error}") from None


def _length(env: str) -> int:
    """Look up the number of steps of an episode, and whether it is station keeping."""
    try:
        spec = gymnasium.spec(env)
    except gymnasium.error.Error as error:
        raise fail(str(error)) from None
    if spec.name != "UVMS-StationKeep":
        raise fail(f"--env is {env!r}, but only versions of UVMS-StationKeep, such as UVMS-StationKeep-v0, work")
    return spec.max_episode_steps or EPISODE_STEPS
