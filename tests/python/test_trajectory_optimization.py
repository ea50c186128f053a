"""Trajectory optimisation: optima of an interior-point solver, the laws of the linear case, bounds and batches."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uvms_gym import Simulator, Trajectory, load_scene, optimize_trajectory

GOLDEN = json.loads((Path(__file__).parents[1] / "golden" / "optimal_control.json").read_text())["problems"]
#: Point to point against drag, with thrusts at their limits.
MOVE: dict[str, Any] = {
    "horizon": 12,
    "substeps": 2,
    "references": {"position": [1.0, 0.3, -0.2]},
    "weights": {"position": 50.0, "attitude": 20.0, "twist": 1.0},
    "input_weights": {"thrust": 1e-3},
}


def plan_golden(problem: dict[str, Any], **options: Any) -> Trajectory:
    sim = Simulator(problem["scene"], dt=problem["dt"])
    names = ("horizon", "substeps", "references", "weights", "terminal_weights", "input_weights", "bounds")
    return optimize_trajectory(sim, **{name: problem[name] for name in names}, **options)


@pytest.mark.parametrize("problem", GOLDEN, ids=lambda problem: problem["name"])
def test_val_optima_match_ipopt_to_1e_6(problem: dict[str, Any]) -> None:
    plan = plan_golden(problem, tolerance=1e-15, max_iterations=300)
    found, expected = np.concatenate([*plan.inputs.values()], axis=-1)[0], np.array(problem["inputs"])
    lower, upper = (np.concatenate([bound[side] for bound in problem["bounds"].values()]) for side in (0, 1))
    assert plan.converged[0]
    assert plan.cost[0] == pytest.approx(problem["cost"], rel=1e-9)
    assert np.abs(found - expected).max() < 1e-6 * upper.max()
    # Bounds hold exactly, and matter; bounds of actuators are met up to a rounding.
    assert ((lower <= found) & (found <= upper)).all()
    active = (found <= np.nextafter(lower, np.inf)) | (found >= np.nextafter(upper, -np.inf))
    assert 0.01 < active[:, lower < upper].mean() < 0.9
    # A coarse tolerance gives another answer.
    coarse = np.concatenate([*plan_golden(problem, tolerance=1e-2).inputs.values()], axis=-1)[0]
    assert np.abs(coarse - expected).max() > 1e-5 * upper.max()


def riccati(sim: Simulator, horizon: int, q: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gains (K, w, s) of the linear-quadratic regulator of the step, and its cost matrix."""
    jacobians = sim.step_jacobians(wrench=np.zeros(6), substeps=2)
    a, b = jacobians["state"][0], jacobians["wrench"][0]
    p, gains = q, []
    for _ in range(horizon):
        gain = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
        p = q + a.T @ p @ (a - b @ gain)
        gains.append(-gain)
    return np.array(gains[::-1]), p


def test_optima_are_stationary_under_weights_that_differ_by_axis() -> None:
    # Only such weights couple the position's error, in body axes, with the attitude.
    sim = Simulator("free-body", dt=0.05)
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    problem: dict[str, Any] = {
        "horizon": 10,
        "substeps": 2,
        "references": {"position": [1.0, 0.5, -0.3], "rotation": turned},
        "weights": {"position": [1.0, 20.0, 5.0], "attitude": [2.0, 0.5, 1.0], "twist": 0.1},
        "input_weights": {"wrench": 0.01},
    }
    plan = optimize_trajectory(sim, tolerance=1e-15, max_iterations=300, **problem)
    assert plan.converged[0]
    change = 1e-3 * np.random.default_rng(0).normal(size=plan.inputs["wrench"].shape)

    def cost(sign: int) -> float:
        initial = {"wrench": plan.inputs["wrench"] + sign * change}
        return float(optimize_trajectory(sim, initial=initial, max_iterations=0, **problem).cost[0])

    assert abs(cost(1) - cost(-1)) < 1e-3 * (cost(1) + cost(-1) - 2.0 * plan.cost[0])


