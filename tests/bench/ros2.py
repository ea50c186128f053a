"""A controller in the storm through ROS 2 beside in process; round trips; deadman, restart and reset: docs/ros2.md.

python tests/bench/ros2.py [--controllers dob ppo] [--seeds 5] [--out FILE.json]

Each episode of 20 s runs three times: in process, through two processes in lockstep, and through them in real time.
In one more, the controller ends, a new one takes its place, and the service `reset` begins the next episode.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from uvms_gym import make_controller
from uvms_gym.studies.records import circumstances, write_json

ENV, SECONDS = "UVMS-StationKeep-Storm-v0", 20.0
MEASURES = {"rms_position_error": ("mm", 1e3), "rms_attitude_error": ("mrad", 1e3)}
#: Maximum difference of the mean errors from in process.
BAR = 0.1
#: End of the first controller, time of the reset, and length of the episode after it, s.
ENDED, RESET, AFTER = 8.0, 25.0, 30.0
QUIET = subprocess.DEVNULL
UVMS = [sys.executable, "-m", "uvms_gym", "ros2"]


def in_process(name: str, seed: int, episode: int = 0, seconds: float = SECONDS) -> dict[str, float]:
    """Metrics of the episode without middleware."""
    env: Any = gymnasium.make(ENV).unwrapped
    control, state = make_controller(name, env), None
    observation, info = env.reset(seed=seed)
    for _ in range(episode):
        observation, info = env.reset()
    for _ in range(round(seconds / env.control_period)):
        action, state = control.predict(observation, state)
        observation, *_, info = env.step(action)
    return dict(info)


def started(control: list[str]) -> subprocess.Popen[bytes]:
    """Process of a controller that waits for the vehicle, which would drift until the controller comes."""
    made = subprocess.Popen(control, stdout=subprocess.PIPE, stderr=QUIET, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    assert made.stdout is not None and b"waits for" in made.stdout.readline()
    return made


def through_ros(name: str, seed: int, *options: str) -> dict[str, float]:
    """Metrics and round trips of the episode through two processes."""
    with tempfile.TemporaryDirectory() as folder:
        file, common = Path(folder, "r.json"), ["--env", ENV, "--seed", str(seed)]
        # The last command is on the measurement a period before the end.
        control = [*UVMS, "control", *common, "--controller", name, "--seconds", f"{SECONDS - 0.1:g}", "--wait", "30"]
        with started(control) as other:
            simulate = [
                *UVMS,
                "simulate",
                *common,
                "--seconds",
                f"{SECONDS:g}",
                "--json",
                str(file),
                "--wait-for-controller",
                *options,
            ]
            done = subprocess.run(simulate, capture_output=True, text=True)
            assert done.returncode == 0, done.stderr
            try:
                other.wait(10.0)
            except subprocess.TimeoutExpired:
                other.terminate()
        return dict(json.loads(file.read_text()))


def compared(controllers: list[str], seeds: int) -> list[dict[str, Any]]:
    """Episodes of all controllers and seeds, in the three ways."""
    rows = []
    for name in controllers:
        for seed in range(seeds):
            ways: dict[str, Callable[[], dict[str, float]]] = {
                "in process": lambda name=name, seed=seed: in_process(name, seed),
                "lockstep": lambda name=name, seed=seed: through_ros(name, seed, "--lockstep"),
                "real time": lambda name=name, seed=seed: through_ros(name, seed),
            }
            for way, run in ways.items():
                load, found = os.getloadavg()[0], run()
                rows.append({"controller": name, "seed": seed, "way": way, "load": load, "metrics": found})
                texts = (f"{scale * found[key]:.4g} {unit}" for key, (unit, scale) in MEASURES.items())
                print(f"{name}, seed {seed}, {way}: {', '.join(texts)}", flush=True)
    return rows


def summarised(rows: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Means over the seeds, differences from in process, and round trips of a controller."""

    def values(way: str, key: str) -> Any:
        return np.array([row["metrics"][key] for row in rows if (row["controller"], row["way"]) == (name, way)])

    made: dict[str, Any] = {"controller": name}
    for way in ("in process", "lockstep", "real time"):
        made[way] = found = {"means": {key: np.mean(values(way, key)) for key in MEASURES}}
        if way == "in process":
            continue
        base = {key: values("in process", key) for key in MEASURES}
        found["difference_of_means"] = {key: np.mean(values(way, key)) / np.mean(base[key]) - 1.0 for key in MEASURES}
        found["largest_difference"] = {key: np.max(np.abs(values(way, key) / base[key] - 1.0)) for key in MEASURES}
        found["round_trip"] = {
            "median": np.median(values(way, "round_trip_median")),
            "95": np.median(values(way, "round_trip_95")),
            "maximum": np.max(values(way, "round_trip_maximum")),
        }
        found["latest_first_command"] = np.max(values(way, "first_command"))
        found["late"] = np.sum(values(way, "late"))
    return made


