"""Trajectory optimisation on the steps of a simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym import _core
from uvms_gym._task.arguments import refuse_masked

Floats: TypeAlias = NDArray[np.float64]
Arrays: TypeAlias = Mapping[str, ArrayLike]

#: Inputs that can be chosen, in the order of the columns of the gains.
_INPUTS = ("thrust", "fin", "wrench", "joint_torque", "joint_target")


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Optimal trajectories of N problems over K control periods.

    Attributes
    ----------
    inputs : dict of str to numpy.ndarray (N, K, w)
        Inputs held over each period, by name.
    position : numpy.ndarray (N, K + 1, 3)
        Vehicle origin in the world, m.
    rotation : numpy.ndarray (N, K + 1, 3, 3)
        Body to world.
    q : numpy.ndarray (N, K + 1, n)
        Joint coordinates, rad or m.
    twist : numpy.ndarray (N, K + 1, 6)
        Absolute body twist [v; omega], m/s and rad/s.
    qd : numpy.ndarray (N, K + 1, n)
        Joint rates, rad/s or m/s.
    end_effector : numpy.ndarray (N, K + 1, 3)
        End effector in the world, m.
    gains : numpy.ndarray (N, K, w, s)
        Feedback of the inputs, in the order of `inputs`, on the deviation of the state in coordinates of
        `step_jacobians`, as a time-varying linear-quadratic regulator; 0 for inputs on a bound.
    costs : list of numpy.ndarray (iterations + 1,)
        Costs of each problem, first of the initial inputs.
    converged : numpy.ndarray (N,), bool
        True where the iterations have converged.
    decrement : numpy.ndarray (N,)
        Decrease of the cost expected of another iteration, over the cost.
    """

    inputs: dict[str, Floats]
    position: Floats
    rotation: Floats
    q: Floats
    twist: Floats
    qd: Floats
    end_effector: Floats
    gains: Floats
    costs: list[Floats]
    converged: NDArray[np.bool_]
    decrement: Floats

    def __repr__(self) -> str:
        n, periods = self.position.shape[0], self.position.shape[1] - 1
        inputs, over = ", ".join(self.inputs), int(np.count_nonzero(self.converged))
        return f"Trajectory({n} problems, {periods} control periods, {inputs}; {over} converged)"

    @property
    def cost(self) -> Floats:
        """Cost of the trajectories (N,)."""
        return np.array([costs[-1] for costs in self.costs])