def test_one_iteration_of_a_linear_problem_is_the_discrete_riccati_recursion() -> None:
    sim = Simulator("free-body", dt=0.05)
    weights = {"position": 2.0, "attitude": 4.0, "twist": 0.5}
    problem: dict[str, Any] = {"horizon": 15, "substeps": 2, "weights": weights, "input_weights": {"wrench": 0.1}}
    gains, p = riccati(sim, 15, np.diag([2.0] * 3 + [4.0] * 3 + [0.5] * 6), 0.1 * np.eye(6))
    # Translations of a level body are linear, where weights are the same along all axes.
    start = np.array([0.3, -0.2, 0.5])
    sim.set_state(position=start)
    plan = optimize_trajectory(sim, references={"position": [0.0] * 3}, **problem)
    assert len(plan.costs[0]) == 2 and plan.converged[0]
    assert plan.cost[0] == pytest.approx(0.5 * start @ p[:3, :3] @ start, rel=1e-12)
    sim.reset()
    rest = optimize_trajectory(sim, **problem)
    assert np.abs(rest.gains[0] - gains).max() < 1e-12 * np.abs(gains).max()
    # Rotations are not.
    turned = {"rotation": [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "position": start}
    assert len(optimize_trajectory(sim, references=turned, tolerance=1e-12, **problem).costs[0]) > 2


@pytest.mark.parametrize("lag", [0.0, 0.15])
def test_a_plan_is_the_simulator_s_motion_and_costs_decrease(lag: float) -> None:
    scene = load_scene("petasus-pum")
    for thruster in scene["vehicle"]["thrusters"]:
        thruster["lag"] = lag
    sim = Simulator(scene, dt=0.05)
    weights = {"end_effector": 100.0, "twist": 1.0, "qd": 0.1, "attitude": 1.0}
    inputs = {"thrust": 1e-4, "joint_torque": 1e-5}
    target = sim.end_effector_pose()[0, :3, 3] + [0.1, 0.05, -0.1]
    plan = optimize_trajectory(
        sim,
        horizon=10,
        substeps=2,
        weights=weights,
        input_weights=inputs,
        references={"end_effector": target},
        tolerance=1e-4,
    )
    assert plan.converged[0] and (np.diff(plan.costs[0]) < 0).all()
    assert np.linalg.norm(plan.end_effector[0, -1] - target) < 0.5 * np.linalg.norm(plan.end_effector[0, 0] - target)
    for knot in range(10):
        assert plan.q[0, knot].tobytes() == sim.q[0].tobytes()
        sim.step(substeps=2, **{name: values[:, knot] for name, values in plan.inputs.items()})
    assert plan.position[0, -1].tobytes() == sim.position[0].tobytes()
    assert plan.twist[0, -1].tobytes() == sim.twist[0].tobytes()
    assert np.abs(plan.end_effector[0, -1] - sim.end_effector_pose()[0, :3, 3]).max() < 1e-12


def test_results_do_not_depend_on_the_batch_and_its_threads() -> None:
    positions = np.random.default_rng(0).normal(size=(5, 3))

    def plan(which: slice, threads: int) -> Trajectory:
        sim = Simulator("bluerov2-heavy", len(positions[which]), dt=0.05, threads=threads)
        sim.set_state(position=positions[which], current=[0.2, 0.0, 0.0])
        sim.scale_parameters(mass=1.0 + 0.1 * positions[which, 0])
        return optimize_trajectory(sim, **MOVE)

    one, two = plan(slice(None), 1), plan(slice(None), 2)
    assert len(set(one.cost)) == 5
    for k in range(5):
        single = plan(slice(k, k + 1), 1)
        for other, row in ((two, k), (single, 0)):
            assert other.inputs["thrust"][row].tobytes() == one.inputs["thrust"][k].tobytes()
            assert other.gains[row].tobytes() == one.gains[k].tobytes()
            assert other.costs[row].tobytes() == one.costs[k].tobytes()


def test_a_warm_start_at_the_optimum_stays_there() -> None:
    sim = Simulator("bluerov2-heavy", dt=0.05)
    before = sim.__getstate__()
    cold = optimize_trajectory(sim, **MOVE)
    warm = optimize_trajectory(sim, initial=cold.inputs, **MOVE)
    assert len(cold.costs[0]) > 2 and len(warm.costs[0]) == 1
    assert warm.inputs["thrust"].tobytes() == cold.inputs["thrust"].tobytes()
    assert np.array_equal(sim.__getstate__(), before)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"horizon": 0}, "horizon must be at least 1, not 0"),
        ({"substeps": 0}, "substeps must be at least 1, not 0"),
        ({"input_weights": {}}, "inputs is empty: name at least one of thrust, wrench"),
        (
            {"input_weights": {"fin": 1.0}},
            "inputs: 'fin' is not an input of scene 'bluerov2-heavy', which has: thrust, wrench",
        ),
        (
            {"input_weights": {"thrust": 0.0}},
            "input weights of problem 0, knot 0, entry 0, is 0, but must be finite and",
        ),
        ({"weights": {"pose": 1.0}}, "weights: no quantity 'pose' in this call: position, attitude"),
        (
            {"weights": {"position": -1.0}},
            "weights of problem 0, knot 0, entry 0, is -1, but must be finite and at least",
        ),
        ({"references": {"position": [0.0, np.nan, 0.0]}}, "references of problem 0, knot 0, entry 1, is NaN"),
        (
            {"references": {"position": [0.0, 0.0]}},
            r"\['position'\] has shape \(2,\), but must broadcast to \(1, 13, 3\)",
        ),
        ({"references": {"rotation": np.diag([1.0, 1.0, -1.0])}}, r"\['rotation'\] of problem 0, knot 0, is not a rot"),
        ({"bounds": {"thrust": (5.0, -5.0)}}, "bounds of thrust of problem 0, knot 0, entry 0: 5 is not below -5"),
        ({"bounds": {"thrust": (100.0, 200.0)}}, "bounds of thrust of problem 0, knot 0, entry 0: 100 is not below 51"),
        ({"bounds": {"wrench": (-1.0, 1.0)}}, "bounds: no quantity 'wrench' in this call: thrust"),
        ({"initial": {"thrust": np.zeros((3, 8))}}, r"initial\['thrust'\] has shape \(3, 8\)"),
    ],
)
def test_invalid_problems_are_refused(options: dict[str, Any], message: str) -> None:
    sim = Simulator("bluerov2-heavy", dt=0.05)
    with pytest.raises(ValueError, match=message) as caught:
        optimize_trajectory(sim, **MOVE | options)
    assert "\n" not in str(caught.value)


def test_motions_that_are_not_finite_and_single_precision_are_refused() -> None:
    with pytest.raises(ValueError, match="problem 0: the motion under its initial inputs is not finite"):
        optimize_trajectory(Simulator("bluerov2-heavy", dt=5.0), initial={"thrust": 40.0}, **MOVE | {"substeps": 20})
    with pytest.raises(ValueError, match="dtype='float64'"):
        optimize_trajectory(Simulator("bluerov2-heavy", dtype="float32"), **MOVE)
