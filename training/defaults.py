"""Errors and times of the recipes of `uvms train`, beside the best classical controller on the same held-out episodes.

    python training/defaults.py --out docs/_static/defaults.json

Each row is one run of `uvms train --env ENV --env-kwargs scene:SCENE --seed SEED`. The file keeps rows that are done:
the same command goes on where it was interrupted. `--table` prints the table of docs/training.md from it.
"""

import os
import resource
import subprocess
import sys
import time
import warnings
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import typer

from uvms_gym import ControllerWarning, StepWarning, make_controller
from uvms_gym.cli.app import run
from uvms_gym.cli.common import check_known, line, progress, user_errors
from uvms_gym.cli.options import ranged
from uvms_gym.rollouts import RolloutStats
from uvms_gym.studies.comparison.metrics import pose_rms
from uvms_gym.studies.comparison.statistics import Draws, Scores, interquartile_mean
from uvms_gym.studies.records import circumstances, read_json, write_json
from uvms_gym.training.evaluation import ENDING, episode_steps, run_episodes
from uvms_gym.training.export import weights_hash
from uvms_gym.training.hyperparameters import read_hyperparameters

#: First seed of the held-out episodes, which nothing is tuned, trained or evaluated on elsewhere.
HELD_OUT = 5_000_000
#: Vehicles with thrusters, and the one with a tool.
SCENES = (
    "petasus-pum",
    "bluerov2-heavy",
    "bluerov2-heavy-alpha5",
    "bluerov2-alpha5-pool",
    "rexrov",
    "bluerov2-heavy-two-alpha5",
    "bluerov2-heavy-alpha5-gripper",
)
TOOL = "bluerov2-heavy-alpha5-tool"
#: Environments by task, with its scenes and its strong classical controllers.
TASKS: dict[str, tuple[Sequence[str], tuple[str, ...]]] = {
    "StationKeep": (SCENES, ("pid", "dob", "mpc")),
    "Dock": (SCENES, ("dock-pd",)),
    "EETrack": (SCENES, ("resolved-dob", "resolved-adaptive")),
    "Button": (("petasus-pum", TOOL), ("resolved-dob", "resolved-adaptive")),
    "Valve": ((TOOL,), ("resolved", "resolved-dob")),
}


def rows() -> list[tuple[str, str]]:
    """Environments and scenes."""
    return [
        (f"UVMS-{task}{level}-v0", scene)
        for level in ("-Storm", "")
        for task, (scenes, _) in TASKS.items()
        for scene in scenes
    ]


def classical(env: str) -> tuple[str, ...]:
    """Strong classical controllers of an environment."""
    return TASKS[env.removeprefix("UVMS-").partition("-")[0]][1]


def figures(stats: RolloutStats, task: str) -> tuple[dict[str, Any], list[float]]:
    """Means and tails over episodes, and the pose error of each, mm."""
    errors = 1e3 * pose_rms(stats, task)
    found = {
        "pose": interquartile_mean(errors),
        "pose_95": float(np.quantile(errors, 0.95)),
        "pose_999": float(np.quantile(errors, 0.999)),
        "worst": float(errors.max()),
        "power": 100.0 * float(stats.mean("power").mean()),
        "variation": 1e3 * float(stats.mean("action_rate").mean()),
        "diverged": float(stats.terminated.mean()),
    }
    if task in ENDING:
        found["success"] = 100.0 * float(stats.last["success"].mean())
    return found, errors.tolist()


@cache
def measure(env: str, scene: str, name: str, episodes: int) -> tuple[dict[str, Any], list[float]]:
    """Means and tails of a controller over the held-out episodes, and the pose error of each, mm."""
    options = {"scene": scene, **read_hyperparameters(env, algo="distill")["env_kwargs"]}
    envs = gymnasium.make_vec(env, num_envs=episodes, **options)
    task: str = envs.unwrapped.task  # type: ignore[attr-defined]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ControllerWarning)
        warnings.simplefilter("ignore", StepWarning)
        stats = run_episodes(envs, make_controller(name, envs), HELD_OUT, episode_steps(env, options))
    envs.close()
    return figures(stats, task)


