"""Reference solutions of one body: closed forms, and Kirchhoff's equations. They share no code with the kernel."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from uvms_gym.studies.numerics import Floats


@dataclass(frozen=True)
class Top:
    """A free rigid body with principal moments `inertia` (3,), kg m^2, that starts at the identity with `spin` (3,)."""

    inertia: Floats
    spin: Floats

    def rates(self, time: Floats) -> Floats:
        """Angular velocity (k, 3) in body axes, by Jacobi elliptic functions (Landau & Lifshitz, Mechanics, 37)."""
        from scipy.special import ellipj, ellipkinc

        order = np.argsort(self.inertia)
        energy2 = float(self.inertia @ self.spin**2)
        momentum2 = float((self.inertia * self.spin) @ (self.inertia * self.spin))
        if momentum2 < energy2 * self.inertia[order[1]]:
            order = order[::-1]
        # An odd permutation of the axes reverses the sign of the gyroscopic terms, and so time.
        sense = float(np.linalg.det(np.eye(3)[order]))
        i1, i2, i3 = self.inertia[order]
        w = self.spin[order].copy()
        # Two signs may change together.
        flip = np.array([-1.0, 1.0, -1.0]) if w[2] < 0.0 else np.ones(3)
        w *= flip
        near, far = abs(energy2 * i3 - momentum2), abs(momentum2 - energy2 * i1)
        size = np.sqrt([near / (i1 * abs(i3 - i1)), near / (i2 * abs(i3 - i2)), far / (i3 * abs(i3 - i1))])
        m = abs(i2 - i1) * near / (abs(i3 - i2) * far)
        rate = math.sqrt(abs(i3 - i2) * far / (i1 * i2 * i3))
        # Axes in descending order reverse time once more.
        sense *= 1.0 if i3 > i1 else -1.0
        start = ellipkinc(math.atan2(w[1] / size[1], w[0] / size[0]), m)
        sn, cn, dn, _ = ellipj(sense * rate * time + start, m)
        result = np.empty((len(time), 3))
        result[:, order] = flip * size * np.stack([cn, sn, dn], axis=1)
        return result

    def attitudes(self, time: Floats) -> Floats:
        """Rotations (k, 3, 3), body to world, at ascending times: precession about the momentum by quadrature."""
        from scipy.integrate import fixed_quad

        # The axis closest to the angular momentum becomes z by a cyclic change of axes, so that the angle between
        # them is never 0 or pi.
        momentum2 = float((self.inertia * self.spin) @ (self.inertia * self.spin))
        order = np.argsort(self.inertia)
        above = momentum2 > float(self.inertia @ self.spin**2) * self.inertia[order[1]]
        z = int(order[2] if above else order[0])
        axes = [(z + 1) % 3, (z + 2) % 3, z]
        inertia, length = self.inertia[axes], math.sqrt(momentum2)

        def precession(at: Floats) -> Floats:
            w = self.rates(at)[:, axes]
            across = inertia[:2] * w[:, :2] ** 2
            result: Floats = length * across.sum(axis=1) / (inertia[:2] * across).sum(axis=1)
            return result

        # Enough nodes for several turns between two times.
        angle = np.cumsum([fixed_quad(precession, a, b, n=100)[0] for a, b in pairwise([0.0, *time])])

        def euler(phi: Floats, w: Floats) -> Floats:
            direction = w * inertia / length
            theta = np.arctan2(np.hypot(direction[:, 0], direction[:, 1]), direction[:, 2])
            psi = np.arctan2(direction[:, 0], direction[:, 1])
            x, _, z = np.eye(3)
            return rotation_about(z, phi) @ rotation_about(x, theta) @ rotation_about(z, psi)

        start = euler(np.zeros(1), self.rates(np.zeros(1))[:, axes])[0]
        turned = start.T @ euler(angle, self.rates(time)[:, axes])
        change = np.eye(3)[axes]
        result: Floats = change.T @ turned @ change
        return result


def rotation_about(axis: Floats, angle: Floats | float) -> Floats:
    """Rotations (k, 3, 3) about a unit vector, by Rodrigues' formula."""
    angles = np.atleast_1d(np.asarray(angle, dtype=np.float64))[:, None, None]
    x, y, z = axis
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    result: Floats = np.eye(3) + np.sin(angles) * hat + (1.0 - np.cos(angles)) * (hat @ hat)
    return result


def force_free_motion(inertia: Floats, twist: Floats, times: Floats, tolerance: float = 1e-13) -> dict[str, Floats]:
    """Motion from the origin of a body with the 6x6 inertia `inertia`, added mass included, without forces.

    Kirchhoff's equations: the linear and angular impulse in world axes, `p` and `l`, are constant, the body impulse is
    `[R^T p; R^T (l - x x p)]`, and the pose follows the twist. Only quaternion and position are integrated (DOP853);
    unlike the kernel's, this formulation has no accelerations.

    Parameters
    ----------
    inertia : numpy.ndarray (6, 6)
    twist : numpy.ndarray (6,)
        [linear; angular] at the start, body axes.
    times : numpy.ndarray (k,)
        Ascending, s.
    tolerance : float
        Of the integration, relative and absolute.

    Returns
    -------
    dict
        `position` (k, 3), `attitude` (k, 3, 3) and `twist` (k, 6).
    """
    from scipy.integrate import solve_ivp

    inverse = np.linalg.inv(inertia)
    impulse = inertia @ twist
    p, moment = impulse[:3], impulse[3:]

    def twist_at(r: Floats, x: Floats) -> Floats:
        result: Floats = inverse @ np.concatenate([r.T @ p, r.T @ (moment - np.cross(x, p))])
        return result

    def rate(_: float, state: Floats) -> Floats:
        r = _rotation(state[:4])
        v = twist_at(r, state[4:])
        w, x, y, z = state[:4]
        a, b, c = v[3:]
        spin = [-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a]
        return np.concatenate([0.5 * np.array(spin), r @ v[:3]])

    start, span = np.eye(7)[0], (0.0, float(times[-1]))
    states = solve_ivp(rate, span, start, "DOP853", times, rtol=tolerance, atol=tolerance).y.T
    rotations = np.array([_rotation(state[:4]) for state in states])
    twists = np.array([twist_at(r, state[4:]) for r, state in zip(rotations, states, strict=True)])
    return {"position": states[:, 4:], "attitude": rotations, "twist": twists}


def _rotation(quaternion: Floats) -> Floats:
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
