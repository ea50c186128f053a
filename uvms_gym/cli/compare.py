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

from uvms_gym import PD
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


class Rest:
    """No control: every action is zero."""

    def __init__(self, env: Any) -> None:
        self.shape = env.action_space.shape

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], None]:
        """Say zero, whatever is given."""
        return np.zeros(self.shape, dtype=np.float32), None


CONTROLLERS: dict[str, Callable[[Any], Any]] = {"none": Rest, "pd": PD}


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
        str, typer.Option(help=f"Any of {', '.join(CONTROLLERS)}; the others are set against the first.")
    ] = "none,pd",
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
    prepare(out, json_file, ("compare.json", "compare.png"))
    results: dict[str, Any] = {}
    with progress() as bar:
        for name, description in loaded.items():
            runs = {}
            for controller in names:
                task = bar.add_task(f"{description['name']}, {controller}", total=steps)
                options = {"scene": description, "action": action, "max_current": current}
                runs[controller] = run(env, options, controller, episodes, seed, partial(bar.advance, task))
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
    tick: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Run one episode of every seed from `seed` on.

    Returns
    -------
    dict
        per metric's entry: whole and settled (episodes,); diverged, the number of episodes that ended early; seconds.
    """
    started = time.perf_counter()
    try:
        batch = gymnasium.make_vec(env, num_envs=episodes, **options)
        control = CONTROLLERS[controller](batch)
    except (gymnasium.error.Error, ValueError, TypeError) as error:
        raise fail(f"{env}: {error}") from None
    observations, infos = batch.reset(seed=seed)
    if missing := [metric.entry for metric in METRICS if metric.entry not in infos]:
        raise fail(f"{env} measures no {missing[0]}")
    period = 1.0 / batch.metadata["render_fps"]
    begin = round(SETTLED / period)
    running = np.ones(episodes, dtype=np.bool_)
    diverged = 0
    sums = np.zeros((2, len(METRICS), episodes))
    counts = np.zeros((2, episodes))
    step = 0
    while running.any():
        actions, _ = control.predict(observations)
        observations, _, terminated, truncated, infos = batch.step(actions)
        values = np.stack([infos[metric.entry] ** 2 if metric.square else infos[metric.entry] for metric in METRICS])
        for part in range(2 if step >= begin else 1):
            sums[part] += np.where(running, values, 0.0)
            counts[part] += running
        diverged += int((running & terminated).sum())
        running &= ~(terminated | truncated)
        step += 1
        tick()
    batch.close()
    # An episode that ended before anything was settled has nothing but its whole to show.
    short = counts[1] == 0
    sums[1][:, short], counts[1][short] = sums[0][:, short], counts[0][short]
    result: dict[str, Any] = {"diverged": diverged, "control_period": period, "seconds": time.perf_counter() - started}
    for i, metric in enumerate(METRICS):
        whole, settled = (np.sqrt(mean) if metric.square else mean for mean in sums[:, i] / counts)
        result[metric.entry] = {"whole": whole, "settled": settled}
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
        raise fail(f"no controllers given; known: {', '.join(CONTROLLERS)}")
    for name in names:
        if name not in CONTROLLERS:
            raise fail(f"unknown controller {name!r}; known: {', '.join(CONTROLLERS)}")
        if names.count(name) > 1:
            raise fail(f"controller {name!r} is given twice")
    return names


def _length(env: str) -> int | None:
    """Look up the number of steps of an episode, and whether it is station keeping."""
    try:
        spec = gymnasium.spec(env)
    except gymnasium.error.Error as error:
        raise fail(str(error)) from None
    if spec.name != "UVMS-StationKeep":
        raise fail(f"--env is {env!r}, but only versions of UVMS-StationKeep, such as UVMS-StationKeep-v0, work")
    return spec.max_episode_steps
