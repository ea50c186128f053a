"""Writes tests/golden/fossen_vehicle.json: the vehicle alone by Fossen's 6-DOF matrix form.

Run from the repository root: python tests/golden/fossen_vehicle.py
Made with Python 3.11, NumPy 2.4.6. Source: T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control,
2nd ed. 2021: M_RB, C_RB (chapter 3), M_A, C_A (chapter 6, C_A holds the Munk moment), g(eta) (chapter 4), current
(chapter 10).

All is computed as the book has it, x forward, y starboard, z down (NED), with Euler angles in g(eta), and turned into
x forward, y left, z up at the end by S = diag(1, -1, -1, 1, -1, -1):

    M_RB nu' + C_RB(nu) nu + M_A nu_r' + C_A(nu_r) nu_r + D(nu_r) nu_r + g(eta) = tau,
    nu_r = nu - nu_c,  nu_c = [R^T v_c; 0],  nu_c' = [-S(omega) R^T v_c; 0]
"""

import numpy as np
from scene_model import random_cases, random_state, save, skew

SCENES = ["rexrov-frozen", "bluerov2-heavy-frozen"]
FLIP3 = np.diag([1.0, -1.0, -1.0])
FLIP6 = np.diag([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])


def restoring(rotation, weight, buoyancy, r_g, r_b):
    """g(eta) for Euler angles (phi, theta), as printed."""
    theta, phi = np.arcsin(-rotation[2, 0]), np.arctan2(rotation[2, 1], rotation[2, 2])
    s, c = np.sin, np.cos
    x_g, y_g, z_g = r_g
    x_b, y_b, z_b = r_b
    W, B = weight, buoyancy
    return np.array(
        [
            (W - B) * s(theta),
            -(W - B) * c(theta) * s(phi),
            -(W - B) * c(theta) * c(phi),
            -(y_g * W - y_b * B) * c(theta) * c(phi) + (z_g * W - z_b * B) * c(theta) * s(phi),
            (z_g * W - z_b * B) * s(theta) + (x_g * W - x_b * B) * c(theta) * c(phi),
            -(x_g * W - x_b * B) * c(theta) * s(phi) - (y_g * W - y_b * B) * s(theta),
        ]
    )


def acceleration(model, state, current):
    (body,) = model.items
    assert np.array_equal(body.hydrodynamic_frame, np.eye(4)), "the book's coefficients are at the body's origin"
    assert np.allclose(model.gravity[:2], 0.0) and model.gravity[2] < 0.0
    m, g = body.mass, -model.gravity[2]
    r_g, r_b = FLIP3 @ body.center_of_mass, FLIP3 @ body.center_of_buoyancy
    I_b = FLIP3 @ body.inertia @ FLIP3 - m * skew(r_g) @ skew(r_g)
    M_A = FLIP6 @ body.added_mass @ FLIP6
    D_l, D_q = FLIP6 @ body.linear @ FLIP6, FLIP6 @ body.quadratic @ FLIP6
    R = FLIP3 @ np.array(state["rotation"]) @ FLIP3
    nu = FLIP6 @ state["twist"]
    v_c = R.T @ FLIP3 @ current
    nu_r = nu - np.concatenate([v_c, np.zeros(3)])
    v, w = nu[:3], nu[3:]

    M_RB = np.block([[m * np.eye(3), -m * skew(r_g)], [m * skew(r_g), I_b]])
    C_RB = np.block(
        [
            [np.zeros((3, 3)), -m * skew(v) - m * skew(skew(w) @ r_g)],
            [-m * skew(v) - m * skew(skew(w) @ r_g), m * skew(skew(v) @ r_g) - skew(I_b @ w)],
        ]
    )
    linear = M_A[:3, :3] @ nu_r[:3] + M_A[:3, 3:] @ nu_r[3:]
    angular = M_A[3:, :3] @ nu_r[:3] + M_A[3:, 3:] @ nu_r[3:]
    C_A = np.block([[np.zeros((3, 3)), -skew(linear)], [-skew(linear), -skew(angular)]])
    D = D_l + D_q @ np.diag(np.abs(nu_r))
    nu_c_rate = np.concatenate([-skew(w) @ v_c, np.zeros(3)])
    tau = FLIP6 @ state["wrench"]
    weight, buoyancy = m * g, model.density * g * body.volume
    rest = tau - C_RB @ nu - C_A @ nu_r - D @ nu_r - restoring(R, weight, buoyancy, r_g, r_b) + M_A @ nu_c_rate
    return FLIP6 @ np.linalg.solve(M_RB + M_A, rest)


def case(i, rng, model):
    state = random_state(rng, model)
    state.pop("external")
    current = np.zeros(3) if i % 2 == 0 else np.round(rng.normal(size=3), 3)
    return state | {"current": current, "expected": {"acceleration": acceleration(model, state, current)}}


if __name__ == "__main__":
    save("fossen_vehicle.json", random_cases(SCENES, 3, case))
