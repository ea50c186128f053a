"""Try robots' files: import each as it is, and hold station for 200 periods under PID.

    python training/robot_files.py FOLDER [--out TABLE.md]

Every file of the folder (or row of its INDEX.csv: id, repository, file) runs in a process of its own, with a limit
of time and memory. The table states which files are imported, and the errors of vehicle and end effector after 10 s.
A vehicle that does not hold station, as its thrusters do not push along some axis, gets assumed ones for a second
attempt.
"""

import argparse
import csv
import json
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import uvms_gym
from uvms_gym._files import write

SUFFIXES = (".urdf", ".sdf", ".xml", ".yaml", ".yml")
PERIODS, SECONDS, BYTES = 200, 240, 6 << 30
#: Error at which station is held, m, and the axes that this takes.
HELD, NEEDED = 0.05, ("surge", "sway", "heave", "yaw")


def attempt(path: str) -> dict[str, Any]:
    """Import a file, and hold station: what was read, errors in m, or the message."""
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, resource.getrlimit(resource.RLIMIT_AS)[1]))
    try:
        scene = uvms_gym.import_robot(path)
    except uvms_gym.SceneError as error:
        return {"refused": str(error).removeprefix(f"{path}: ")}
    simulator, authority = uvms_gym.Simulator(scene), uvms_gym.assess_scene(scene)["authority"]
    found: dict[str, Any] = {"joints": simulator.num_joints, "thrusters": simulator.num_thrusters}
    found["assumed"] = "ASSUMED" in scene["summary"]
    found["missing"] = [axis["axis"] for axis in authority if axis["axis"] in NEEDED and not axis["alone"]]
    found |= hold_station(scene)
    if found["missing"] and not is_held(found):
        found["with_assumed"] = hold_station(uvms_gym.import_robot(path, thrusters="assumed"))
    return found


def hold_station(scene: dict[str, Any]) -> dict[str, Any]:
    """Error of an episode of station keeping, m, or why there is none."""
    try:
        env = gymnasium.make("UVMS-StationKeep-v0", scene=scene)
    except ValueError as error:
        return {"failed": str(error)}
    controller, memory = uvms_gym.make_controller("pid", env), None
    observation, info = env.reset(seed=0)
    for k in range(PERIODS):
        action, memory = controller.predict(observation, memory, episode_start=np.array(k == 0))
        observation, _, terminated, _, info = env.step(action)
        if terminated:
            return {"diverged": k + 1}
    return {"error": info["position_error"], "end_effector": info["end_effector_position_error"]}


def is_held(found: dict[str, Any]) -> bool:
    """Whether the episode ended near the station."""
    return bool(found.get("error", np.inf) < HELD)


def in_process(path: str) -> dict[str, Any]:
    """`attempt` in a process of its own."""
    command = [sys.executable, __file__, "--one", path]
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return {"failed": f"longer than {SECONDS} s"}
    if run.returncode:
        return {"failed": (run.stderr.strip().splitlines() or [f"exit status {run.returncode}"])[-1]}
    return dict(json.loads(run.stdout))


def outcome(found: dict[str, Any]) -> str:
    """Last column of a row."""
    if "refused" in found:
        text = f"refused: {found['refused']}"
    elif "failed" in found:
        text = f"failed: {found['failed']}"
    else:
        text = f"diverged in period {found['diverged']}" if "diverged" in found else f"{100 * found['error']:.1f} cm"
    if found.get("joints") and "end_effector" in found:
        text += f", end effector {100 * found['end_effector']:.1f} cm"
    if found.get("missing"):
        text += f"; no {', '.join(found['missing'])}"
    if "with_assumed" in found:
        text += f"; with assumed thrusters {outcome(found['with_assumed'])}"
    return text


def listed(folder: Path) -> list[dict[str, str]]:
    """Rows of INDEX.csv, or all files of the folder."""
    if (folder / "INDEX.csv").exists():
        with open(folder / "INDEX.csv", newline="") as file:
            return list(csv.DictReader(file))
    paths = sorted(path for path in folder.rglob("*") if path.suffix in SUFFIXES)
    return [{"id": str(path.relative_to(folder)), "repository": "", "file": str(path)} for path in paths]


def main() -> None:
    """Print or write the table and its counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of robots' files")
    parser.add_argument("--out", type=Path, help="file of the table [default: the terminal]")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(attempt(str(given.folder))))
        return
    rows = ["| file | repository | joints | thrusters | after 10 s |", "|---|---|---|---|---|"]
    results = []
    for entry in listed(given.folder):
        found = in_process(entry["file"])
        results.append(found)
        numbers = [str(found.get(key, "")) for key in ("joints", "thrusters")]
        numbers[1] += " assumed" if found.get("assumed") else ""
        last = outcome(found).replace("<", r"\<").replace("|", r"\|")
        rows.append("| " + " | ".join([entry["id"], entry["repository"], *numbers, last]) + " |")
        print(entry["id"], outcome(found), file=sys.stderr)
    imported = [found for found in results if "joints" in found]
    held = sum(is_held(found) for found in imported)
    replaced = sum(is_held(found.get("with_assumed", {})) for found in imported)
    assumed = sum(found["assumed"] for found in imported)
    lacking = sum(bool(found["missing"]) for found in imported)
    rows += ["", f"{len(results)} files: {len(imported)} imported, {assumed} of them with assumed thrusters and "]
    rows[-1] += f"{lacking} without thrust along some axis; {held} end within {100 * HELD:g} cm, and {replaced} more "
    rows[-1] += "with assumed thrusters in the place of the file's."
    text = "\n".join(rows) + "\n"
    if given.out is None:
        print(text, end="")
    else:
        write(given.out, text)


if __name__ == "__main__":
    main()
