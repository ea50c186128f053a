"""Try robots' files: import each as it is, and hold station for 200 periods under PID.

    python training/robot_files.py FOLDER [--out TABLE.md]

Every file of the folder (or row of its INDEX.csv: id, repository, file) runs in a process of its own, with a limit
of time and memory. The table states which files are imported, and the vehicle's error after 10 s.
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
    assumed = "ASSUMED" in scene["summary"]
    found: dict[str, Any] = {"joints": simulator.num_joints, "thrusters": simulator.num_thrusters, "assumed": assumed}
    found["missing"] = [axis["axis"] for axis in authority if axis["axis"] in NEEDED and not axis["alone"]]
    try:
        env = gymnasium.make("UVMS-StationKeep-v0", scene=scene)
    except ValueError as error:
        return found | {"failed": str(error)}
    controller, memory = uvms_gym.make_controller("pid", env), None
    observation, info = env.reset(seed=0)
    for k in range(PERIODS):
        action, memory = controller.predict(observation, memory, episode_start=np.array(k == 0))
        observation, _, terminated, _, info = env.step(action)
        if terminated:
            return found | {"diverged": k + 1}
    return found | {"error": info["position_error"]}


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
    for key, text in (("refused", "refused: {}"), ("failed", "failed: {}")):
        if key in found:
            return text.format(found[key]).replace("<", r"\<").replace("|", r"\|")
    text = f"diverged in period {found['diverged']}" if "diverged" in found else f"{100 * found['error']:.1f} cm"
    return text + (f"; no {', '.join(found['missing'])}" if found["missing"] else "")


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
        rows.append("| " + " | ".join([entry["id"], entry["repository"], *numbers, outcome(found)]) + " |")
        print(entry["id"], outcome(found), file=sys.stderr)
    imported = [found for found in results if "joints" in found]
    held = [found for found in imported if found.get("error", np.inf) < HELD]
    assumed = sum(found["assumed"] for found in imported)
    lacking = sum(bool(found["missing"]) for found in imported)
    rows += ["", f"{len(results)} files: {len(imported)} imported, {assumed} of them with assumed thrusters and "]
    rows[-1] += f"{lacking} without thrust along some axis; {len(held)} end within {100 * HELD:g} cm."
    text = "\n".join(rows) + "\n"
    if given.out is None:
        print(text, end="")
    else:
        write(given.out, text)


if __name__ == "__main__":
    main()