def interrupted(name: str, seed: int) -> dict[str, Any]:
    """Deadman, a second controller, and a reset in real time: times, s, and errors of position, m.

    The errors are by odom, with its noise of 5 mm for each axis, but for those of the whole episode after the reset.
    """
    from std_srvs.srv import Trigger

    from uvms_gym.ros2.messages import SENSORS, pose_and_twist, time_of
    from uvms_gym.ros2.session import session

    env: Any = gymnasium.make(ENV).unwrapped
    env.reset(seed=seed)
    targets = [env.episode["target_position"][0]]
    env.reset()
    targets.append(env.episode["target_position"][0])
    errors: list[list[tuple[float, float]]] = [[]]
    asked: Any = None

    def hear(message: Any) -> None:
        stamp = time_of(message.header.stamp)
        if errors[-1] and stamp < errors[-1][-1][0]:
            errors.append([])
        place = pose_and_twist(message)[0]
        errors[-1].append((stamp, float(np.linalg.norm(place - targets[len(errors) - 1]))))

    common = ["--env", ENV, "--seed", str(seed)]
    control = [*UVMS, "control", *common, "--controller", name, "--wait", "30"]
    with tempfile.TemporaryDirectory() as folder, session("uvms_bench") as guest:
        file, log = Path(folder, "r.json"), Path(folder, "log")
        kept = guest.node.create_subscription(SENSORS["odom"], "odom", hear, 100)
        client = guest.node.create_client(Trigger, "reset")
        first = started([*control, "--seconds", f"{ENDED:g}"])
        with log.open("w") as lines:
            simulate = [
                *UVMS,
                "simulate",
                *common,
                "--seconds",
                f"{AFTER:g}",
                "--json",
                str(file),
                "--wait-for-controller",
            ]
            vehicle = subprocess.Popen(simulate, stdout=QUIET, stderr=lines)
        second = None
        while vehicle.poll() is None:
            guest.spin(0.02)
            if second is None and first.poll() is not None:
                second = subprocess.Popen(control, stdout=QUIET, stderr=QUIET)
            if asked is None and errors[0] and errors[0][-1][0] >= RESET:
                asked = client.call_async(Trigger.Request())
        for process in (first, second):
            if process is not None and process.poll() is None:
                process.terminate()
                process.wait(10.0)
        text = log.read_text()
        assert vehicle.returncode == 0, text
        found = json.loads(file.read_text())
        assert kept is not None and asked.result().success
    stops = [float(found) for found in re.findall(r"thrusts are 0 at ([\d.]+) s", text)]
    returns = [float(found) for found in re.findall(r"commands come at ([\d.]+) s", text)]

    def rms(low: float, high: float) -> float:
        return float(np.sqrt(np.mean([e**2 for t, e in errors[0] if low <= t < high])))

    return {
        "controller": name,
        "seed": seed,
        "last_command": ENDED,
        "thrusts_are_zero": stops[0],
        "commands_return": returns[1],
        "error_before": rms(4.0, ENDED),
        "error_adrift": max(e for t, e in errors[0] if stops[0] <= t < returns[1]),
        "error_restarted": rms(returns[1] + 5.0, RESET),
        "reset": RESET,
        "error_after_reset": found["rms_position_error"],
        "error_in_process": in_process(name, seed, 1, AFTER)["rms_position_error"],
    }


def main() -> int:
    """Run all, print, and write the results; 1 where means differ by more than the bar."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--controllers", nargs="+", default=["dob", "ppo"])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("docs/_static/ros2/results.json"))
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    rows = compared(given.controllers, given.seeds)
    summary = [summarised(rows, name) for name in given.controllers]
    stopped = [interrupted(name, 4) for name in given.controllers]
    apart = max(
        abs(x) for one in summary for way in ("lockstep", "real time") for x in one[way]["difference_of_means"].values()
    )
    print(*(json.dumps(one, indent=1, default=float) for one in summary), sep="\n")
    for one in stopped:
        print(one)
    print(f"means differ from in process by at most {100.0 * apart:.2g} %, bar {100.0 * BAR:g} %")
    arguments = {"env": ENV, "seconds": SECONDS, "controllers": given.controllers, "seeds": given.seeds}
    write_json(
        given.out,
        {
            "circumstances": circumstances("tests/bench/ros2.py", arguments),
            "summary": summary,
            "interrupted": stopped,
            "episodes": rows,
        },
    )
    return int(apart > BAR)


if __name__ == "__main__":
    sys.exit(main())
