"""Derivatives of station keeping: reward, observation and thrusts by the state and the action, in NumPy.

Formulas are those of the environment: tests compare rewards with those of episodes, and gradients of returns with
finite differences over episodes.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym import ATTITUDE_LEVER
from uvms_gym._core import task_defaults
from uvms_gym.envs import TaskVectorEnv

Floats = NDArray[np.float64]

#: Pose error at which the linear part of the reward is 1, m.
COARSE = 0.3
#: Leak of the integral of the pose error, 1/s.
LEAK = 0.1


class StationKeeping:
    """Numbers of the task, and derivatives of its parts.

    Measured entries are the first 12 + 2n of an observation, in its scales: pose error, twist, joint coordinates and
    rates.

    Parameters
    ----------
    envs : TaskVectorEnv

    Raises
    ------
    ValueError
        The environment has another task, or actions other than wrenches.
    """

    def __init__(self, envs: TaskVectorEnv) -> None:
        options: Any = envs.options
        if envs.task != "station-keep":
            raise ValueError(f"gradients of the return are known for station-keep alone, not for {envs.task}")
        if options.action != "wrench":
            raise ValueError(
                f"action is {options.action!r}, but must be 'wrench': no other has gradients of the return"
            )
        native = envs._native
        sim = envs.snapshot()
        self.joints, self.period = sim.num_joints, native.control_period
        #: Age of measurements, control periods; the mean where it is drawn.
        self.delay = round(sum(native.delays) / 2)
        self.parts = {block.name: slice(block.offset, block.offset + block.length) for block in envs.layout}
        self.scale = np.concatenate([block.scale for block in envs.layout])[: 12 + 2 * self.joints]
        self.weights = {**task_defaults(envs.task)["reward"], **(options.reward or {})}
        integral = next(block for block in envs.layout if block.name == "error_integral")
        #: I' = keep I + gain e, both as observed.
        self.keep = float(np.exp(-LEAK * self.period))
        self.gain = (1.0 - self.keep) / LEAK * self.scale[:6] / np.asarray(integral.scale)
        self.limits = np.asarray(sim.thruster_limits)
        self.range = np.abs(self.limits).max(axis=1)
        wrench = np.array([block.scale[0] for block in envs.action_layout])
        #: Thrusts (m, a) of actions within the limits: those of least norm over their ranges, N.
        self.demand = self.range[:, None] * np.linalg.pinv(sim.thruster_configuration * self.range) * wrench

    def thrusts(self, actions: Floats) -> tuple[Floats, Floats]:
        """Thrusts (..., m) of clipped actions (..., a), N, and their Jacobian (..., m, a).

        All are scaled down together where one would exceed its limit.
        """
        free = actions @ self.demand.T
        limit = np.where(free > 0.0, self.limits[:, 1], self.limits[:, 0])
        ratio = free / limit
        excess = np.maximum(ratio.max(axis=-1, keepdims=True), 1.0)
        # Derivative of the excess.
        slope = np.where((ratio == excess) & (excess > 1.0), 1.0 / limit, 0.0) @ self.demand
        thrusts = np.clip(free / excess, *self.limits.T)
        return thrusts, (self.demand - thrusts[..., None] * slope[..., None, :]) / excess[..., None]

    def rewards(self, perfect: Floats, actions: Floats) -> Floats:
        """Rewards (..., T) of perfect observations (..., T + 1, d) and actions (..., T, a), divergence aside."""
        weights, clipped = self.weights, np.clip(actions, -1.0, 1.0)
        pose = perfect[..., 1:, :6] * self.scale[:6]
        square = pose**2 @ _SQUARES
        cost = np.log1p(square / weights["pose_scale"] ** 2) + np.sqrt(square) / COARSE
        effort = ((self.thrusts(clipped)[0] / self.range) ** 2).mean(axis=-1)
        change = ((clipped - perfect[..., :-1, self.parts["previous_action"]]) ** 2).mean(axis=-1)
        return -weights["pose"] * cost - weights["effort"] * effort - weights["action_rate"] * change  # type: ignore[no-any-return]

    def by_pose(self, perfect: Floats) -> Floats:
        """Gradient (..., 6) of the reward by the observed pose error, from perfect observations (..., d)."""
        pose = perfect[..., :6] * self.scale[:6]
        square = (pose**2 * _SQUARES).sum(axis=-1, keepdims=True)
        slope = 1.0 / (self.weights["pose_scale"] ** 2 + square) + 0.5 / (COARSE * np.sqrt(square + 1e-12))
        return -2.0 * self.weights["pose"] * slope * _SQUARES * pose * self.scale[:6]  # type: ignore[no-any-return]

    def by_thrust(self, thrusts: Floats) -> Floats:
        """Gradient (..., m) of the reward by thrusts (..., m), 1/N."""
        return -2.0 * self.weights["effort"] / len(self.range) * thrusts / self.range**2  # type: ignore[no-any-return]

    def by_change(self, change: Floats) -> Floats:
        """Gradient (..., a) of the reward by the change of the action (..., a)."""
        return -2.0 * self.weights["action_rate"] / change.shape[-1] * change  # type: ignore[no-any-return]

    def poses(self, perfect: Floats) -> tuple[Floats, Floats, Floats]:
        """Poses relative to the target, from perfect observations (..., d).

        Position (..., 3), m; quaternion (..., 4); and the Jacobian (..., 6, 6) of the observed pose error by xi of the
        pose T exp(xi).
        """
        pose = perfect[..., :6] * self.scale[:6]
        error, angle = pose[..., :3], pose[..., 3:]
        size = np.linalg.norm(angle, axis=-1, keepdims=True)
        quaternion = np.concatenate([np.cos(0.5 * size), 0.5 * np.sinc(0.5 / np.pi * size) * angle], axis=-1)
        cross, turn = _cross(error), _cross(angle)
        square = turn @ turn
        safe = np.maximum(size, 1e-3)[..., None]
        # R = I + sin/size turn + (1 - cos)/size^2 turn^2, and the inverse of its right Jacobian. [Sol18 eq. 144]
        rotation = np.eye(3) + np.sinc(safe / np.pi) * turn + (1.0 - np.cos(safe)) / safe**2 * square
        last = 1.0 / safe**2 - (1.0 + np.cos(safe)) / (2.0 * safe * np.sin(safe))
        jacobian = np.zeros((*pose.shape, 6))
        jacobian[..., :3, :3], jacobian[..., :3, 3:] = np.eye(3), cross
        jacobian[..., 3:, 3:] = np.eye(3) + 0.5 * turn + last * square
        return (rotation @ error[..., None])[..., 0], quaternion, jacobian / self.scale[:6, None]


#: Weights of the squares of a pose error.
_SQUARES = np.repeat([1.0, ATTITUDE_LEVER**2], 3)


def _cross(v: Floats) -> Floats:
    """Matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack(row, axis=-1) for row in ([o, -z, y], [z, o, -x], [-y, x, o])], axis=-2)
