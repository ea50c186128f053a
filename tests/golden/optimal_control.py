"""Writes tests/golden/optimal_control.json: optimal trajectories of three problems by IPOPT.

Run from the repository root: python tests/golden/optimal_control.py
Made with Python 3.11, CasADi 3.8.2 (its IPOPT with MUMPS), NumPy 2.4.

The discrete step is Munthe-Kaas's method on the classical Runge-Kutta tableau, written once more: T exp(theta) with
theta' = dexp^-1_(-theta) V. Equations of motion are Kirchhoff's for the momentum of vehicle and link, from their
kinetic energy. Multiple shooting, exact Hessians, bounds as they stand.

    turn       free body without water, brought to a turned pose by a bounded wrench
    thrusters  vehicle with added mass, linear and quadratic damping, weight and buoyancy: point to point, limits of
               eight thrusters active
    reach      vehicle with one link in the plane: wrench off the plane bounded by 0, reach with the end of the link

The cost is half the sum of weight times squared difference: of [R^T (r - r_d); log(R_d^T R)], q, twist, q', end
effector and inputs.
"""

import json
import math
import platform

import casadi as ca
import numpy as np
from scene_model import HERE, Reader, load, plain, rotation_rpy, skew

DT = 0.05


def series(z, shift):
    """sum over k of (-1)^k z^k / (2 k + shift)!"""
    total = 0
    for k in reversed(range(12)):
        total = total * z + (-1.0) ** k / math.factorial(2 * k + shift)
    return total


def exponential(theta):
    """Rotation and position of exp [theta]."""
    u, w = theta[:3], theta[3:]
    z, W = ca.dot(w, w), ca.skew(w)
    s, c, b = series(z, 1), series(z, 2), series(z, 3)
    return ca.SX.eye(3) + s * W + c * W @ W, u + c * ca.cross(w, u) + b * ca.cross(w, ca.cross(w, u))


def ad(x, y):
    return ca.vertcat(ca.cross(x[3:], y[:3]) + ca.cross(x[:3], y[3:]), ca.cross(x[3:], y[3:]))


def dexp_inverse(theta, v):
    """dexp^-1_(-theta) v by Bernoulli's numbers."""
    total, term = v + ad(theta, v) / 2, v
    for number, k in ((1 / 6, 2), (-1 / 30, 4), (1 / 42, 6), (-1 / 30, 8), (5 / 66, 10)):
        term = ad(theta, ad(theta, term))
        total = total + number / math.factorial(k) * term
    return total


def logarithm(R):
    """Rotation vector: for angles between 0 and pi."""
    axis = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2
    sine = ca.sqrt(ca.dot(axis, axis) + 1e-30)
    return axis * ca.atan2(sine, (ca.trace(R) - 1) / 2) / sine


def rotation_about(axis, angle):
    K = ca.skew(ca.DM(axis))
    return ca.SX.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * K @ K


def inertia(item):
    m, S = item.mass, skew(item.center_of_mass)
    rigid = np.block([[m * np.eye(3), -m * S], [m * S, item.inertia - m * S @ S]])
    return rigid + item.added_mass


