"""A controller in the storm through ROS 2 beside in process, and round trips: results of docs/ros2.md.

python tests/bench/ros2.py [--controller dob] [--seeds 5] [--out FILE.json]

Each episode of 20 s runs three times: in process, through two processes in lockstep, and through them in real time.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from uvms_gym import make_controller
from uvms_gym.studies.records import circumstances, write_json

ENV, SECONDS = "UVMS-StationKeep-Storm-v0", 20.0
#: Time by which controllers start before the vehicle, s.
HEAD_START = 6.0
MEASURES = {"rms_position_error": ("mm", 1e3), "rms_attitude_error": ("mrad", 1e3)}


def in_process(name: str, seed: int) -> dict[str, float]:
    """Metrics of the episode without middleware."""
    env: Any = gymnasium.make(ENV).unwrapped
    control, state = make_controller(name, env), None
    observation, info = env.reset(seed=seed)
    for _ in range(round(SECONDS / env.control_period)):
        action, state = control.predict(observation, state)
        observation, *_, info = env.step(action)
    return dict(info)


def through_ros(name: str, seed: int, *options: str) -> dict[str, float]:
    """Metrics and round trips of the episode through two processes."""
    uvms = [sys.executable, "-m", "uvms_gym", "ros2"]
    with tempfile.TemporaryDirectory() as folder:
        file, common = Path(folder, "r.json"), ["--env", ENV, "--seed", str(seed)]
        # The last command is on the measurement a period before the end.
        control = [*uvms, "control", *common, "--controller", name, "--seconds", f"{SECONDS - 0.1:g}", "--wait", "30"]
        with subprocess.Popen(control, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as other:
            # The vehicle drifts until a controller comes: it waits for the vehicle.
            time.sleep(HEAD_START)
            simulate = [*uvms, "simulate", *common, "--seconds", f"{SECONDS:g}", "--json", str(file), *options]
            subprocess.run(simulate, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            try:
                other.wait(10.0)
            except subprocess.TimeoutExpired:
                other.terminate()
        return dict(json.loads(file.read_text()))


def main() -> None:
    """Run all and print tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--controller", default="dob")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for seed in range(given.seeds):
        ways = {
            "in process": in_process(given.controller, seed),
            "lockstep": through_ros(given.controller, seed, "--lockstep"),
            "real time": through_ros(given.controller, seed),
        }
        rows.append(ways)
        texts = [
            f"{way}: " + ", ".join(f"{scale * found[name]:.4g} {unit}" for name, (unit, scale) in MEASURES.items())
            for way, found in ways.items()
        ]
        print(f"seed {seed}: {'; '.join(texts)}", flush=True)
    for name, (unit, scale) in MEASURES.items():
        means = {way: scale * np.mean([row[way][name] for row in rows]) for way in rows[0]}
        apart = max(abs(row["lockstep"][name] / row["in process"][name] - 1.0) for row in rows)
        print(name, *(f"{way} {mean:.4g} {unit}" for way, mean in means.items()), f"lockstep apart at most {apart:.1e}")
    for way in ("lockstep", "real time"):
        keys = ("round_trip_median", "round_trip_95", "round_trip_maximum")
        median, high, most = ([1e3 * row[way][key] for row in rows] for key in keys)
        print(f"{way}: median {np.median(median):.2g} ms, 95 % {np.median(high):.2g} ms, maximum {max(most):.3g} ms")
    print("late periods", sum(row["real time"]["late"] for row in rows))
    if given.out is not None:
        write_json(
            given.out,
            {
                "circumstances": circumstances(
                    "tests/bench/ros2.py", {"controller": given.controller, "seeds": given.seeds}
                ),
                "rows": rows,
            },
        )


if __name__ == "__main__":
    main()