def optimize_trajectory(
    simulator: _core.Simulator,
    *,
    horizon: int,
    substeps: int = 1,
    weights: Arrays,
    input_weights: Arrays,
    terminal_weights: Arrays | None = None,
    references: Arrays | None = None,
    bounds: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
    initial: Arrays | None = None,
    max_iterations: int = 100,
    tolerance: float = 1e-9,
) -> Trajectory:
    """Minimise a quadratic tracking cost over the inputs of K control periods, from the simulator's present states.

    The motion follows `simulator.step`, whatever its integrator, with the exact derivatives of `step_jacobians`.
    The simulator is not stepped. With N instances there are N independent problems: the result of each has the same
    bits whatever N and `threads` are.

    The cost is half the sum over knots of weight times squared difference: of the pose error [R^T (r - r_d);
    log(R_d^T R)], q, twist, q' and end effector from their references at knots 0 to K, and of the inputs from theirs
    in periods 0 to K - 1. The method is iterative LQR with box constraints on the inputs: a backward pass with a
    projected Newton method at each knot, the cost's Gauss-Newton Hessian, Levenberg-Marquardt damping of the inputs'
    Hessian, and a line search that accepts decreases of the cost alone. [TET12, TMT14] See
    docs/trajectory-optimization.md.

    Arrays have shape (w,), (K, w) or (N, K, w), with K + 1 in place of K for states, or any that broadcasts to
    the last; a number holds for all.

    Parameters
    ----------
    simulator : Simulator
        N instances, of dtype float64.
    horizon : int
        Control periods K.
    substeps : int
        Steps of `dt` in each, over which inputs are held.
    weights : dict of array_like
        Weights >= 0: "position" (3) in 1/m2, body axes; "attitude" (3) in 1/rad2; "q" (n); "twist" (6); "qd" (n);
        "end_effector" (3) in 1/m2, world axes. Absent ones are 0.
    input_weights : dict of array_like
        Weights > 0 of the inputs to choose: "thrust" (m), "fin" (k), "wrench" (6), "joint_torque" (n), "joint_target"
        (n). Other inputs are not given.
    terminal_weights : dict of array_like, optional
        Weights (w,) or (N, 1, w) of the last knot, in place of `weights`.
    references : dict of array_like, optional
        "position" (3), "rotation" (3, 3), "q", "twist", "qd", "end_effector", and inputs. By default the pose, q and
        end effector of the start, and for joint targets q; 0 for the rest.
    bounds : dict of (array_like, array_like), optional
        Minimum and maximum value of inputs. Limits of thrusters, fins and joint efforts also apply, less one rounding:
        an input at its limit has no derivative.
    initial : dict of array_like, optional
        Inputs to start from, moved into bounds; their references by default.
    max_iterations : int
        Maximum number of iterations.
    tolerance : float
        Expected decrease of the cost, over the cost, at which a problem has converged. The inputs' error is about its
        root.

    Returns
    -------
    Trajectory

    Raises
    ------
    ValueError
        A name is unknown, a shape, weight, bound or rotation is wrong; the motion under the initial inputs is not
        finite, or its cost or derivatives are not; the simulator has no derivatives of steps.
    MemoryError
        The trajectories do not fit into memory.

    Examples
    --------
    >>> import uvms_gym
    >>> sim = uvms_gym.Simulator("bluerov2-heavy", dt=0.05)
    >>> plan = uvms_gym.optimize_trajectory(
    ...     sim,
    ...     horizon=40,
    ...     substeps=2,
    ...     references={"position": [0.5, 0.0, 0.2]},
    ...     weights={"position": 10.0, "attitude": 10.0, "twist": 1.0},
    ...     input_weights={"thrust": 1e-4},
    ... )
    """
    for name, count, minimum in (
        ("horizon", horizon, 1),
        ("substeps", substeps, 1),
        ("max_iterations", max_iterations, 0),
    ):
        if count < minimum:
            raise ValueError(f"{name} must be at least {minimum}, not {count}")
    references, bounds, initial = references or {}, bounds or {}, initial or {}
    terminal_weights = terminal_weights or {}
    problems, joints = simulator.num_envs, simulator.num_joints
    names = sorted(input_weights, key=lambda name: _INPUTS.index(name) if name in _INPUTS else -1)
    widths = dict(zip(names, _core.trajectory_inputs(simulator, names), strict=True))
    rows = {"position": 3, "attitude": 3, "q": joints, "twist": 6, "qd": joints, "end_effector": 3}
    _known("weights", weights, rows)
    _known("terminal_weights", terminal_weights, rows)
    _known("bounds", bounds, widths)
    _known("initial", initial, widths)
    _known("references", references, {name: None for name in rows if name != "attitude"} | {"rotation": None} | widths)

    knots = (problems, horizon + 1)

    def of_states(argument: str, given: Arrays, name: str, default: Any, *row: int) -> Floats:
        return _broadcast(f"{argument}['{name}']", given.get(name, default), (*knots, *row)).reshape(*knots, -1)

    def of_inputs(argument: str, given: Arrays, default: Mapping[str, Any]) -> Floats:
        shapes = {name: (problems, horizon, width) for name, width in widths.items()}
        parts = [
            _broadcast(f"{argument}['{name}']", given.get(name, default.get(name, 0.0)), shape)
            for name, shape in shapes.items()
        ]
        return np.concatenate(parts, axis=-1) if parts else np.empty((problems, horizon, 0))

    state_weights = {name: of_states("weights", weights, name, 0.0, row) for name, row in rows.items()}
    for name, given in terminal_weights.items():
        state_weights[name][:, -1:] = _broadcast(f"terminal_weights['{name}']", given, (problems, 1, rows[name]))
    shapes = [
        ("position", simulator.position[:, None], (3,)),
        ("rotation", simulator.rotation[:, None], (3, 3)),
        ("q", simulator.q[:, None], (joints,)),
        ("twist", 0.0, (6,)),
        ("qd", 0.0, (joints,)),
        ("end_effector", simulator.end_effector_pose()[:, None, :3, 3], (3,)),
    ]
    states = {name: of_states("references", references, name, default, *row) for name, default, row in shapes}
    _check_rotations(states["rotation"].reshape(*knots, 3, 3))
    targets = of_inputs("references", references, {"joint_target": simulator.q[:, None]})
    start = of_inputs("initial", initial, dict(zip(names, _split(targets, widths), strict=True)))
    lower, upper = (
        of_inputs("bounds", {name: pair[side] for name, pair in bounds.items()}, dict.fromkeys(names, limit))
        for side, limit in enumerate((-np.inf, np.inf))
    )
    arrays = {
        "references": np.concatenate(list(states.values()), axis=-1),
        "weights": np.concatenate(list(state_weights.values()), axis=-1),
        "input_references": targets,
        "input_weights": of_inputs("input_weights", input_weights, {}),
        "lower": lower,
        "upper": upper,
        "start": start,
    }
    found = _core.optimize_trajectory(
        simulator,
        names,
        arrays,
        horizon=horizon,
        substeps=substeps,
        iterations=max_iterations,
        tolerance=tolerance,
    )
    inputs = dict(zip(names, _split(found.pop("inputs"), widths), strict=True))
    return Trajectory(inputs=inputs, **found)


def _known(argument: str, given: Mapping[str, Any], known: Mapping[str, Any]) -> None:
    for name in given:
        if name not in known:
            raise ValueError(f"{argument}: no quantity '{name}' in this call: {', '.join(known)}")


def _broadcast(name: str, given: ArrayLike, shape: tuple[int, ...]) -> Floats:
    """Array of `shape`, a copy."""
    refuse_masked(name, given)
    array = np.asarray(given, dtype=np.float64)
    try:
        return np.broadcast_to(array, shape).copy()
    except ValueError:
        raise ValueError(f"{name} has shape {array.shape}, but must broadcast to {shape}") from None


def _split(array: Floats, widths: Mapping[str, int]) -> list[Floats]:
    return np.split(array, np.cumsum(list(widths.values()))[:-1], axis=-1) if widths else []


def _check_rotations(rotations: Floats) -> None:
    deviation = np.abs(np.swapaxes(rotations, -1, -2) @ rotations - np.eye(3)).max(axis=(-1, -2))
    wrong = np.argwhere(~((deviation <= 1e-6) & (np.linalg.det(rotations) > 0.0)))
    if len(wrong):
        problem, knot = wrong[0]
        raise ValueError(f"references['rotation'] of problem {problem}, knot {knot}, is not a rotation")
