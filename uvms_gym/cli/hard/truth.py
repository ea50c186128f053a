"""Closed forms and a formulation of its own for one body: truths that share no code with the kernel."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def complete_elliptic(m: float) -> float:
    """Quarter period K(m) of the Jacobi functions, by the arithmetic-geometric mean."""
    a, b = 1.0, math.sqrt(1.0 - m)
    while abs(a - b) > 1e-16 * a:
        a, b = 0.5 * (a + b), math.sqrt(a * b)
        if abs(a - b) < 4e-16 * a:
            break
    return math.pi / (2.0 * a)


def incomplete_elliptic(phi: float, m: float) -> float:
    """Incomplete elliptic integral F(phi, m), by Carlson's R_F."""
    turns = round(phi / math.pi)
    rest = phi - turns * math.pi
    s, c = math.sin(rest), math.cos(rest)
    return 2.0 * turns * complete_elliptic(m) + s * _carlson(c * c, 1.0 - m * s * s, 1.0)


def _carlson(x: float, y: float, z: float) -> float:
    while True:
        mean = (x + y + z) / 3.0
        dx, dy = 1.0 - x / mean, 1.0 - y / mean
        dz = -dx - dy
        if max(abs(dx), abs(dy), abs(dz)) < 1e-3:
            e2, e3 = dx * dy - dz * dz, dx * dy * dz
            series = 1.0 - e2 / 10.0 + e3 / 14.0 + e2 * e2 / 24.0 - 3.0 * e2 * e3 / 44.0
            return series / math.sqrt(mean)
        root = [math.sqrt(v) for v in (x, y, z)]
        shift = root[0] * root[1] + root[1] * root[2] + root[2] * root[0]
        x, y, z = 0.25 * (x + shift), 0.25 * (y + shift), 0.25 * (z + shift)


def jacobi(u: Floats, m: float) -> tuple[Floats, Floats, Floats]:
    """Jacobi elliptic functions sn, cn, dn of u for 0 <= m < 1, by the descending Landen transformation."""
    a, b, c = [1.0], math.sqrt(1.0 - m), [math.sqrt(m)]
    while c[-1] > 1e-17 and len(a) < 12:
        a, b, c = [*a, 0.5 * (a[-1] + b)], math.sqrt(a[-1] * b), [*c, 0.5 * (a[-1] - b)]
    period = 2.0 * math.pi / a[-1]
    phi = 2.0 ** (len(a) - 1) * a[-1] * (u - period * np.round(u / period))
    for n in range(len(a) - 1, 0, -1):
        phi = 0.5 * (phi + np.arcsin(np.clip(c[n] / a[n] * np.sin(phi), -1.0, 1.0)))
    sn = np.sin(phi)
    return sn, np.cos(phi), np.sqrt(1.0 - m * sn * sn)


@dataclass(frozen=True)
class Top:
    """A free rigid body with principal moments `inertia` that starts with the identity attitude and `spin`."""

    inertia: Floats
    spin: Floats

    def rates(self, time: Floats) -> Floats:
        """Angular velocity (k, 3) in body axes, by Jacobi elliptic functions (Landau & Lifshitz, Mechanics, 37)."""
        order = np.argsort(self.inertia)
        energy2 = float(self.inertia @ self.spin**2)
        momentum2 = float((self.inertia * self.spin) @ (self.inertia * self.spin))
        if momentum2 < energy2 * self.inertia[order[1]]:
            order = order[::-1]
        # An odd order of the axes reverses the sign of the gyroscopic terms, and so time.
        sense = float(np.linalg.det(np.eye(3)[order]))
        i1, i2, i3 = self.inertia[order]
        w = self.spin[order].copy()
        # Two signs may be turned together.
        flip = np.array([-1.0, 1.0, -1.0]) if w[2] < 0.0 else np.ones(3)
        w *= flip
        near, far = abs(energy2 * i3 - momentum2), abs(momentum2 - energy2 * i1)
        size = np.sqrt([near / (i1 * abs(i3 - i1)), near / (i2 * abs(i3 - i2)), far / (i3 * abs(i3 - i1))])
        m = abs(i2 - i1) * near / (abs(i3 - i2) * far)
        rate = math.sqrt(abs(i3 - i2) * far / (i1 * i2 * i3))
        # Axes that descend see time reversed once more.
        sense *= 1.0 if i3 > i1 else -1.0
        start = incomplete_elliptic(math.atan2(w[1] / size[1], w[0] / size[0]), m)
        sn, cn, dn = jacobi(sense * rate * time + start, m)
        result = np.empty((len(time), 3))
        result[:, order] = flip * size * np.stack([cn, sn, dn], axis=1)
        return result

    def attitudes(self, time: Floats) -> Floats:
        """Rotations (k, 3, 3), body to world, at ascending times: about the angular momentum by quadrature."""
        # The axis that the angular momentum circles becomes z, by a cyclic change of axes, so that the angle between
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

        angle = integral(precession, np.concatenate([[0.0], time]), 0.2 / float(np.linalg.norm(self.spin)))

        def euler(phi: Floats, w: Floats) -> Floats:
            direction = w * inertia / length
            theta = np.arctan2(np.hypot(direction[:, 0], direction[:, 1]), direction[:, 2])
            psi = np.arctan2(direction[:, 0], direction[:, 1])
            result: Floats = _turns(2, phi) @ _turns(0, theta) @ _turns(2, psi)
            return result

        start = euler(np.zeros(1), self.rates(np.zeros(1))[:, axes])[0]
        turned = start.T @ euler(angle, self.rates(time)[:, axes])
        change = np.eye(3)[axes]
        result: Floats = change.T @ turned @ change
        return result


