"""Success of controllers on button and valve by the water's motion and the valve's friction, on the same seeds.

    python training/manipulation.py --out docs/_static/contact/manipulation.json

The file keeps the results of conditions that are done, so that the same command goes on where it was interrupted.
`--table` prints the tables of docs/environments/button.md and valve.md from it.
"""

import json
import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import typer
from scipy.stats import binomtest

from uvms_gym import StepWarning, make_controller
from uvms_gym._files import write
from uvms_gym.cli.app import run
from uvms_gym.cli.common import fail, line, progress, user_errors
from uvms_gym.cli.options import ranged
from uvms_gym.controllers import Controller
from uvms_gym.controllers.families import is_learned
from uvms_gym.controllers.registry import available, policies
from uvms_gym.studies.records import circumstances
from uvms_gym.training.evaluation import run_episodes

#: A vehicle of 15 kg whose arm reaches forward, and one of 110 kg, for the button only.
SCENES, SEED = ("bluerov2-heavy-alpha5-tool", "petasus-pum"), 0
TORQUES = (0.012, 0.1, 0.3, 0.6, 1.0)
#: Range of a blocked valve, rad.
BLOCKED = 0.3
#: Suffix of the environment's name and options; a current alone is what the public suite's valve has.
LEVELS: dict[str, tuple[str, dict[str, Any]]] = {
    "calm": ("", {}),
    "current": ("", {"disturbance": "current"}),
    "storm": ("-Storm", {}),
}
CONTROLLERS = ("resolved", "resolved-dob", "resolved-adaptive", "shac/tool", "blend/resolved-dob")
#: Metrics at the end of an episode, with the quantiles over episodes that are stored.
METRICS = ("time_to_success", "peak_force", "impulse", "angle", "slip", "travel")
QUANTILES = (0.5, 0.95)


def conditions(levels: Sequence[str]) -> list[tuple[str, dict[str, Any]]]:
    """Environments and options of all conditions."""
    found: list[tuple[str, dict[str, Any]]] = []
    for suffix, options in (LEVELS[level] for level in levels):
        found += [(f"UVMS-Button{suffix}-v0", {"scene": scene, **options}) for scene in SCENES]
        for contract in ("push", "grasp"):
            env, common = f"UVMS-Valve{suffix}-v0", {"scene": SCENES[0], "contract": contract, **options}
            found += [(env, {**common, "torque": torque}) for torque in TORQUES]
            found.append((env, {**common, "range": BLOCKED}))
    return found


def measure(env: str, options: dict[str, Any], name: str, episodes: int) -> list[dict[str, Any]]:
    """Results of a controller, one for each training seed; none if there is no such controller."""
    envs = gymnasium.make_vec(env, num_envs=episodes, **options)
    if name not in available(envs):
        return []
    seeds = sorted(policies(envs)[name]) if is_learned(name) else [None]
    return [_measure(envs, env, options, name, seed) for seed in seeds]


def _measure(envs: Any, env: str, options: dict[str, Any], name: str, seed: int | None) -> dict[str, Any]:
    controller: Controller = make_controller(name, envs, seed=seed)
    episodes = envs.num_envs
    began = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)
        stats = run_episodes(envs, controller, SEED, gymnasium.spec(env).max_episode_steps or 0)
    successes = int(stats.last["success"].sum())
    interval = binomtest(successes, episodes).proportion_ci(0.95, method="wilson")
    found = {
        "env": env,
        "options": options,
        "controller": name,
        **({} if seed is None else {"training_seed": seed}),
        "episodes": episodes,
        "successes": successes,
        "interval": [interval.low, interval.high],
        "diverged": int(stats.terminated.sum()),
        "power": float(stats.mean("power").mean()),
        "saturation": float(stats.mean("saturation").mean()),
        "seconds": round(time.perf_counter() - began, 1),
    }
    for metric in METRICS:
        if metric in stats.last:
            found[metric] = np.quantile(stats.last[metric], QUANTILES).tolist()
    return found


