"""Errors of the policy for any vehicle, beside controllers tuned for each vehicle and untuned ones.

    python training/universal_results.py --out docs/_static/universal.json [--robot FILE] [--gains FOLDER]

Scenes are those of the package that have thrusters along all six axes, and robots' files, which are imported. FOLDER
has gains of the robots' scenes from `training/tune.py --policies FOLDER`. The file keeps what is done: the same command
goes on where it was interrupted. `--table` prints the table of docs/results.md from it.
"""

import argparse
import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
from defaults import figures

import uvms_gym
from uvms_gym import MPC, PD, ControllerWarning, StepWarning, make_controller
from uvms_gym.controllers.registry import PRETRAINED
from uvms_gym.controllers.universal import UniversalPolicy
from uvms_gym.studies.comparison.statistics import Draws, Scores
from uvms_gym.studies.records import circumstances, read_json, write_json
from uvms_gym.training.evaluation import run_episodes

ENV, STEPS = "UVMS-StationKeep-Storm-v0", 200
#: First seed and number of the held-out episodes, which nothing is tuned, trained or evaluated on elsewhere.
HELD_OUT, EPISODES = 9_000_000, 1024
SCENES = (
    "petasus-pum",
    "bluerov2-heavy",
    "bluerov2-heavy-alpha5",
    "bluerov2-heavy-alpha5-gripper",
    "bluerov2-heavy-two-alpha5",
    "bluerov2-alpha5-pool",
    "rexrov",
)
#: Classical controllers with the gains tuned for a scene, and with the scene's own.
TUNED = ("pd", "mpc")
UNTUNED = ("pd", "pid", "mpc")
KINDS = {"pd": PD, "mpc": MPC}


def measure(scene: Any, make: Callable[[Any], Any]) -> tuple[dict[str, float], list[float]]:
    """Means and tails of a controller over the held-out episodes, and the pose error of each, mm."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ControllerWarning)
        warnings.simplefilter("ignore", StepWarning)
        envs = gymnasium.make_vec(ENV, num_envs=EPISODES, scene=scene)
        stats = run_episodes(envs, make(envs), HELD_OUT, STEPS)
    envs.close()
    return figures(stats, "station-keep")


def contenders(name: str, gains: Path | None, policy: UniversalPolicy) -> dict[str, Callable[[Any], Any]]:
    """Controllers of a scene by name: the policy, tuned ones, and untuned ones with `untuned` before their names."""
    made: dict[str, Callable[[Any], Any]] = {"universal": policy.network}
    if gains is None:
        made |= {one: lambda envs, one=one: make_controller(one, envs) for one in TUNED}
        if name == "petasus-pum":
            made["shac-distilled"] = lambda envs: make_controller("shac-distilled", envs)
    else:
        stored = json.loads((gains / "UVMS-StationKeep" / name / "0.1s" / "gains.json").read_text())
        made |= {one: lambda envs, one=one: KINDS[one](envs, **stored[one]["gains"]) for one in TUNED}
    untuned = {f"untuned {one}": lambda envs, one=one: make_controller(one, envs, gains="scene") for one in UNTUNED}
    return made | untuned


def ratio(ours: list[float], theirs: list[float]) -> list[float]:
    """Typical error over another controller's on the same episodes, with its interval."""
    draws = Draws(len(ours), 0)
    one, other = (Scores(errors, draws).statistics()[0] for errors in (ours, theirs))
    return list(one.over(other).estimate())


def table(results: list[dict[str, Any]]) -> str:
    """Table of docs/results.md."""
    head = ["scene", "`universal`, mm", "best tuned, mm", "ratio", "untuned `pd`, `pid`, `mpc`, mm"]
    head += ["95th, 99.9th percentile, worst, mm", "power, %", "variation, 1e-3"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for one in results:
        ours, best = one["controllers"]["universal"], one["controllers"][one["best"]]
        untuned = ", ".join(f"{one['controllers'][f'untuned {name}']['pose']:.1f}" for name in UNTUNED)
        low, high = one["ratio"][1:]
        tails = "; ".join(f"{x['pose_95']:.0f}, {x['pose_999']:.0f}, {x['worst']:.0f}" for x in (ours, best))
        row = [f"`{one['scene']}`", f"{ours['pose']:.1f}", f"`{one['best']}` {best['pose']:.1f}"]
        row += [f"{one['ratio'][0]:.2f} [{low:.2f}, {high:.2f}]", untuned, tails]
        row += ["; ".join(f"{x[key]:.3g}" for x in (ours, best)) for key in ("power", "variation")]
        lines.append("| " + " | ".join(row) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="file of the results")
    parser.add_argument("--robot", type=Path, action="append", default=[], help="robot's file; may be repeated")
    parser.add_argument("--gains", type=Path, help="folder of the robots' gains")
    shipped = PRETRAINED / "UVMS-StationKeep" / "universal-0.safetensors"
    parser.add_argument("--policy", type=Path, default=shipped, help="policy; default: the shipped one")
    parser.add_argument("--table", action="store_true", help="print the table of stored results")
    given = parser.parse_args()
    results = read_json(given.out)["results"] if given.out.exists() else []
    if given.table:
        print(table(results), end="")
        return
    policy = UniversalPolicy.load(given.policy)
    made = circumstances("universal", {"episodes": EPISODES, "first_seed": HELD_OUT, "policy": dict(policy.notes)})
    scenes: list[tuple[str, Any, Path | None]] = [(name, name, None) for name in SCENES]
    for file in given.robot:
        scene = uvms_gym.import_robot(file)
        scenes.append((scene["name"], scene, given.gains))
    for name, scene, gains in scenes:
        if any(one["scene"] == name for one in results):
            continue
        found = {key: measure(scene, make) for key, make in contenders(name, gains, policy).items()}
        controllers = {key: one for key, (one, _) in found.items()}
        tuned = {key: one["pose"] for key, one in controllers.items() if key != "universal" and "untuned" not in key}
        best = min(tuned, key=tuned.__getitem__)
        entry = {"scene": name, "controllers": controllers, "best": best}
        results.append(entry | {"ratio": ratio(found["universal"][1], found[best][1]), "commit": made["commit"]})
        write_json(given.out, made | {"results": results})
        print(f"{name}: {controllers['universal']['pose']:.1f} mm, {best} {tuned[best]:.1f} mm", flush=True)


if __name__ == "__main__":
    main()
