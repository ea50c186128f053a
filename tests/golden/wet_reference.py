"""Writes tests/golden/wet_reference.json: wet forward dynamics by Lagrange's equations at 90 digits.

Run from the repository root: python tests/golden/wet_reference.py [SCENE ...] (about 8 minutes on one core for all;
named scenes only are made anew and the rest kept).
Made with Python 3.11, mpmath 1.3.0, NumPy 2.4.6.

Nothing of the simulator's formulation is used: no adjoint, no bias wrench, no recursion. There are true coordinates
xi = (x, a, q), with vehicle pose (p0 + x, R0 Rz(a3) Ry(a2) Rx(a1)), forward kinematics T_i(xi) as products of
transforms, and numerical differentiation of these at high precision (central differences, 22 digits of step):

- Jacobian of any frame: columns (T^-1 dT/dxi_k), so a frame's body twist is J(xi) xi'.
- Kinetic energy: rigid, about each centre of mass, plus that of the water, at each hydrodynamic frame. By Galilean
  invariance all is written in the inertial frame that moves with the water, where x' = R v - v_c.
- Lagrange: M xi'' = Q - (dM/dt) xi' + 1/2 grad(xi' M xi'), with dM/dxi by differences of M(xi).
- Q by virtual work: weight and buoyancy through the differential of their points; drag, vehicle and external wrenches
  through the Jacobians of the frames they act in; actuators (within their effort), friction and end stops on q.
- Back to the vehicle's absolute body twist: V = J xi', V' = J xi'' + (dJ/dt) xi', with absolute x'.

Checked here: two step sizes agree to 1e-25; the mass matrix is positive definite (Cholesky); without water the results
equal Pinocchio's golden data to 1e-11; and V' = V_r' - [omega x R^T v_c; 0].
"""

import json
import sys

import mpmath
import numpy as np
from mpmath import mp, mpf
from scene_model import HERE, homogeneous, random_state, read, rotation_about, rotation_rpy, save, translation

mp.dps = 90
STEP = mpf(10) ** -22
SCENES = [
    "petasus-pum-frozen",
    "bluerov2-heavy-alpha5-frozen",
    "rexrov-frozen",
    "random-fixed-loading",
    "random-joint-loading",
    "random-nine-joints",
    "random-fixed-base",
    "random-no-links",
    "random-no-arm",
    "petasus-pum-coupled",
]
STATES = 5


def central(function, step, dofs):
    """Partial derivatives of an array-valued function at xi = 0."""
    derivatives = []
    for k in range(dofs):
        offset = np.array([mpf(0)] * dofs, dtype=object)
        offset[k] = step
        derivatives.append((function(offset) - function(-offset)) / (2 * step))
    return np.array(derivatives)


