"""Time of an iteration of `optimize_trajectory`, one problem, one thread: python tests/bench/trajectory.py.

The median over problems of the processor's time of a call, less that of a call without iterations, over the iterations.
"""

import statistics
import sys
import time
from typing import Any

import numpy as np

from uvms_gym import Simulator, optimize_trajectory

PROBLEMS, PERIODS, PERIOD = 20, 20, 0.1


def seconds(sim: Simulator, target: np.ndarray, iterations: int, substeps: int) -> tuple[float, int]:
    """Time of this thread's processor, s, and iterations made."""
    inputs: dict[str, Any] = {"thrust": 1e-3} | ({"joint_torque": 1e-5} if sim.num_joints else {})
    start = time.thread_time()
    plan = optimize_trajectory(
        sim,
        horizon=PERIODS,
        substeps=substeps,
        weights={"position": 1.0, "attitude": 1.0, "end_effector": 10.0, "twist": 1.0, "qd": 0.1},
        references={"end_effector": target},
        input_weights=inputs,
        max_iterations=iterations,
        tolerance=1e-9,
    )
    return time.thread_time() - start, len(plan.costs[0]) - 1


def main() -> None:
    """Print the table."""
    print("scene                   substeps  state  inputs  iterations  without, ms  iteration, ms")
    rng = np.random.default_rng(0)
    for scene in sys.argv[1:] or ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy"]:
        for substeps in (1, 2, 5):
            sim = Simulator(scene, dt=PERIOD / substeps, threads=1)
            home, times, none, counts = sim.end_effector_pose()[0, :3, 3], [], [], []
            for _ in range(PROBLEMS):
                target = home + 0.2 * rng.normal(size=3)
                without, _ = seconds(sim, target, 0, substeps)
                whole, count = seconds(sim, target, 100, substeps)
                none.append(without)
                counts.append(count)
                times.append((whole - without) / count)
            width = sim.num_thrusters + sim.num_joints
            without, iteration = (1e3 * statistics.median(column) for column in (none, times))
            count = statistics.median(counts)
            row = f"{substeps:8} {sim.state_size:6} {width:7} {count:11.0f} {without:12.2f} {iteration:14.2f}"
            print(f"{scene:<24}{row}")


if __name__ == "__main__":
    main()
