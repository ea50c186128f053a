"""Reach of the arm while the vehicle saves thrust: `optimize_trajectory` over both.

A picture needs Matplotlib.
"""

import sys

import numpy as np

from uvms_gym import Simulator, Trajectory, optimize_trajectory

OFFSET = [0.15, 0.1, -0.1]  # of the target from the end effector, m
PERIOD, PERIODS = 0.1, 20  # s; inputs are constant over a period


def plan(arm_weight: float) -> tuple[Trajectory, np.ndarray]:
    """Trajectory of minimum cost, and its target; `arm_weight` weighs the joints' deviation."""
    sim = Simulator("petasus-pum", dt=0.02)
    target = sim.end_effector_pose()[0, :3, 3] + OFFSET
    trajectory = optimize_trajectory(
        sim,
        horizon=PERIODS,
        substeps=round(PERIOD / sim.dt),
        weights={"end_effector": 10.0, "twist": 1.0, "qd": 0.1, "q": arm_weight},
        terminal_weights={"end_effector": 1e4, "twist": 100.0, "qd": 1.0},
        references={"end_effector": target},
        input_weights={"thrust": 1e-3, "joint_torque": 1e-4},
        tolerance=1e-4,
    )
    return trajectory, target


def picture(file: str, plans: dict[str, tuple[Trajectory, np.ndarray]]) -> None:
    """Distances of the end effector and sums of absolute thrusts over time."""
    from matplotlib import pyplot

    figure, (above, below) = pyplot.subplots(2, sharex=True, layout="constrained")
    time = PERIOD * np.arange(PERIODS + 1)
    for name, (trajectory, target) in plans.items():
        above.plot(time, np.linalg.norm(trajectory.end_effector[0] - target, axis=1), label=name)
        below.step(time[:-1], np.abs(trajectory.inputs["thrust"][0]).sum(axis=1), where="post")
    above.set_ylabel("distance, m")
    above.legend()
    below.set(xlabel="time, s", ylabel="sum of thrusts, N")
    figure.savefig(file)


def main(file: str | None = None) -> dict[str, tuple[float, float]]:
    """Print and return the last distance, m, and impulse of all thrusters, N s: arm free, held."""
    plans = {"vehicle and arm": plan(0.0), "vehicle, arm held": plan(1e4)}
    results = {}
    for name, (trajectory, target) in plans.items():
        distance = float(np.linalg.norm(trajectory.end_effector[0, -1] - target))
        impulse = float(PERIOD * np.abs(trajectory.inputs["thrust"]).sum())
        results[name] = distance, impulse
        iterations = len(trajectory.costs[0]) - 1
        print(f"{name:18} {1000 * distance:5.1f} mm {impulse:7.1f} N s, {iterations} iterations")
    if file is not None:
        picture(file, plans)
    return results


if __name__ == "__main__":
    main(*sys.argv[1:2])
