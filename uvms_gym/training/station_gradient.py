"""Derivatives of station keeping."""

from typing import Any

import numpy as np

from uvms_gym.training.task_gradient import Floats, TaskGradient, cross


class StationKeeping(TaskGradient):
    """Station keeping: the frame is the vehicle, and servos move the joints."""

    def states(self, perfect: Floats) -> dict[str, Floats]:
        """Arguments of `Simulator.set_state`, with the target at the origin."""
        pose = perfect[..., :6] * self.scale[:6]
        error, angle = pose[..., :3], pose[..., 3:]
        size = np.linalg.norm(angle, axis=-1, keepdims=True)
        quaternion = np.concatenate([np.cos(0.5 * size), 0.5 * np.sinc(0.5 / np.pi * size) * angle], axis=-1)
        turn, safe = cross(angle), np.maximum(size, 1e-3)[..., None]
        # R = I + sin/size turn + (1 - cos)/size^2 turn^2
        rotation = np.eye(3) + np.sinc(safe / np.pi) * turn + (1.0 - np.cos(safe)) / safe**2 * (turn @ turn)
        position = (rotation @ error[..., None])[..., 0]
        return {**super().states(perfect), "position": position, "quaternion": quaternion}

    def inputs(self, forces: Floats, state: dict[str, Floats]) -> dict[str, Any]:
        """Thrusts, and targets of the joints: on with their rates."""
        targets = {"joint_target": np.stack([state["q"], state["qd"]], axis=-1)} if self.joints else {}
        return {"thrust": forces, **targets}

    def geometry(self, perfect: Floats) -> tuple[Floats, Floats]:
        """Jacobians of pose errors by the vehicle's motion, and the identity."""
        return self.errors(perfect), np.broadcast_to(
            np.eye(6, 6 + self.joints), (*perfect.shape[:-1], 6, 6 + self.joints)
        )
