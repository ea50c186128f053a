"""Time of the Jacobians of a step over that of the step, one instance and one thread: python tests/bench/gradients.py.

Both in turns, medians. A call of one step, and a step of a call of 20.
"""

import statistics
import sys
import time
from collections.abc import Callable

import numpy as np

from uvms_gym import Simulator

ROUNDS = 300


def seconds(call: Callable[[], object]) -> float:
    """Duration of a call, s."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def ratio(scene: str, integrator: str, substeps: int) -> tuple[float, float, int]:
    """Medians of the time of a step and of its Jacobians, s, and the number of columns."""
    step, differentiated = (Simulator(scene, integrator=integrator, threads=1) for _ in range(2))
    inputs = {
        "thrust": np.full(step.num_thrusters, 5.0),
        "joint_torque": np.zeros(step.num_joints),
        "substeps": substeps,
    }
    plain, jacobians = [], []
    columns = sum(jacobian.shape[2] for jacobian in differentiated.step_jacobians(**inputs).values())
    for _ in range(ROUNDS):
        plain.append(seconds(lambda: step.step(**inputs)))
        jacobians.append(seconds(lambda: differentiated.step_jacobians(**inputs)))
    return statistics.median(plain) / substeps, statistics.median(jacobians) / substeps, columns


def main() -> None:
    """Print the table."""
    print("scene                   integrator  columns  steps a call   step, us  Jacobians, us  ratio")
    for scene in sys.argv[1:] or ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy"]:
        for integrator in ("mk4", "ros2"):
            for substeps in (1, 20):
                plain, jacobians, columns = ratio(scene, integrator, substeps)
                times = f"{1e6 * plain:10.2f}  {1e6 * jacobians:13.1f}  {jacobians / plain:5.1f}"
                print(f"{scene:<24}{integrator:<12}{columns:7}  {substeps:12} {times}")


if __name__ == "__main__":
    main()