class Lagrangian:
    """One scene in one configuration; everything here depends on the configuration only."""

    def __init__(self, model, reader, state, step=STEP):
        self.model, self.reader, self.step = model, reader, step
        self.dofs = 6 + len(model.joints)
        rotation = reader.array(state["rotation"])
        for _ in range(6):  # Newton: the stored matrix is orthonormal to 16 digits only
            rotation = rotation @ (3 * reader.array(np.eye(3)) - rotation.T @ rotation) / 2
        self.base = homogeneous(rotation, reader.array(state["position"]), reader)
        self.q = reader.array(state["q"])
        # Frames that carry wrenches or inertia, as (owner, placement): moving bodies, centres of mass, water frames.
        self.moving = [(i, reader.array(np.eye(4))) for i in range(1 + len(model.joints))]
        self.centres = [(b.owner, b.placement @ translation(b.center_of_mass, reader)) for b in model.items]
        self.water = [(b.owner, b.placement @ b.hydrodynamic_frame) for b in model.items]
        self.inertias = []
        for body in model.items:
            rigid = reader.array(np.zeros((6, 6)))
            rigid[:3, :3] = body.mass * reader.array(np.eye(3))
            rigid[3:, 3:] = body.inertia
            self.inertias.append(rigid)
        self.inertias += [body.added_mass for body in model.items]

        zero = np.array([mpf(0)] * self.dofs, dtype=object)
        self.jacobians = self.frame_jacobians(zero)
        self.mass = self.mass_matrix(zero)
        self.mass_gradient = central(self.mass_matrix, step, self.dofs)
        self.vehicle_gradient = central(lambda xi: self.frame_jacobians(xi)[0], step, self.dofs)
        self.point_gradients = central(self.points, step, self.dofs)

    def poses(self, xi):
        reader = self.reader
        poses = [translation(xi[:3], reader) @ self.base @ rotation_rpy(xi[3:6], reader)]
        for joint, q in zip(self.model.joints, self.q + xi[6:]):
            motion = translation(q * joint.axis, reader) if joint.prismatic else rotation_about(joint.axis, q, reader)
            poses.append(poses[-1] @ joint.placement @ motion)
        return poses

    def frames(self, xi):
        poses = self.poses(xi)
        return np.array([poses[i] @ placement for i, placement in self.moving + self.centres + self.water])

    def frame_jacobians(self, xi):
        """Body Jacobian (6, dofs) of each frame."""
        here = self.frames(xi)
        jacobians = np.empty((len(here), 6, self.dofs), dtype=object)
        for k, change in enumerate(central(lambda d: self.frames(xi + d), self.step, self.dofs)):
            for frame, (pose, rate) in enumerate(zip(here, change)):
                spin = pose[:3, :3].T @ rate[:3, :3]
                jacobians[frame, :3, k] = pose[:3, :3].T @ rate[:3, 3]
                jacobians[frame, 3:, k] = spin[2, 1], spin[0, 2], spin[1, 0]
        return jacobians

    def mass_matrix(self, xi):
        jacobians = self.frame_jacobians(xi)[len(self.moving) :]
        return sum(J.T @ inertia @ J for J, inertia in zip(jacobians, self.inertias))

    def points(self, xi):
        """World positions of all centres of mass, then of buoyancy."""
        poses = self.poses(xi)
        local = [(b.owner, b.placement, b.center_of_mass) for b in self.model.items]
        local += [(b.owner, b.placement, b.center_of_buoyancy) for b in self.model.items]
        return np.array([(poses[i] @ P)[:3, :3] @ c + (poses[i] @ P)[:3, 3] for i, P, c in local])

    def joint_forces(self, state):
        """Actuator, friction and end stop of each joint."""
        forces = []
        for joint, q, qd, command in zip(self.model.joints, self.q, state["qd"], state["joint_torque"]):
            qd, force = mpf(qd), mpf(command)
            assert joint.effort is None or abs(force) <= joint.effort
            force -= joint.viscous * qd
            if joint.coulomb:
                force -= joint.coulomb * qd / mp.sqrt(qd**2 + joint.coulomb_speed**2)
            if joint.limits is not None:
                lower, upper, stiffness, damping = joint.limits
                excess = max(q - upper, 0) + min(q - lower, 0)
                force -= stiffness * excess + damping * abs(excess) * qd
            forces.append(force)
        return np.array(forces, dtype=object)

    def acceleration(self, state, current):
        """[V'; q''] for the state's velocities and inputs, in a uniform current (world axes)."""
        model, array, bodies = self.model, self.reader.array, len(self.moving)
        twist, current = array(state["twist"]), array(current)
        absolute = np.concatenate([self.base[:3, :3] @ twist[:3], twist[3:], array(state["qd"])])
        rates = absolute.copy()
        rates[:3] -= current

        force = np.array([mpf(0)] * self.dofs, dtype=object)
        force[6:] += self.joint_forces(state)
        force += self.jacobians[0].T @ array(state["wrench"])
        for J, wrench in zip(self.jacobians[:bodies], state["external"]):
            force += J.T @ array(wrench)
        for body, J in zip(model.items, self.jacobians[-len(model.items) :]):
            flow = J @ rates
            force -= J.T @ (body.linear @ flow + body.quadratic @ (flow * abs(flow)))
        loads = [b.mass * model.gravity for b in model.items]
        loads += [-model.density * b.volume * model.gravity for b in model.items]
        for i, load in enumerate(loads):
            force += self.point_gradients[:, i] @ load

        # dM/dt xi' and half the gradient of xi' M xi'; gradient index first.
        momentum_rates = self.mass_gradient @ rates
        force += -(rates @ momentum_rates) + momentum_rates @ rates / 2
        if model.fixed:
            solution = mpmath.lu_solve(mpmath.matrix(self.mass[6:, 6:].tolist()), mpmath.matrix(force[6:].tolist()))
            return np.concatenate([array(np.zeros(6)), np.array(list(solution), dtype=object)])
        solution = mpmath.cholesky_solve(mpmath.matrix(self.mass.tolist()), mpmath.matrix(force.tolist()))
        solution = np.array(list(solution), dtype=object)
        drift = sum(rate * gradient for rate, gradient in zip(absolute, self.vehicle_gradient))
        return np.concatenate([self.jacobians[0] @ solution + drift @ absolute, solution[6:]])