def train(env: str, scene: str, seed: int, folder: Path) -> tuple[Path, dict[str, Any]]:
    """Run `uvms train` to its end; returns the policy and its times, s."""
    policy = folder / f"{env}-{scene}-{seed}.safetensors"
    given = ["train", "--env", env, "--env-kwargs", f"scene:{scene}", "--seed", str(seed), "--export", str(policy)]
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    load = os.getloadavg()[0]
    subprocess.run([sys.executable, "-m", "uvms_gym", *given, "-f", str(folder), "--verbose", "0"], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    times = {"wall": time.perf_counter() - begun, "processor": processor, "load": [load, os.getloadavg()[0]]}
    return policy, {"seconds": times, "weights": weights_hash(policy)}


def ratio(ours: list[float], theirs: list[float]) -> list[float]:
    """Typical error over another controller's on the same episodes, with its interval."""
    draws = Draws(len(ours), 0)
    one, other = (Scores(errors, draws).statistics()[0] for errors in (ours, theirs))
    return list(one.over(other).estimate())


def table(results: list[dict[str, Any]]) -> str:
    """Table of all rows, training seeds together; in cells with several numbers the classical ones are first."""
    head = ["environment", "scene", "classical", "its error or success", "the policy's", "ratio of errors", "power, %"]
    head += ["variation, 1e-3", "99.9th percentile, worst, mm", "wall, processor time, s"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for env, scene in dict.fromkeys((r["env"], r["scene"]) for r in results):
        own = [r for r in results if (r["env"], r["scene"]) == (env, scene)]
        name, rival = own[0]["best"], own[0]["controllers"][own[0]["best"]]
        ours = [r["policy"] for r in own]

        def pair(key: str, rival: Any = rival, ours: Any = ours) -> str:
            return "; ".join(f"{found[key]:.3g}" for found in (rival, *ours))

        key, unit = ("success", " %") if "success" in rival else ("pose", " mm")
        ratios = "; ".join(f"{r['ratio'][0]:.2f}" for r in own) if key == "pose" else ""
        tails = "; ".join(f"{p['pose_999']:.0f}, {p['worst']:.0f}" for p in (rival, *ours))
        times = "; ".join(f"{r['seconds']['wall']:.0f}, {r['seconds']['processor']:.0f}" for r in own)
        row = [f"`{env.removeprefix('UVMS-').removesuffix('-v0')}`", f"`{scene}`", f"`{name}`"]
        row += [f"{rival[key]:.1f}{unit}", "; ".join(f"{p[key]:.1f}" for p in ours) + unit, ratios]
        row += [pair("power"), pair("variation"), tails if key == "pose" else "", times]
        lines.append("| " + " | ".join(row) + " |")
    return "\n".join(lines) + "\n"


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command()
def main(
    out: Annotated[Path, typer.Option(help="File of the results.")] = Path("out/defaults.json"),
    env: Annotated[list[str] | None, typer.Option(help="Environment; may be repeated. [default: all]")] = None,
    scene: Annotated[list[str] | None, typer.Option(help="Scene; may be repeated. [default: all]")] = None,
    seed: Annotated[list[int] | None, typer.Option(help="Training seed; may be repeated. [default: 0, 1, 2]")] = None,
    episodes: Annotated[int, ranged("Held-out episodes, 2 to 100000.", 2, 100_000)] = 1024,
    folder: Annotated[Path, typer.Option(help="Folder of the runs.")] = Path("out/train/defaults"),
    table_only: Annotated[bool, typer.Option("--table", help="Print the table of stored results.")] = False,
) -> None:
    """Train all defaults, and measure them beside classical controllers."""
    with user_errors(f"{out}: "):
        stored = read_json(out) if out.exists() else {"results": []}
    results = stored["results"]
    if table_only:
        print(table(results), end="")
        return
    check_known("environment", env or (), {name for name, _ in rows()})
    check_known("scene", scene or (), {name for _, name in rows()})
    folder.mkdir(parents=True, exist_ok=True)
    made = circumstances("defaults", {"episodes": episodes, "first_seed": HELD_OUT})
    done = {(r["env"], r["scene"], r["seed"]) for r in results}
    work = [
        (e, s, i)
        for i in seed or (0, 1, 2)
        for e, s in rows()
        if (not env or e in env) and (not scene or s in scene) and (e, s, i) not in done
    ]
    with progress() as bar:
        task = bar.add_task("recipes", total=len(work))
        for e, s, i in work:
            policy, times = train(e, s, i, folder)
            found = {name: measure(e, s, name, episodes) for name in classical(e)}
            ours, errors = measure(e, s, f"mlp:{policy}", episodes)
            key = "success" if "success" in ours else "pose"
            order = [(-f[key] if key == "success" else f[key], name) for name, (f, _) in found.items()]
            best = min(order)[1]
            controllers = {name: f for name, (f, _) in found.items()}
            results.append({"env": e, "scene": s, "seed": i, "policy": ours, "controllers": controllers, "best": best})
            results[-1] |= {"ratio": ratio(errors, found[best][1]), **times, "commit": made["commit"]}
            write_json(out, made | {"results": results})
            bar.update(task, advance=1)
    line(str(out))


if __name__ == "__main__":
    sys.exit(run(app=app, name="defaults.py"))
