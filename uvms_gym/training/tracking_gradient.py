"""Derivatives of end-effector tracking."""

from typing import Any

import numpy as np

from uvms_gym.envs import TaskVectorEnv
from uvms_gym.training.arm_jacobian import ArmJacobian
from uvms_gym.training.task_gradient import Floats, TaskGradient, cross, error_jacobian


class EndEffectorTracking(TaskGradient):
    """End-effector tracking: the frame is the end effector, and torques move the joints."""

    up = 3

    def __init__(self, envs: TaskVectorEnv, posture: float = 0.0) -> None:
        super().__init__(envs, posture)
        self.reference = slice(self.parts["reference_twist"].start, self.parts["previous_action"].start)
        scene = envs._native.scene
        self.arm, gravity = ArmJacobian(scene), np.array(scene["water"]["gravity"])
        if np.hypot(*gravity[:2]) > 1e-9 * np.abs(gravity).sum():
            raise ValueError(
                f"gravity is {gravity.tolist()}, but must be along z: no other has gradients of the return"
            )

    def states(self, perfect: Floats) -> dict[str, Floats]:
        """Arguments of `Simulator.set_state`: anywhere, and in any heading, as neither matters in still water."""
        x, y, z = np.moveaxis(perfect[..., 12:15], -1, 0)
        # Rotation of minimum angle that turns the observed direction against gravity into z; none points straight down.
        quaternion = np.stack([1.0 + z, y, -x, np.zeros_like(z)], axis=-1)
        quaternion /= np.maximum(np.linalg.norm(quaternion, axis=-1, keepdims=True), 1e-9)
        return {**super().states(perfect), "quaternion": quaternion}

    def inputs(self, forces: Floats, state: dict[str, Floats]) -> dict[str, Any]:
        """Thrusts and torques of the joints."""
        torques = {"joint_torque": forces[:, self.thrusters :]} if self.joints else {}
        return {"thrust": forces[:, : self.thrusters], **torques}

    def measure(self, on_measured: Floats, perfect: Floats, on_state: Floats) -> None:
        """Add the direction against gravity, too: its derivative by the vehicle's turn is its cross product."""
        super().measure(on_measured, perfect, on_state)
        on_state[:, 3:6] += np.cross(on_measured[:, 12:15], perfect[:, 12:15])

    def geometry(self, perfect: Floats) -> tuple[Floats, Floats]:
        """Jacobians of pose errors, of the reference's twist and of its points ahead, and that of the end effector.

        Errors against points ahead are observed as the measured errors, of an older state, plus their true difference
        at present, which is meant.
        """
        physical = perfect[..., self.reference] * self.scales[self.reference]
        rows, error = perfect.shape[:-1], perfect[..., :6] * self.scale[:6]
        twist, ahead = physical[..., :6].reshape(*rows, 2, 3), physical[..., 6:].reshape(*rows, -1, 6)
        change = (error_jacobian(ahead) - error_jacobian(error)[..., None, :, :])[..., 3:]
        turns = [cross(twist).reshape(*rows, 6, 3), change.reshape(*rows, -1, 3)]
        by_motion = np.zeros((*rows, 6 + physical.shape[-1], 6))
        by_motion[..., :6, :] = self.errors(perfect)
        by_motion[..., 6:, 3:] = np.concatenate(turns, axis=-2) / self.scales[self.reference, None]
        return by_motion, self.arm(self.states(perfect)["q"] if self.joints else np.zeros((*rows, 0)))

    def ahead(self, seen: Floats) -> Floats:
        """Cotangent (b, 6) of measured pose errors, which errors against all points ahead have in them."""
        physical = seen[:, self.reference][:, 6:] / self.scales[self.reference][6:]
        return physical.reshape(len(seen), -1, 6).sum(axis=1) * self.scale[:6]  # type: ignore[no-any-return]
