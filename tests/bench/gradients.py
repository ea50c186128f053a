"""Time of the derivatives of a step over the time of the step, one thread: python tests/bench/gradients.py.

In turns, the minimum time of the processor: a call of one step; a step in a call of 20; the same for 64
instances.
"""

import sys
import time
from collections.abc import Callable

import numpy as np

from uvms_gym import Simulator

ROUNDS = 300


def seconds(call: Callable[[], object]) -> float:
    """Time of this thread's processor in a call, s."""
    start = time.thread_time()
    call()
    return time.thread_time() - start


def minimum(scene: str, integrator: str, substeps: int, num_envs: int = 1) -> tuple[list[float], int]:
    """Minimum times of a step, its Jacobians and its products, s per instance; the number of columns."""
    step, differentiated = (
        Simulator(scene, num_envs, integrator=integrator, threads=1, error_estimate=False) for _ in range(2)
    )
    inputs = {
        "thrust": np.full(step.num_thrusters, 5.0),
        "joint_torque": np.zeros(step.num_joints),
        "substeps": substeps,
    }
    row = np.ones(step.state_size)
    calls: list[Callable[[], object]] = [
        lambda: step.step(**inputs),
        lambda: differentiated.step_jacobians(**inputs),
        lambda: differentiated.step_vjp(row, **inputs),
        lambda: differentiated.step_jvp({"state": row}, **inputs),
    ]
    columns = sum(jacobian.shape[2] for jacobian in differentiated.step_jacobians(**inputs).values())
    times = [[seconds(call) for call in calls] for _ in range(max(ROUNDS // num_envs, 30))]
    return [min(column) / substeps / num_envs for column in zip(*times, strict=True)], columns


def main() -> None:
    """Print the table."""
    print("scene                   integrator  columns  N   steps   step, us  Jacobians, us  over it    VJP    JVP")
    for scene in sys.argv[1:] or ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy"]:
        for integrator in ("mk4", "ros2", "mk54"):
            for substeps, num_envs in ((1, 1), (20, 1), (20, 64)):
                (step, *others), columns = minimum(scene, integrator, substeps, num_envs)
                times = f"{1e6 * step:10.2f}  {1e6 * others[0]:13.1f}" + "".join(f"{x / step:8.1f}" for x in others)
                print(f"{scene:<24}{integrator:<12}{columns:7} {num_envs:3} {substeps:6} {times}")


if __name__ == "__main__":
    main()
