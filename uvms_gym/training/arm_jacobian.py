"""Jacobian of the end effector in NumPy, for many states at once."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from uvms_gym.training.task_gradient import Floats, cross


class ArmJacobian:
    """Twist of the end effector per velocities of vehicle and joints: that of `Simulator.jacobian`. [MLS94]

    Parameters
    ----------
    scene : mapping
        Complete scene, as `uvms_gym.load_scene` gives it. Without an arm the end effector is the vehicle.
    """

    def __init__(self, scene: Mapping[str, Any]) -> None:
        arm = scene.get("arm")
        self._mount = _pose(arm["mount"]["frame"]) if arm else (np.eye(3), np.zeros(3))
        self._end = _pose(arm["end_effector"]) if arm else (np.eye(3), np.zeros(3))
        joints = [link["joint"] for link in arm["links"]] if arm else []
        self._joints = [(*_pose(joint["frame"]), np.array(joint["axis"]), joint["kind"]) for joint in joints]

    def __call__(self, q: Floats) -> Floats:
        """Jacobians (..., 6, 6 + n), end-effector axes, at joint coordinates q (..., n)."""
        jacobian = np.zeros((*q.shape[:-1], 6, 6 + len(self._joints)))
        # Pose of the end effector in each link's axes, from the last one on.
        turn, place = (np.broadcast_to(part, (*q.shape[:-1], *part.shape)) for part in self._end)
        for i, (rotation, position, axis, kind) in reversed(list(enumerate(self._joints))):
            back = np.swapaxes(turn, -1, -2)
            if kind == "revolute":
                jacobian[..., :3, 6 + i] = _apply(back, np.cross(axis, place))
                jacobian[..., 3:, 6 + i] = back @ axis
                sine, cosine = np.sin(q[..., i, None, None]), np.cos(q[..., i, None, None])
                turned = np.eye(3) + sine * cross(axis) + (1.0 - cosine) * (cross(axis) @ cross(axis))
                turn, place = turned @ turn, _apply(turned, place)
            else:
                jacobian[..., :3, 6 + i] = back @ axis
                place = place + q[..., i, None] * axis
            turn, place = rotation @ turn, place @ rotation.T + position
        rotation, position = self._mount
        turn, place = rotation @ turn, place @ rotation.T + position
        back = np.swapaxes(turn, -1, -2)
        jacobian[..., :3, :3] = jacobian[..., 3:, 3:6] = back
        jacobian[..., :3, 3:6] = -back @ cross(place)
        return jacobian


def _pose(frame: Mapping[str, Any]) -> tuple[Floats, Floats]:
    """Rotation matrix and position of a scene's frame."""
    (r, p, y), position = frame["rpy"], np.array(frame["position"])
    rotation = np.eye(3)
    for axis, angle in ((2, y), (1, p), (0, r)):
        turn = cross(np.eye(3)[axis])
        rotation = rotation @ (np.eye(3) + np.sin(angle) * turn + (1.0 - np.cos(angle)) * turn @ turn)
    return rotation, position


def _apply(matrices: Floats, vectors: Floats) -> Floats:
    """Products (..., 3) of matrices (..., 3, 3) and vectors (..., 3)."""
    return (matrices @ vectors[..., None])[..., 0]
