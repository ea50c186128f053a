"""Inputs of a step of a `Simulator`."""

from typing import TypeAlias, TypedDict

from numpy.typing import ArrayLike

_Rows: TypeAlias = ArrayLike | None
_Pose: TypeAlias = tuple[ArrayLike, ArrayLike] | ArrayLike | None


class StepInputs(TypedDict, total=False):
    """Inputs of a step: keywords of `Simulator.step`, which documents them, and of methods that evaluate a state.

    For n joints, m thrusters and k fins: thrust (m,), N; wrench (6,) on the vehicle, N and N m; joint_torque (n,), N m
    or N; joint_target (n,), or polynomials (N, n, j) with j <= 4, rad or m; external (n + 1, 6) on the moving bodies,
    N and N m; pose_target (position (3,), rotation (3, 3)) or pose (4, 4), m; fin (k,), rad. Wrenches are in body axes.
    Each has one row for all instances, or one per instance (leading N); None is the same as absent.
    """

    thrust: _Rows
    wrench: _Rows
    joint_torque: _Rows
    joint_target: _Rows
    external: _Rows
    pose_target: _Pose
    fin: _Rows