def integral(rate: Callable[[Floats], Floats], times: Floats, piece: float) -> Floats:
    """Integrals (k - 1,) of `rate` from the first of k times to each other, by Gauss-Legendre on short pieces."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    sums = []
    for a, b in pairwise(times):
        edges = np.linspace(a, b, max(1, math.ceil((b - a) / piece)) + 1)
        half = 0.5 * np.diff(edges)[:, None]
        at = edges[:-1, None] + half * (1.0 + nodes)
        sums.append(float((half * weights * rate(at.ravel()).reshape(at.shape)).sum()))
    return np.cumsum(sums)


def turn(axis: Floats, angle: Floats | float) -> Floats:
    """Rotations (k, 3, 3) about a unit vector, by Rodrigues' formula."""
    angles = np.atleast_1d(np.asarray(angle, dtype=np.float64))[:, None, None]
    x = cross_matrix(axis)
    return np.eye(3) + np.sin(angles) * x + (1.0 - np.cos(angles)) * (x @ x)


def _turns(axis: int, angle: Floats) -> Floats:
    return turn(np.eye(3)[axis], angle)


def cross_matrix(v: Floats) -> Floats:
    """[v], the matrix of v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def ideal_body(
    inertia: Floats, twist: Floats, times: Floats, step: float, rotation: Floats | None = None
) -> dict[str, Floats]:
    """Motion of a body with the 6x6 inertia `inertia` (added mass included) that nothing pushes, from the origin.

    Kirchhoff's equations for linear and angular impulse, which stay in world axes: `p` and `l` are constant, the body
    impulse is `[R^T p; R^T (l - x x p)]`, and the pose follows the twist. A quaternion and a position are all that is
    integrated (RK4, extrapolated from two steps); a formulation without accelerations, unlike the kernel's.
    """
    inverse = np.linalg.inv(inertia)
    start = np.eye(3) if rotation is None else rotation
    impulse = inertia @ twist
    p, moment = start @ impulse[:3], start @ impulse[3:]

    def twist_of(r: Floats, x: Floats) -> Floats:
        result: Floats = inverse @ np.concatenate([r.T @ p, r.T @ (moment - np.cross(x, p))])
        return result

    def rate(state: Floats) -> Floats:
        r = start @ _rotation(state[:4])
        v = twist_of(r, state[4:])
        w, x, y, z = state[:4]
        a, b, c = v[3:]
        spin = [-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a]
        return np.concatenate([0.5 * np.array(spin), r @ v[:3]])

    def integrate(h: float) -> list[Floats]:
        state, now, out = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.0, []
        for time in times:
            count = round((time - now) / h)
            for _ in range(count):
                k1 = rate(state)
                k2 = rate(state + 0.5 * h * k1)
                k3 = rate(state + 0.5 * h * k2)
                k4 = rate(state + h * k3)
                state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            now = time
            out.append(state)
        return out

    coarse, fine = np.array(integrate(step)), np.array(integrate(0.5 * step))
    best = fine + (fine - coarse) / 15.0
    rotations = np.array([start @ _rotation(state[:4]) for state in best])
    twists = np.array([twist_of(r, state[4:]) for r, state in zip(rotations, best, strict=True)])
    return {"position": best[:, 4:], "attitude": rotations, "twist": twists}


def _rotation(quaternion: Floats) -> Floats:
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
