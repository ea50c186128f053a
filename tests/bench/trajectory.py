"""Time of an iteration of `optimize_trajectory`, one problem, one thread: python tests/bench/trajectory.py [SCENE ...].

The median over problems of the processor's time of a call, minus the time of a call without iterations, over the
iterations.
With --crocoddyl beside FDDP of Crocoddyl, one problem after the other, without water: the same bodies, weights and
inputs (wrench and joint torques), from the inputs that hold the vehicle. Crocoddyl 3.2.1 from PyPI runs with pin 4.0.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from uvms_gym import Simulator, load_scene, optimize_trajectory
from uvms_gym._scene import joints as joints_of
from uvms_gym.studies.speed.rigid_bodies import dry

PROBLEMS, PERIODS, PERIOD, MOST, TOLERANCE = 20, 20, 0.1, 100, 1e-9
WEIGHTS = {"position": 1.0, "attitude": 1.0, "end_effector": 10.0, "twist": 1.0, "qd": 0.1}
FORCE, TORQUE = 1e-3, 1e-5

#: Processor's time of this thread, s, and iterations made, for a target of the end effector.
Solve = Callable[[np.ndarray], tuple[float, int]]


def ours(sim: Simulator, force: str, substeps: int, iterations: int = MOST) -> Solve:
    """Problems of `optimize_trajectory`, with `force` and joint torques."""
    weights = {force: FORCE} | ({"joint_torque": TORQUE} if sim.num_joints else {})
    trim = sim.trim()
    hold: dict[str, Any] = {name: trim[name][0] for name in weights} if force == "wrench" else {}

    def solve(target: np.ndarray) -> tuple[float, int]:
        start = time.thread_time()
        plan = optimize_trajectory(
            sim,
            horizon=PERIODS,
            substeps=substeps,
            weights=WEIGHTS,
            references={"end_effector": target} | hold,
            input_weights=weights,
            max_iterations=iterations,
            tolerance=TOLERANCE,
        )
        return time.thread_time() - start, len(plan.costs[0]) - 1

    return solve


def crocoddyl(sim: Simulator, integrator: str) -> Solve:
    """Problems of Crocoddyl's FDDP on the same bodies, a step a knot; building them is not timed."""
    import crocoddyl
    import pinocchio as pin

    from uvms_gym.studies.speed import pinocchio_model

    joints, trim = sim.num_joints, sim.trim()
    hold = np.concatenate([trim["wrench"][0], trim["joint_torque"][0]])
    model = pinocchio_model.build(sim.scene)
    place, data, last = np.concatenate([np.zeros(6), [1.0], sim.q[0]]), model.createData(), model.njoints - 1
    pin.forwardKinematics(model, data, place)
    pose = sim.end_effector_pose()[0]
    offset = data.oMi[last].inverse() * pin.SE3(pose[:3, :3], pose[:3, 3])
    frame = model.addFrame(pin.Frame("end effector", last, 0, offset, pin.OP_FRAME))
    start = np.concatenate([place, np.zeros(6 + joints)])
    state = crocoddyl.StateMultibody(model)
    actuation = crocoddyl.ActuationModelFull(state)
    of_state = np.concatenate([np.ones(6), np.zeros(joints), np.ones(6), np.full(joints, WEIGHTS["qd"])])
    of_input = np.concatenate([np.full(6, FORCE), np.full(joints, TORQUE)])

    def knot(target: np.ndarray, last: bool) -> Any:
        costs = crocoddyl.CostModelSum(state, actuation.nu)
        # Costs of a knot are multiplied by its duration.
        scale = 1.0 if last else 1.0 / PERIOD

        def add(name: str, residual: Any, weights: np.ndarray) -> None:
            activation = crocoddyl.ActivationModelWeightedQuad(weights)
            costs.addCost(name, crocoddyl.CostModelResidual(state, activation, residual), scale)

        add("state", crocoddyl.ResidualModelState(state, start, actuation.nu), of_state)
        reach = crocoddyl.ResidualModelFrameTranslation(state, frame, target, actuation.nu)
        add("end effector", reach, np.full(3, WEIGHTS["end_effector"]))
        if not last:
            add("input", crocoddyl.ResidualModelControl(state, hold), of_input)
        motion = crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, costs)
        if last or integrator == "Euler":
            return crocoddyl.IntegratedActionModelEuler(motion, 0.0 if last else PERIOD)
        return crocoddyl.IntegratedActionModelRK(motion, crocoddyl.RKType.four, PERIOD)

    def solve(target: np.ndarray) -> tuple[float, int]:
        problem = crocoddyl.ShootingProblem(start, [knot(target, False)] * PERIODS, knot(target, True))
        problem.nthreads = 1
        inputs = [hold] * PERIODS
        states = problem.rollout(inputs)
        solver = crocoddyl.SolverFDDP(problem)
        solver.th_stop = TOLERANCE
        begun = time.thread_time()
        if not solver.solve(states, inputs, MOST, True):
            raise RuntimeError("FDDP has not converged")
        return time.thread_time() - begun, solver.iter + 1

    return solve


def against_crocoddyl(scene: str) -> None:
    """Print times of an iteration of both."""
    vacuum = dry(load_scene(scene))
    for joint in joints_of(vacuum):
        # Pinocchio has none.
        joint["friction"] = {"viscous": 0.0}
    sim, euler = (Simulator(vacuum, dt=PERIOD, integrator=name, threads=1) for name in ("mk4", "semi-implicit-euler"))
    without, solves = ours(sim, "wrench", 1, 0), {"ours, MK4": ours(sim, "wrench", 1)}
    solves["ours, Euler"] = ours(euler, "wrench", 1)
    solves |= {f"Crocoddyl, {name}": crocoddyl(sim, name) for name in ("RK4", "Euler")}
    home, rng = sim.end_effector_pose()[0, :3, 3], np.random.default_rng(0)
    times: dict[str, list[float]] = {name: [] for name in solves}
    counts: dict[str, list[int]] = {name: [] for name in solves}
    for _ in range(PROBLEMS):
        target = home + 0.2 * rng.normal(size=3)
        for name, solve in solves.items():
            # Of three, the minimum disturbed by other load.
            spent, count = min(solve(target) for _ in range(3))
            fixed = min(without(target)[0] for _ in range(3)) if name.startswith("ours") else 0.0
            times[name].append((spent - fixed) / count)
            counts[name].append(count)
    first = statistics.median(times["ours, MK4"])
    for name, found in times.items():
        iteration = statistics.median(found)
        cells = f"{statistics.median(counts[name]):11.0f} {1e3 * iteration:14.2f} {iteration / first:10.2f}"
        print(f"{scene + ', dry':<28}{name:<18}{cells}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="*", default=["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy"])
    parser.add_argument("--crocoddyl", action="store_true")
    options = parser.parse_args()
    if options.crocoddyl:
        print("scene                       program            iterations  iteration, ms  times ours")
        for scene in options.scene:
            against_crocoddyl(scene)
        return
    print("scene                   substeps  state  inputs  iterations  without, ms  iteration, ms")
    rng = np.random.default_rng(0)
    for scene in options.scene:
        for substeps in (1, 2, 5):
            sim = Simulator(scene, dt=PERIOD / substeps, threads=1)
            home, times, none, counts = sim.end_effector_pose()[0, :3, 3], [], [], []
            for _ in range(PROBLEMS):
                target = home + 0.2 * rng.normal(size=3)
                without, _ = ours(sim, "thrust", substeps, 0)(target)
                whole, count = ours(sim, "thrust", substeps)(target)
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
