"""Reference solutions of one body: closed forms, and Kirchhoff's equations. They share no code with the kernel."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from uvms_gym._rotations import about, matrices, multiply, unit
from uvms_gym._scene import matrix_of
from uvms_gym.studies.hard_cases.case import Reference
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
            return about(z, phi) @ about(x, theta) @ about(z, psi)

        start = euler(np.zeros(1), self.rates(np.zeros(1))[:, axes])[0]
        turned = start.T @ euler(angle, self.rates(time)[:, axes])
        change = np.eye(3)[axes]
        result: Floats = change.T @ turned @ change
        return result


def precession(transverse: float, axial: float, rate: Floats, times: Floats, rotor: float = 0.0) -> dict[str, Floats]:
    """Attitudes (k, 3, 3) and angular velocities (k, 3) of a body with two equal moments and a rotor about its axis z.

    It precesses about the angular momentum H at |H| / `transverse`, and rotates about z at w_3 - H_3 / `transverse`;
    `rotor` is the constant angular momentum of the rotor beside the body, which rotates at `rate` (3,).
    """
    inertia, spin, z = np.array([transverse, transverse, axial]), np.array([0.0, 0.0, rotor]), np.eye(3)[2]
    momentum = inertia * rate + spin
    size = float(np.linalg.norm(momentum))
    turned = about(z, (rate[2] - momentum[2] / transverse) * times)
    attitude = about(momentum / size, size / transverse * times) @ turned
    return {"attitude": attitude, "rate": (np.swapaxes(attitude, 1, 2) @ momentum - spin) / inertia}


def pendulum(start: float, rate: float, times: Floats) -> tuple[Floats, Floats]:
    """Angles and angular velocities (k,) of q'' = -rate^2 sin q from rest at `start`: Jacobi elliptic functions."""
    from scipy.special import ellipj, ellipk

    k = math.sin(0.5 * start)
    sn, cn, _, _ = ellipj(rate * times + ellipk(k * k), k * k)
    return 2.0 * np.arcsin(k * sn), 2.0 * k * rate * cn


def solve(
    rates: Callable[[float, Floats], ArrayLike], start: ArrayLike, times: Floats, tolerance: float = 1e-13
) -> Floats:
    """Solution (states, k) of a differential equation from `start` at time 0, by SciPy's DOP853.

    `tolerance` is relative and absolute.
    """
    from scipy.integrate import solve_ivp

    span = (0.0, float(times[-1]))
    return np.asarray(solve_ivp(rates, span, start, "DOP853", times, rtol=tolerance, atol=tolerance).y)


def solve_twice(rates: Callable[[float, Floats], ArrayLike], start: ArrayLike, times: Floats) -> tuple[Floats, float]:
    """Solution of `solve`, and its maximum difference from one with a hundred times the tolerance."""
    fine, coarse = (solve(rates, start, times, tolerance) for tolerance in (1e-13, 1e-11))
    return fine, float(np.abs(fine - coarse).max())


def inertia_of(body: Mapping[str, Any]) -> Floats:
    """Inertia (6, 6) of a body about its origin, its centre of mass, with added mass; either as matrix or diagonal."""
    rigid = np.diag([body["mass"]] * 3 + [0.0] * 3)
    rigid[3:, 3:] = matrix_of(body["inertia"])
    return rigid + matrix_of(body["added_mass"])


def force_free_motion(inertia: Floats, twist: Floats, times: Floats, tolerance: float = 1e-13) -> dict[str, Floats]:
    """Motion from the origin of a body with the 6x6 inertia `inertia`, added mass included, without forces.

    Kirchhoff's equations: the linear and angular impulse in world axes, `p` and `l`, are constant, the body impulse is
    `[R^T p; R^T (l - x x p)]`, and the pose follows the twist. Only quaternion and position are integrated; unlike the
    kernel's, this formulation has no accelerations.

    `twist` (6,) is [linear; angular] at the start, body axes; `times` (k,) are ascending, s; see `solve` for
    `tolerance`.

    Returns
    -------
    dict
        `position` (k, 3), `attitude` (k, 3, 3) and `twist` (k, 6).
    """
    inverse = np.linalg.inv(inertia)
    impulse = inertia @ twist
    p, moment = impulse[:3], impulse[3:]

    def attitude(state: Floats) -> Floats:
        return matrices(unit(state[:4]))

    def twist_at(state: Floats) -> Floats:
        r = attitude(state)
        return np.asarray(inverse @ np.concatenate([r.T @ p, r.T @ (moment - np.cross(state[4:], p))]))

    def rates(_: float, state: Floats) -> Floats:
        v = twist_at(state)
        turn = 0.5 * multiply(state[:4], np.array([0.0, *v[3:]]))
        return np.concatenate([turn, attitude(state) @ v[:3]])

    states = solve(rates, np.eye(7)[0], times, tolerance).T
    attitudes, twists = (np.array([part(state) for state in states]) for part in (attitude, twist_at))
    return {"position": states[:, 4:], "attitude": attitudes, "twist": twists}


def force_free_reference(inertia: Floats, twist: Floats, times: Floats) -> Reference:
    """Reference of position, attitude and twist, by `force_free_motion`."""
    fine, coarse = (force_free_motion(inertia, twist, times, tolerance) for tolerance in (1e-13, 1e-11))
    uncertainty = max(float(np.abs(fine[name] - coarse[name]).max()) for name in fine)
    return Reference(fine, "Kirchhoff's equations for the impulse, by SciPy, two tolerances", uncertainty)
