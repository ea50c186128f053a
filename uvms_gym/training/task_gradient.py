"""Derivatives of a task's reward, observation and actuation by state and action, in NumPy: what all tasks share.

Formulas are those of the environment: tests compare rewards with those of episodes, and gradients of returns with
finite differences over episodes.
"""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from uvms_gym import ATTITUDE_LEVER
from uvms_gym._core import task_defaults
from uvms_gym.envs import TaskVectorEnv

Floats = NDArray[np.float64]

#: Pose error at which the linear part of the reward is 1, m.
COARSE = 0.3
#: Leak of the integral of the pose error, 1/s.
LEAK = 0.1


class TaskGradient(ABC):
    """Numbers of a task, and derivatives of its parts.

    The frame is that of the pose error: the vehicle or the end effector. Measured entries are the first w of an
    observation, in its scales: pose error, twist, where observed the direction against gravity, joint coordinates and
    rates. Forces (f,) are thrusts, and torques of joints where the action drives them.

    Parameters
    ----------
    envs : TaskVectorEnv
    posture : float
        Price of joint coordinates away from home, on top of the task's reward.

    Raises
    ------
    ValueError
        The environment has actions other than wrenches.
    """

    #: Number of entries of the direction against gravity.
    up = 0
    #: Observed entries of the reference, if any.
    reference = slice(0, 0)

    def __init__(self, envs: TaskVectorEnv, posture: float = 0.0) -> None:
        options: Any = envs.options
        if options.action != "wrench":
            raise ValueError(
                f"action is {options.action!r}, but must be 'wrench': no other has gradients of the return"
            )
        native = envs._native
        sim = envs.snapshot()
        self.joints, self.period = sim.num_joints, native.control_period
        #: Minimum and maximum age of measurements, control periods.
        self.ages = native.delays
        self.parts = {block.name: slice(block.offset, block.offset + block.length) for block in envs.layout}
        self.scales = np.concatenate([block.scale for block in envs.layout])
        #: Scales of measured entries.
        self.scale = self.scales[: 12 + self.up + 2 * self.joints]
        self.posture = posture
        self.coordinates = self.parts.get("joint_position", slice(0, 0))
        self.weights = {**task_defaults(envs.task)["reward"], **(options.reward or {})}
        #: I' = keep I + gain e, both as observed.
        self.keep = float(np.exp(-LEAK * self.period))
        self.gain = (1.0 - self.keep) / LEAK * self.scale[:6] / self.scales[self.parts["error_integral"]]
        self.limits = np.asarray(sim.thruster_limits)
        self.thrusters = len(self.limits)
        scales = np.array([block.scale[0] for block in envs.action_layout])
        #: Torques of an action of 1, N m or N.
        self.torques = scales[6:]
        most = np.abs(self.limits).max(axis=1)
        #: Maximum forces (f,).
        self.range = np.concatenate([most, self.torques])
        #: Thrusts (m, 6) of actions within the limits: those of minimum norm over their ranges, N.
        self.demand = most[:, None] * np.linalg.pinv(sim.thruster_configuration * most) * scales[:6]
        sim.reset()
        self.home = sim.q[0]

    def forces(self, actions: Floats) -> tuple[Floats, Floats]:
        """Forces (..., f) of clipped actions (..., a), N and N m, and their Jacobian (..., f, a).

        All thrusts are scaled down together where one would exceed its limit.
        """
        m, free = self.thrusters, actions[..., :6] @ self.demand.T
        limit = np.where(free > 0.0, self.limits[:, 1], self.limits[:, 0])
        ratio = free / limit
        excess = np.maximum(ratio.max(axis=-1, keepdims=True), 1.0)
        # Derivative of the excess.
        slope = np.where((ratio == excess) & (excess > 1.0), 1.0 / limit, 0.0) @ self.demand
        thrusts = np.clip(free / excess, *self.limits.T)
        jacobian = np.zeros((*actions.shape[:-1], len(self.range), actions.shape[-1]))
        jacobian[..., :m, :6] = (self.demand - thrusts[..., None] * slope[..., None, :]) / excess[..., None]
        jacobian[..., m:, 6:] = np.diag(self.torques)
        return np.concatenate([thrusts, actions[..., 6:] * self.torques], axis=-1), jacobian

    def rewards(self, perfect: Floats, actions: Floats) -> Floats:
        """Rewards (..., T) of perfect observations (..., T + 1, d) and actions (..., T, a), divergence aside."""
        weights, clipped = self.weights, np.clip(actions, -1.0, 1.0)
        pose = perfect[..., 1:, :6] * self.scale[:6]
        square = pose**2 @ _SQUARES
        cost = np.log1p(square / weights["pose_scale"] ** 2) + np.sqrt(square) / COARSE
        effort = ((self.forces(clipped)[0] / self.range) ** 2).mean(axis=-1)
        change = ((clipped - perfect[..., :-1, self.parts["previous_action"]]) ** 2).mean(axis=-1)
        return -weights["pose"] * cost - weights["effort"] * effort - weights["action_rate"] * change  # type: ignore[no-any-return]

    def by_pose(self, perfect: Floats) -> Floats:
        """Gradient (..., 6) of the reward by the observed pose error, from perfect observations (..., d)."""
        pose = perfect[..., :6] * self.scale[:6]
        square = (pose**2 * _SQUARES).sum(axis=-1, keepdims=True)
        slope = 1.0 / (self.weights["pose_scale"] ** 2 + square) + 0.5 / (COARSE * np.sqrt(square + 1e-12))
        return -2.0 * self.weights["pose"] * slope * _SQUARES * pose * self.scale[:6]  # type: ignore[no-any-return]

    def posture_costs(self, perfect: Tensor) -> Tensor:
        """Costs (..., T) of postures after each step, from perfect observations (..., T + 1, d)."""
        return self.posture * perfect[..., 1:, self.coordinates].square().sum(dim=-1)

    def by_posture(self, perfect: Floats) -> Floats:
        """Gradient (..., n) of the reward by observed joint coordinates, from perfect observations (..., d)."""
        return -2.0 * self.posture * perfect[..., self.coordinates]

    def by_force(self, forces: Floats) -> Floats:
        """Gradient (..., f) of the reward by forces (..., f), 1/N and 1/(N m)."""
        return -2.0 * self.weights["effort"] / len(self.range) * forces / self.range**2  # type: ignore[no-any-return]

    def by_change(self, change: Floats) -> Floats:
        """Gradient (..., a) of the reward by the change of the action (..., a)."""
        return -2.0 * self.weights["action_rate"] / change.shape[-1] * change  # type: ignore[no-any-return]

    def errors(self, perfect: Floats) -> Floats:
        """Jacobians (..., 6, 6) of observed pose errors by the frame's motion, from perfect observations (..., d)."""
        return error_jacobian(perfect[..., :6] * self.scale[:6]) / self.scale[:6, None]  # type: ignore[no-any-return]

    def states(self, perfect: Floats) -> dict[str, Floats]:
        """Arguments of `Simulator.set_state` of perfect observations (..., d)."""
        n, scaled = self.joints, perfect[..., : len(self.scale)] * self.scale
        states = {"twist": scaled[..., 6:12]}
        if n:
            states |= {"q": self.home + scaled[..., -2 * n : -n], "qd": scaled[..., -n:]}
        return states

    @abstractmethod
    def inputs(self, forces: Floats, state: dict[str, Floats]) -> dict[str, Any]:
        """Inputs of the step under forces (b, f) from a state."""

    @abstractmethod
    def geometry(self, perfect: Floats) -> tuple[Floats, Floats]:
        """Jacobians of the frame, from perfect observations.

        Those (..., 6 + k, 6) of pose errors and of k entries of the reference by the frame's motion, with measured
        errors those of the present; and those (..., 6, 6 + n) of this by the coordinates of vehicle and joints.
        """

    def ahead(self, seen: Floats) -> Floats | float:
        """Cotangent (b, 6) of measured pose errors from that of the observation (b, d), by entries ahead."""
        return 0.0

    def measure(self, on_measured: Floats, perfect: Floats, on_state: Floats) -> None:
        """Add the cotangent of a state (b, s) from that of its measured entries (b, w), pose errors aside."""
        n, physical = self.joints, on_measured / self.scale
        on_state[:, 6 + n : 12 + n] += physical[:, 6:12]
        if n:
            on_state[:, 6 : 6 + n] += physical[:, -2 * n : -n]
            on_state[:, 12 + n : 12 + 2 * n] += physical[:, -n:]


#: Weights of the squares of a pose error.
_SQUARES = np.repeat([1.0, ATTITUDE_LEVER**2], 3)


def error_jacobian(pose: Floats) -> Floats:
    """Jacobians (..., 6, 6) of pose errors (..., 6), m and rad, by xi of the frame's pose T exp(xi)."""
    turn = cross(pose[..., 3:])
    safe = np.maximum(np.linalg.norm(pose[..., 3:], axis=-1), 1e-3)[..., None, None]
    # Inverse of the right Jacobian of rotations. [Sol18 eq. 144]
    last = 1.0 / safe**2 - (1.0 + np.cos(safe)) / (2.0 * safe * np.sin(safe))
    jacobian = np.zeros((*pose.shape, 6))
    jacobian[..., :3, :3], jacobian[..., :3, 3:] = np.eye(3), cross(pose[..., :3])
    jacobian[..., 3:, 3:] = np.eye(3) + 0.5 * turn + last * (turn @ turn)
    return jacobian


def cross(v: Floats) -> Floats:
    """Matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack(row, axis=-1) for row in ([o, -z, y], [z, o, -x], [-y, x, o])], axis=-2)