class Plant:
    """Discrete step and end effector of a scene: a vehicle, and at most one revolute joint."""

    def __init__(self, scene, substeps):
        reader = Reader(float, math)
        self.model = reader.model(scene)
        self.n = len(self.model.joints)
        thrusters = scene["vehicle"].get("thrusters", [])
        columns = [np.concatenate([t["axis"], np.cross(t["position"], t["axis"])]) for t in thrusters]
        self.thrust_map = np.array(columns).T if columns else np.eye(6)
        width = self.thrust_map.shape[1] + self.n
        R, r, V = ca.SX.sym("R", 3, 3), ca.SX.sym("r", 3), ca.SX.sym("V", 6)
        q, qd, u = ca.SX.sym("q", self.n), ca.SX.sym("qd", self.n), ca.SX.sym("u", width)
        state = (R, r, V, q, qd)
        packed = ca.vertcat(ca.vec(R), r, V, q, qd)
        for _ in range(substeps):
            state = self.step(state, u)
        after = ca.vertcat(ca.vec(state[0]), *state[1:])
        self.next = ca.Function("next", [packed, u], [after])
        owner, tip = self.model.end_effector
        R_0, r_0 = self.link_pose(q) if owner else (ca.SX.eye(3), ca.SX.zeros(3))
        self.end = ca.Function("end", [packed], [r + R @ (r_0 + R_0 @ ca.DM(tip[:3, 3]))])
        self.width, self.size = width, 18 + 2 * self.n

    def link_pose(self, q):
        joint = self.model.joints[0]
        return ca.DM(joint.placement[:3, :3]) @ rotation_about(joint.axis, q), ca.DM(joint.placement[:3, 3])

    def link_twist(self, V, q, qd):
        R, r = self.link_pose(q)
        axis = ca.DM(self.model.joints[0].axis)
        return ca.vertcat(R.T @ (V[:3] + ca.cross(V[3:], r)), R.T @ V[3:] + axis * qd)

    def accelerations(self, state, u):
        """Momentum p = dT/dV: p' = ad^T p + F; Lagrange's equation for the joint."""
        R, _, V, q, qd = state
        v, rate, angle = ca.SX.sym("v", 6), ca.SX.sym("rate", self.n), ca.SX.sym("angle", self.n)
        speeds = ca.vertcat(v, rate)
        energy, power = 0, 0
        for item in self.model.items:
            twist = self.link_twist(v, angle, rate) if item.owner else v
            assert np.allclose(item.placement, np.eye(4)) and np.allclose(item.hydrodynamic_frame, np.eye(4))
            energy += twist.T @ ca.DM(inertia(item)) @ twist / 2
            linear, quadratic = np.diag(item.linear), np.diag(item.quadratic)
            # Damping loads, held while virtual velocities vary.
            load_of = ca.DM(linear) * twist + ca.DM(quadratic) * ca.fabs(twist) * twist
            power += ca.jacobian(twist, speeds).T @ load_of
        momentum = ca.jacobian(energy, speeds).T
        p = momentum[:6]
        f, m = p[:3], p[3:]
        transport = ca.vertcat(ca.cross(f, v[3:]), ca.cross(m, v[3:]) + ca.cross(f, v[:3]))
        thrust = ca.DM(self.thrust_map) @ u[: self.thrust_map.shape[1]]
        body = self.model.items[0]
        down = R.T @ ca.DM(self.model.gravity)
        weight, lift = body.mass * down, -self.model.density * body.volume * down
        restoring = ca.vertcat(
            weight + lift,
            ca.cross(ca.DM(body.center_of_mass), weight) + ca.cross(ca.DM(body.center_of_buoyancy), lift),
        )
        joint = u[self.thrust_map.shape[1] :]
        if self.n:
            assert not np.any(self.model.gravity)
            joint = joint + ca.jacobian(energy, angle).T - self.model.joints[0].viscous * rate
        drift = ca.mtimes(ca.jacobian(momentum, angle), rate) if self.n else 0
        right = ca.vertcat(transport + thrust + restoring, joint) - power - drift
        mass = ca.jacobian(momentum, speeds)
        solved = ca.solve(mass, right)
        return ca.substitute(solved, ca.vertcat(v, rate, angle), ca.vertcat(V, qd, q))

    def step(self, state, u):
        R, r, V, q, qd = state
        n, h = self.n, DT
        rates, zero = [], (ca.SX.zeros(6), ca.SX.zeros(6), ca.SX.zeros(n), ca.SX.zeros(n))
        for weight in (0.0, 0.5, 0.5, 1.0):
            last = rates[-1] if rates else zero
            theta, dV, dq, dqd = (h * weight * rate for rate in last)
            turn, move = exponential(theta)
            V_i, q_i, qd_i = V + dV, q + dq, qd + dqd
            acceleration = self.accelerations((R @ turn, r + R @ move, V_i, q_i, qd_i), u)
            rates.append((dexp_inverse(theta, V_i), acceleration[:6], qd_i, acceleration[6:]))
        theta, dV, dq, dqd = (h / 6 * (a + 2 * b + 2 * c + d) for a, b, c, d in zip(*rates, strict=True))
        turn, move = exponential(theta)
        return R @ turn, r + R @ move, V + dV, q + dq, qd + dqd

    def state_cost(self, x, reference, weights):
        R, r, V = ca.reshape(x[:9], 3, 3), x[9:12], x[12:18]
        differences = {
            "position": R.T @ (r - ca.DM(reference["position"])),
            "attitude": logarithm(ca.DM(reference["rotation"]).T @ R),
            "q": x[18 : 18 + self.n] - ca.DM(reference.get("q", [0.0] * self.n)),
            "twist": V,
            "qd": x[18 + self.n :],
            "end_effector": self.end(x) - ca.DM(reference.get("end_effector", [0.0] * 3)),
        }
        return sum(weight * ca.sumsqr(differences[name]) / 2 for name, weight in weights.items())


