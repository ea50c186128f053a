"""Rotations: unit quaternions [w, x, y, z], matrices, and roll, pitch, yaw; any number of them in leading axes."""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = NDArray[np.float64]


def multiply(a: Floats, b: Floats) -> Floats:
    """Products a b of quaternions (..., 4)."""
    v, w = a[..., 1:], b[..., 1:]
    scalar = a[..., :1] * b[..., :1] - np.sum(v * w, axis=-1, keepdims=True)
    vector = a[..., :1] * w + b[..., :1] * v + np.cross(v, w)
    return np.concatenate([scalar, vector], axis=-1)


def conjugate(q: Floats) -> Floats:
    """Inverse rotations of quaternions (..., 4)."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def unit(q: Floats) -> Floats:
    """Quaternions (..., 4) of length 1."""
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def canonical(q: Floats) -> Floats:
    """Quaternions (n, 4) of the same rotations with w >= 0."""
    return np.where(q[:, :1] < 0.0, -q, q)


def matrices(q: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def from_rpy(rpy: Floats) -> Floats:
    """Quaternions (n, 4) of roll, pitch, yaw (n, 3), rad: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy.T / 2.0), np.sin(rpy.T / 2.0)
    q = [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
    return np.stack(q, axis=-1)


def to_rpy(q: Floats) -> Floats:
    """Roll, pitch, yaw (..., 3), rad, of quaternions (..., 4)."""
    return rpy_of(matrices(q))


def rpy_of(R: Floats) -> Floats:
    """Roll, pitch, yaw (..., 3), rad, of rotation matrices (..., 3, 3), accurate at every pitch."""
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    pitch = np.arctan2(-R[..., 2, 0], np.hypot(R[..., 0, 0], R[..., 1, 0]))
    # Roll after yaw, from entries that stay large where pitch is near 90 degrees.
    sine, cosine = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(sine * R[..., 0, 2] - cosine * R[..., 1, 2], cosine * R[..., 1, 1] - sine * R[..., 0, 1])
    return np.stack([roll, pitch, yaw], axis=-1)


def angles(a: Floats, b: Floats) -> Floats:
    """Angles of the rotations between quaternions (..., 4), rad, in [0, pi]."""
    relative = multiply(conjugate(a), b)
    sine = np.linalg.norm(relative[..., 1:], axis=-1)
    return np.asarray(2.0 * np.arctan2(sine, np.abs(relative[..., 0])))


def distances(a: Floats, b: Floats) -> Floats:
    """Angles (...) of the rotations between matrices (..., 3, 3), rad, accurate for small ones."""
    # |A - B| = 2 sqrt(2) sin(angle / 2)
    chord = np.linalg.norm(a - b, axis=(-2, -1)) / math.sqrt(8.0)
    return np.asarray(2.0 * np.arcsin(np.minimum(chord, 1.0)))


def skew(v: ArrayLike) -> Floats:
    """Matrices (..., 3, 3) of v (..., 3): skew(v) w = v x w."""
    x, y, z = np.moveaxis(np.asarray(v, dtype=np.float64), -1, 0)
    zero = np.zeros_like(x)
    return np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), (0, 1), (-2, -1))


def about(axis: ArrayLike, angle: ArrayLike) -> Floats:
    """Rotation matrices (..., 3, 3) about unit vectors (..., 3) by angles (...), rad: Rodrigues' formula."""
    angles, hat = np.asarray(angle, dtype=np.float64)[..., None, None], skew(axis)
    return np.asarray(np.eye(3) + np.sin(angles) * hat + (1.0 - np.cos(angles)) * (hat @ hat))


def exponential(w: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), rad."""
    angle = np.linalg.norm(w, axis=-1)
    return about(w / np.maximum(angle, 1e-300)[..., None], angle)


def logarithm(R: Floats) -> Floats:
    """Rotation vectors (n, 3), rad, of rotation matrices (n, 3, 3), at most pi long."""
    sine = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2.0
    size, cosine = np.linalg.norm(sine, axis=1), (np.trace(R, axis1=1, axis2=2) - 1.0) / 2.0
    angle = np.arctan2(size, cosine)
    w = sine * np.where(size < 1e-8, 1.0, angle / np.maximum(size, 1e-300))[:, None]
    # Near half a turn the axis a comes from (R + R^T) / 2 = cos + (1 - cos) a a^T.
    near = cosine < -0.99
    outer = (R[near] + np.swapaxes(R[near], 1, 2)) / 2.0 - cosine[near, None, None] * np.eye(3)
    longest = np.argmax(np.linalg.norm(outer, axis=1), axis=1)
    axis = np.take_along_axis(outer, longest[:, None, None], axis=2)[:, :, 0]
    axis *= np.where(np.sum(axis * sine[near], axis=1) < 0.0, -1.0, 1.0)[:, None]
    w[near] = axis / np.linalg.norm(axis, axis=1, keepdims=True) * angle[near, None]
    return w


def slerp(time: Floats, q: Floats, times: Floats) -> Floats:
    """Spherical linear interpolation of quaternions (n, 4) at sorted stamps (n,): at times (m,), (m, 4), w >= 0."""
    k = np.clip(np.searchsorted(time, times, side="right") - 1, 0, len(time) - 2)
    u = ((times - time[k]) / (time[k + 1] - time[k]))[:, None]
    a, b = q[k], q[k + 1]
    b = np.where(np.sum(a * b, axis=1, keepdims=True) < 0.0, -b, b)
    half = np.arctan2(np.linalg.norm(b - a, axis=1), np.linalg.norm(b + a, axis=1))[:, None] * 2.0
    sine = np.sin(half)
    small = sine < 1e-8
    sine = np.where(small, 1.0, sine)
    mixed = np.where(small, 1.0 - u, np.sin((1.0 - u) * half) / sine) * a
    mixed = mixed + np.where(small, u, np.sin(u * half) / sine) * b
    return canonical(unit(mixed))