def level_of(result: dict[str, Any]) -> str:
    """Level of a result."""
    options = result["options"]
    return "storm" if "-Storm" in result["env"] else options.get("disturbance", "calm")


def label(result: dict[str, Any]) -> str:
    """Controller of a result, with its training seed."""
    seed = f", seed {result['training_seed']}" if "training_seed" in result else ""
    return f"`{result['controller']}`{seed}"


def cell(result: dict[str, Any]) -> str:
    """Success with its interval, %."""
    low, high = (100.0 * bound for bound in result["interval"])
    return f"{100.0 * result['successes'] / result['episodes']:.1f} ({low:.1f} to {high:.1f})"


def tables(results: list[dict[str, Any]]) -> str:
    """Tables of a button's and a valve's results."""
    lines = ["| water | scene | controller | success, % | time, s | peak force, N | impulse, N s | power, % |"]
    lines.append("|---|---|---|---|---|---|---|---|")
    for result in results:
        if "Button" in result["env"]:
            middle, high = result["peak_force"]
            row = [level_of(result), f"`{result['options']['scene']}`", label(result), cell(result)]
            row += [f"{result['time_to_success'][0]:.1f}", f"{middle:.0f}, 95 %: {high:.0f}"]
            row += [f"{result['impulse'][0]:.0f}", f"{100 * result['power']:.1f}"]
            lines.append("| " + " | ".join(row) + " |")
    for contract in ("push", "grasp"):
        head = ["water", "controller", *(f"{torque:g} N m" for torque in TORQUES), "blocked"]
        lines += ["", f'`contract="{contract}"`:', "", "| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
        chosen = [r for r in results if r["options"].get("contract") == contract]
        for level, name in dict.fromkeys((level_of(r), label(r)) for r in chosen):
            own = {r["options"].get("torque"): r for r in chosen if (level_of(r), label(r)) == (level, name)}
            cells = [cell(own[torque]) if torque in own else "" for torque in (*TORQUES, None)]
            lines.append("| " + " | ".join([level, name, *cells]) + " |")
    return "\n".join(lines) + "\n"


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command()
def main(
    out: Annotated[Path, typer.Option(help="File of the results.")] = Path("out/manipulation.json"),
    episodes: Annotated[int, ranged("Episodes of a condition, 1 to 100000.", 1, 100_000)] = 1024,
    controller: Annotated[list[str] | None, typer.Option(help="Controller; may be repeated.")] = None,
    level: Annotated[
        list[str] | None, typer.Option(help="calm, current or storm; may be repeated. [default: all]")
    ] = None,
    table: Annotated[bool, typer.Option("--table", help="Print the tables of stored results.")] = False,
) -> None:
    """Measure success, time and forces of controllers on button and valve."""
    with user_errors(f"{out}: "):
        stored = json.loads(out.read_text()) if out.exists() else {"results": []}
    if table:
        print(tables(stored["results"]), end="")
        return
    stored |= circumstances("manipulation", {"episodes": episodes, "seed": SEED})
    done = {json.dumps([r["env"], r["options"], r["controller"]]) for r in stored["results"]}
    names, levels = tuple(controller or CONTROLLERS), tuple(level or LEVELS)
    if unknown := set(levels) - LEVELS.keys():
        raise fail(f"--level is {min(unknown)}, but must be {', '.join(LEVELS)}")
    work = [(env, options, name) for env, options in conditions(levels) for name in names]
    with progress() as bar:
        task = bar.add_task("episodes", total=len(work))
        for env, options, name in work:
            if json.dumps([env, options, name]) not in done:
                stored["results"] += measure(env, options, name, episodes)
                write(out, json.dumps(stored, indent=1) + "\n")
            bar.update(task, advance=1)
    line(str(out))


if __name__ == "__main__":
    sys.exit(run(app=app, name="manipulation.py"))
