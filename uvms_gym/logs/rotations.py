"""Unit quaternions [w, x, y, z], in rows."""

import numpy as np

from uvms_gym.logs.units import Floats


def multiply(a: Floats, b: Floats) -> Floats:
    """Products a b of quaternions (..., 4)."""
    v, w = a[..., 1:], b[..., 1:]
    scalar = a[..., :1] * b[..., :1] - np.sum(v * w, axis=-1, keepdims=True)
    vector = a[..., :1] * w + b[..., :1] * v + np.cross(v, w)
    return np.concatenate([scalar, vector], axis=-1)


def conjugate(q: Floats) -> Floats:
    """Inverse rotations of quaternions (..., 4)."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


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
    """Roll, pitch, yaw (n, 3), rad, of quaternions (n, 4)."""
    R = matrices(q)
    pitch = np.arcsin(np.clip(-R[:, 2, 0], -1.0, 1.0))
    return np.stack([np.arctan2(R[:, 2, 1], R[:, 2, 2]), pitch, np.arctan2(R[:, 1, 0], R[:, 0, 0])], axis=-1)


def angles(a: Floats, b: Floats) -> Floats:
    """Angles of the rotations between quaternions (..., 4), rad, in [0, pi]."""
    relative = multiply(conjugate(a), b)
    sine = np.linalg.norm(relative[..., 1:], axis=-1)
    return np.asarray(2.0 * np.arctan2(sine, np.abs(relative[..., 0])))


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
    return canonical(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))
