"""The step as a function of arrays, and its vector-Jacobian product: shared by the bindings to torch and JAX.

The state of an instance is one row: position (3), m; quaternion [w, x, y, z] (4), normalised first; q (n); absolute
body twist (6); q' (n); thrusts (m) of thrusters with dynamics, N. A target pose is a row of position and quaternion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from uvms_gym._core import Simulator
from uvms_gym._rotations import matrices, unit

Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Call:
    """Arguments of a step by their names, and all that it is not differentiated by."""

    simulator: Simulator
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    substeps: int

    @property
    def arguments(self) -> tuple[str, ...]:
        """Names of all arguments, the state first."""
        return ("state", *self.inputs, *self.parameters)

    def keywords(self, values: Sequence[Floats]) -> dict[str, Any]:
        """Inputs of `Simulator.step` from the values of the arguments."""
        inputs: dict[str, Any] = dict(zip(self.inputs, values[1 : 1 + len(self.inputs)], strict=True))
        if "pose_target" in inputs:
            pose = inputs["pose_target"]
            inputs["pose_target"] = (pose[:, :3], matrices(unit(pose[:, 3:])))
        return inputs


def row_shapes(simulator: Simulator) -> dict[str, tuple[int | None, ...]]:
    """Shape of each argument of one instance; None is any size from 1 to 4."""
    n = simulator.num_joints
    return {
        "state": (simulator.state_size + 1,),
        "thrust": (simulator.num_thrusters,),
        "wrench": (6,),
        "joint_torque": (n,),
        "joint_target": (n, None),
        "external": (n + 1, 6),
        "pose_target": (7,),
        "fin": (simulator.num_fins,),
    }


def shape_of(name: str, shape: Sequence[int], simulator: Simulator) -> tuple[int, ...]:
    """Shape of an argument of all instances, from that of one or of all; ValueError for another."""
    row = row_shapes(simulator).get(name, ())
    shape = tuple(shape)
    found = shape[1:] if len(shape) > len(row) else shape
    fits = len(found) == len(row) and all(1 <= x <= 4 if y is None else x == y for x, y in zip(found, row, strict=True))
    if not fits or (len(shape) > len(row) and shape[0] != simulator.num_envs):
        text = ", ".join("k <= 4" if x is None else str(x) for x in row)
        comma = "," if len(row) == 1 else ""
        all_rows = ", ".join(filter(None, (str(simulator.num_envs), text))) + ("," if not row else "")
        raise ValueError(f"{name} has shape {shape}, but must have ({text}{comma}) or ({all_rows})")
    return (simulator.num_envs, *found)


def state(simulator: Simulator) -> Floats:
    """Present states, (N, 13 + 2n) or (N, 13 + 2n + m)."""
    parts = [simulator.position, simulator.quaternion, simulator.q, simulator.twist, simulator.qd]
    if _has_thrusts(simulator):
        parts.append(simulator.thrust)
    return np.concatenate(parts, axis=1)


def run(call: Call, values: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Next states from the given ones, and a checkpoint (N, c) of the simulator before the step. It stays as it is."""
    simulator = call.simulator
    now = simulator.__getstate__()
    try:
        _set_state(simulator, values[0])
        if call.parameters:
            factors = values[1 + len(call.inputs) :]
            simulator.scale_parameters(**dict(zip(call.parameters, factors, strict=True)))
        checkpoint = simulator.__getstate__()
        simulator.step(**call.keywords(values), substeps=call.substeps)
        end = state(simulator)
    finally:
        simulator.__setstate__(now)
    # The quaternion is that of the two which continues the one before.
    end[:, 3:7] *= np.where(np.sum(end[:, 3:7] * values[0][:, 3:7], axis=1, keepdims=True) < 0, -1.0, 1.0)
    return end, checkpoint


def pull_back(call: Call, values: Sequence[Floats], end: Floats, checkpoint: Floats, cotangent: Floats) -> list[Floats]:
    """Cotangents of the arguments from that of the next states. The simulator stays as it is."""
    simulator = call.simulator
    now = simulator.__getstate__()
    turn = np.einsum("nji,nj->ni", _quaternion_rates(end[:, 3:7]), cotangent[:, 3:7])
    move = np.einsum("nji,nj->ni", matrices(unit(end[:, 3:7])), cotangent[:, :3])
    local = np.concatenate([move, turn, cotangent[:, 7:]], axis=1)
    simulator.__setstate__(checkpoint)
    try:
        found = simulator.step_vjp(local, **call.keywords(values), substeps=call.substeps, parameters=call.parameters)
    finally:
        simulator.__setstate__(now)
    gradients = [_of_pose(found["state"], values[0])]
    for name, value in zip(call.inputs, values[1:], strict=False):
        gradient = found[name]
        gradients.append(_of_pose(gradient, value) if name == "pose_target" else gradient.reshape(value.shape))
    return gradients + [np.ascontiguousarray(column) for column in found.get("parameters", np.empty((0, 0))).T]


def _set_state(simulator: Simulator, rows: Floats) -> None:
    n = simulator.num_joints
    parts = {
        "position": rows[:, :3],
        "quaternion": rows[:, 3:7],
        "q": rows[:, 7 : 7 + n],
        "qd": rows[:, 13 + n :][:, :n],
    }
    if not simulator.scene["vehicle"]["fixed"]:
        parts["twist"] = rows[:, 7 + n : 13 + n]
    if _has_thrusts(simulator):
        parts["thrust"] = rows[:, 13 + 2 * n :]
    simulator.set_state(**parts)


def _has_thrusts(simulator: Simulator) -> bool:
    return simulator.state_size > 12 + 2 * simulator.num_joints


def _of_pose(local: Floats, pose: Floats) -> Floats:
    """Cotangent by position and quaternion, in the first 7 columns, from that by the local coordinates of the pose."""
    quaternion = pose[:, 3:7]
    move = np.einsum("nij,nj->ni", matrices(unit(quaternion)), local[:, :3])
    # w = 4 E^T dq of a unit quaternion; changes of length do nothing.
    size = np.linalg.norm(quaternion, axis=1, keepdims=True)
    turn = 4.0 * np.einsum("nij,nj->ni", _quaternion_rates(quaternion / size), local[:, 3:6]) / size
    return np.concatenate([move, turn, local[:, 6:]], axis=1)


def _quaternion_rates(quaternion: Floats) -> Floats:
    """E (N, 4, 3) with q' = E omega, omega in body axes. [F21 eq. 2.86]"""
    w, x, y, z = quaternion.T
    return 0.5 * np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]).transpose(2, 0, 1)


def call_of(
    simulator: Simulator, inputs: Mapping[str, object], parameters: Mapping[str, object], substeps: int
) -> Call:
    """Call with these arguments; ValueError for an unknown one."""
    known = row_shapes(simulator).keys() - {"state"}
    if unknown := sorted(inputs.keys() - known):
        raise ValueError(f"no input '{unknown[0]}': one of {', '.join(sorted(known))}")
    if unknown := sorted(parameters.keys() - simulator.parameters.keys()):
        raise ValueError(f"no parameter '{unknown[0]}': one of {', '.join(simulator.parameters)}")
    return Call(simulator, tuple(inputs), tuple(parameters), substeps)