def distance(a, b):
    return max(abs(a - b)) / max(abs(b))


def check_against_pinocchio():
    golden = json.loads((HERE / "pinocchio_dry.json").read_text())
    for entry in golden["scenes"]:
        model, reader = read(entry["scene"], mpf, mp)
        state = entry["cases"][0] | {"external": []}
        ours = Lagrangian(model, reader, state).acceleration(state, np.zeros(3))
        error = distance(ours, reader.array(entry["cases"][0]["expected"]["acceleration"]))
        print(f"{entry['scene']}: differs from Pinocchio by {float(error):.1e}", flush=True)
        assert error < 1e-11


def check_current():
    """Galilei: V_r' in still water is V' + [omega x R^T v_c; 0] in the current, for V_r = V - [R^T v_c; 0]."""
    model, reader = read("random-no-arm", mpf, mp)
    state = random_state(np.random.default_rng(5), model)
    lagrangian = Lagrangian(model, reader, state)
    current = reader.array([0.3, -0.5, 0.2])
    carried = lagrangian.base[:3, :3].T @ current
    spin = reader.array(state["twist"][3:])
    relative = state | {"twist": np.concatenate([reader.array(state["twist"][:3]) - carried, spin])}
    turned = np.concatenate([np.cross(spin, carried), reader.array(np.zeros(3))])
    absolute = lagrangian.acceleration(state, current)
    assert distance(lagrangian.acceleration(relative, np.zeros(3)), absolute + turned) < mpf(10) ** -30


def cases(name):
    model, reader = read(name, mpf, mp)
    rng = np.random.default_rng([2, SCENES.index(name)])
    result = []
    for i in range(STATES):
        state = random_state(rng, model, beyond_limits=True)
        lagrangian = Lagrangian(model, reader, state)
        for current in (np.zeros(3), np.round(rng.normal(size=3) * 0.5, 3)):
            acceleration = lagrangian.acceleration(state, current)
            if i == 0:
                other = Lagrangian(model, reader, state, STEP * 7).acceleration(state, current)
                assert distance(other, acceleration) < mpf(10) ** -25
            result.append(state | {"current": current, "expected": {"acceleration": acceleration}})
    print(name, flush=True)
    return result


def main(names):
    kept = {}
    if names:
        golden = json.loads((HERE / "wet_reference.json").read_text())
        kept = {entry["scene"]: entry["cases"] for entry in golden["scenes"]}
    else:
        check_current()
        check_against_pinocchio()
    scenes = [{"scene": name, "cases": cases(name) if not names or name in names else kept[name]} for name in SCENES]
    save("wet_reference.json", scenes, mpmath=mpmath.__version__)


if __name__ == "__main__":
    main(sys.argv[1:])