def solve(problem):
    plant, horizon = Plant(problem["scene"], problem["substeps"]), problem["horizon"]
    x, u = ca.SX.sym("x", plant.size), ca.SX.sym("u", plant.width)
    bounds, references = problem["bounds"], problem["references"]
    effort = np.concatenate([np.full(len(bounds[name][0]), w) for name, w in problem["input_weights"].items()])
    stage_cost = plant.state_cost(x, references, problem["weights"]) + ca.sum1(ca.DM(effort) * u**2) / 2
    stage = ca.Function("stage", [x, u], [stage_cost])
    weights = problem["weights"] | problem["terminal_weights"]
    last = ca.Function("last", [x], [plant.state_cost(x, references, weights)])
    start = np.concatenate([np.eye(3).ravel(), np.zeros(plant.size - 9)])
    X, U = ca.MX.sym("X", plant.size, horizon), ca.MX.sym("U", plant.width, horizon)
    before = ca.horzcat(ca.DM(start), X[:, :-1])
    gaps = X - plant.next.map(horizon)(before, U)
    cost = ca.sum2(stage.map(horizon)(before, U)) + last(X[:, -1])
    lower, upper = (np.concatenate([pair[side] for pair in bounds.values()]) for side in (0, 1))
    guess = [start]
    for _ in range(horizon):
        guess.append(np.array(plant.next(guess[-1], np.zeros(plant.width))).ravel())
    free = np.full(plant.size * horizon, np.inf)
    options = {"ipopt.tol": 1e-12, "ipopt.bound_relax_factor": 0.0, "ipopt.print_level": 3, "ipopt.max_iter": 500}
    nlp = {"x": ca.vertcat(ca.vec(X), ca.vec(U)), "f": cost, "g": ca.vec(gaps)}
    solver = ca.nlpsol("solver", "ipopt", nlp, options)
    found = solver(
        x0=np.concatenate([np.concatenate(guess[1:]), np.zeros(plant.width * horizon)]),
        lbx=np.concatenate([-free, np.tile(lower, horizon)]),
        ubx=np.concatenate([free, np.tile(upper, horizon)]),
        lbg=0.0,
        ubg=0.0,
    )
    assert solver.stats()["success"], solver.stats()["return_status"]
    inputs = np.array(found["x"]).ravel()[plant.size * horizon :].reshape(horizon, plant.width)
    active = np.isclose(inputs, lower, atol=1e-6) | np.isclose(inputs, upper, atol=1e-6)
    print(problem["name"], float(found["f"]), "active", active[:, upper > lower].mean())
    return problem | {"dt": DT, "cost": float(found["f"]), "inputs": inputs}


def turned(*angles):
    return rotation_rpy(angles, Reader(float, math))[:3, :3]


def problems():
    water = {"density": 0.0, "gravity": [0.0, 0.0, 0.0]}
    free = {
        "name": "free",
        "water": water,
        "vehicle": {"name": "free", "body": {"mass": 1.0, "inertia": [1.0, 1.5, 2.0]}},
    }
    yield {
        "name": "turn",
        "scene": free,
        "horizon": 20,
        "substeps": 2,
        "references": {"position": [0.5, -0.3, 0.2], "rotation": turned(0.5, -0.4, 0.8)},
        "weights": {"position": 1.0, "attitude": 1.0, "twist": 0.1},
        "terminal_weights": {"position": 100.0, "attitude": 100.0, "twist": 50.0},
        "input_weights": {"wrench": 0.1},
        "bounds": {"wrench": [[-0.8] * 6, [0.8] * 6]},
    }
    vehicle = load("bluerov2-heavy-frozen")
    c, d = np.cos(np.pi / 4), 0.12
    flat = [[0.156 * x, 0.111 * y, 0.0] for x in (1, -1) for y in (-1, 1)]
    axes = [[c, -c * y * x, 0.0] for x in (1, -1) for y in (-1, 1)]
    vertical = [[d * x, 0.218 * y, 0.0] for x in (1, -1) for y in (-1, 1)]
    pairs = [*zip(flat, axes, strict=True), *((place, [0.0, 0.0, 1.0]) for place in vertical)]
    limits = [[-30.0] * 8, [40.0] * 8]
    vehicle["vehicle"]["thrusters"] = [
        {"name": f"thruster {k}", "position": place, "axis": axis, "limits": [-30.0, 40.0]}
        for k, (place, axis) in enumerate(pairs)
    ]
    yield {
        "name": "thrusters",
        "scene": vehicle,
        "horizon": 20,
        "substeps": 2,
        "references": {"position": [1.0, 0.5, -0.3], "rotation": turned(0.0, 0.0, 0.6)},
        "weights": {"position": 50.0, "attitude": 20.0, "twist": 1.0},
        "terminal_weights": {"position": 500.0, "attitude": 200.0, "twist": 50.0},
        "input_weights": {"thrust": 1e-3},
        "bounds": {"thrust": limits},
    }
    damping = {"linear": [1.0, 1.0, 1.0, 0.05, 0.05, 0.05], "quadratic": [4.0, 4.0, 4.0, 0.2, 0.2, 0.2]}
    link = {
        "mass": 2.0,
        "inertia": [0.01, 0.03, 0.03],
        "center_of_mass": [0.2, 0.0, 0.0],
        "added_mass": [0.2, 1.5, 1.5, 0.0, 0.02, 0.02],
        "damping": damping,
    }
    joint = {
        "kind": "revolute",
        "axis": [0.0, 1.0, 0.0],
        "frame": {"position": [0.3, 0.0, -0.1]},
        "friction": {"viscous": 0.2},
    }
    yield {
        "name": "reach",
        "scene": {
            "name": "planar",
            "water": {"density": 1000.0, "gravity": [0.0, 0.0, 0.0]},
            "vehicle": {
                "name": "planar",
                "body": {
                    "mass": 12.0,
                    "inertia": [0.3, 0.4, 0.5],
                    "added_mass": [5.0, 8.0, 9.0, 0.1, 0.2, 0.2],
                    "damping": damping,
                },
            },
            "arm": {
                "name": "link",
                "mount": {},
                "links": [{"name": "link", "joint": joint, "body": link}],
                "end_effector": {"position": [0.4, 0.0, 0.0]},
            },
        },
        "horizon": 20,
        "substeps": 2,
        "references": {"position": [0.0] * 3, "rotation": np.eye(3), "end_effector": [0.6, 0.0, 0.35], "q": [0.0]},
        "weights": {"end_effector": 5.0, "twist": 0.1, "qd": 0.01},
        "terminal_weights": {"end_effector": 500.0, "twist": 20.0, "qd": 1.0, "attitude": 5.0},
        "input_weights": {"wrench": 1e-3, "joint_torque": 1e-2},
        "bounds": {
            "wrench": [[-8.0, 0.0, -8.0, 0.0, -2.0, 0.0], [8.0, 0.0, 8.0, 0.0, 2.0, 0.0]],
            "joint_torque": [[-1.5], [1.5]],
        },
    }


def main():
    made_with = f"CasADi {ca.__version__} with IPOPT, NumPy {np.__version__}, Python {platform.python_version()}"
    data = {"made_with": made_with, "problems": [solve(problem) for problem in problems()]}
    (HERE / "optimal_control.json").write_text(
        json.dumps(plain(data), separators=(",", ":")).replace('{"name"', '\n{"name"') + "\n"
    )


if __name__ == "__main__":
    main()
