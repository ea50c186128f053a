"""Writes tests/golden/mujoco_dry.json and mujoco_motion.json: dry forward dynamics, and two motions, by MuJoCo.

Run from the repository root: python tests/golden/mujoco_dry.py (some seconds)
Made with Python 3.11, mujoco 4.0.0, NumPy 2.4.6.

The MJCF is made from the scene's chain: one MuJoCo body per moving body, one welded child body with an inertial frame
per item of mass; no geoms, so no contacts; joint damping is the scene's viscous friction. MuJoCo's free joint has its
linear velocity in world axes and its angular velocity in body axes, and `qacc` is the rate of just these numbers:

    v = R^T v_w,   v' = R^T v_w' - omega x v

`mj_forward` gives the acceleration; what an integrator makes of damping is no part of it. External wrenches on the
moving bodies go through `mj_applyFT`. Against Pinocchio, on its very states, the script checks itself.

The motions, written to tests/golden/mujoco_motion.json, are dry chains over 1 s under constant joint torques, by
MuJoCo's RK4 at a step of 1e-5 s; `step_effect` is the maximum change of any number at the end by the last halving of
the step.
"""

import json
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
from scene_model import HERE, random_cases, random_state, read, save

SCENES = [
    "petasus-pum-dry",
    "petasus-pum-viscous",
    "bluerov2-heavy-alpha5-dry",
    "random-fixed-loading-dry",
    "random-joint-loading-dry",
    "random-nine-joints-viscous",
    "random-fixed-base-dry",
    "random-fixed-base-viscous",
    "random-no-links-dry",
    "random-no-arm-dry",
    "petasus-pum-geared",
    "random-nine-joints-geared",
    "random-fixed-base-geared",
]
MOTIONS = ["petasus-pum-viscous", "random-fixed-base-viscous"]
MOTION_TIME = 1.0
MOTION_STEPS = (50_000, 100_000)


def numbers(values):
    return " ".join(repr(float(x)) for x in np.ravel(values))


def quaternion(rotation):
    """[w, x, y, z] of a rotation matrix, from the largest of its four (Shepperd)."""
    r = np.asarray(rotation, dtype=float)
    products = np.array(
        [
            [1 + r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [0, 1 + r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [0, 0, 1 - r[0, 0] + r[1, 1] - r[2, 2], r[1, 2] + r[2, 1]],
            [0, 0, 0, 1 - r[0, 0] - r[1, 1] + r[2, 2]],
        ]
    )
    products += np.triu(products, 1).T
    row = products[np.argmax(np.diag(products))]
    return row / np.linalg.norm(row)


def frame(transform):
    return {"pos": numbers(transform[:3, 3]), "quat": numbers(quaternion(transform[:3, :3]))}


def build(model, state):
    """MuJoCo's model and the index of each moving body."""
    root = ET.Element("mujoco")
    ET.SubElement(root, "compiler", angle="radian", autolimits="false", boundmass="0", boundinertia="0")
    ET.SubElement(root, "option", gravity=numbers(model.gravity), density="0", viscosity="0", integrator="RK4")
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = state["rotation"], state["position"]
    bodies = [ET.SubElement(ET.SubElement(root, "worldbody"), "body", name="0", **frame(place))]
    if not model.fixed:
        ET.SubElement(bodies[0], "freejoint")
    for i, joint in enumerate(model.joints, 1):
        body = ET.SubElement(bodies[-1], "body", name=str(i), **frame(joint.placement))
        kind = "slide" if joint.prismatic else "hinge"
        losses = {"damping": numbers(joint.viscous), "armature": numbers(joint.rotor_inertia)}
        ET.SubElement(body, "joint", type=kind, axis=numbers(joint.axis), **losses)
        bodies.append(body)
    for item in model.items:
        if model.fixed and item.owner == 0:
            continue
        body = ET.SubElement(bodies[item.owner], "body", **frame(item.placement))
        c = item.inertia
        full = [c[0, 0], c[1, 1], c[2, 2], c[0, 1], c[0, 2], c[1, 2]]
        pos, mass = numbers(item.center_of_mass), numbers(item.mass)
        ET.SubElement(body, "inertial", pos=pos, mass=mass, fullinertia=numbers(full))
    result = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    return result, [result.body(str(i)).id for i in range(len(bodies))]


class Robot:
    """A scene in MuJoCo at a state."""

    def __init__(self, model, state):
        self.fixed = model.fixed
        self.model, self.bodies = build(model, state)
        self.data = mujoco.MjData(self.model)
        rotation, twist = np.array(state["rotation"], dtype=float), np.array(state["twist"], dtype=float)
        base = [] if self.fixed else [state["position"], quaternion(rotation)]
        rates = [] if self.fixed else [rotation @ twist[:3], twist[3:]]
        self.data.qpos[:] = np.concatenate([*base, state["q"]])
        self.data.qvel[:] = np.concatenate([*rates, state["qd"]])
        mujoco.mj_forward(self.model, self.data)

    def rotation(self):
        return self.data.xmat[self.bodies[0]].reshape(3, 3).copy()

    def twist(self):
        """Body twist of the vehicle."""
        if self.fixed:
            return np.zeros(6)
        return np.concatenate([self.rotation().T @ self.data.qvel[:3], self.data.qvel[3:6]])

    def joints(self, values):
        """The joints' part of positions, velocities or forces."""
        return values[len(values) - (self.model.nv - 6 * (not self.fixed)) :]

    def apply(self, state):
        """Joint torques, and wrenches in body axes at the origins of the moving bodies."""
        force = np.zeros(self.model.nv)
        self.joints(force)[:] = state["joint_torque"]
        wrenches = np.array(state["external"], dtype=float)
        wrenches[0] += state["wrench"]
        for body, wrench in zip(self.bodies, wrenches):
            turn, point = self.data.xmat[body].reshape(3, 3), self.data.xpos[body]
            mujoco.mj_applyFT(self.model, self.data, turn @ wrench[:3], turn @ wrench[3:], point, body, force)
        self.data.qfrc_applied[:] = force

    def acceleration(self):
        """[V'; q'']."""
        mujoco.mj_forward(self.model, self.data)
        assert self.data.ncon == self.data.nefc == 0
        qacc = self.data.qacc
        if self.fixed:
            return np.concatenate([np.zeros(6), qacc])
        twist = self.twist()
        linear = self.rotation().T @ qacc[:3] - np.cross(twist[3:], twist[:3])
        return np.concatenate([linear, qacc[3:]])


def still(model):
    """No wrench on any body."""
    return {"wrench": np.zeros(6), "external": np.zeros((1 + len(model.joints), 6))}


def check_against_pinocchio():
    golden = json.loads((HERE / "pinocchio_dry.json").read_text())
    for entry in golden["scenes"]:
        model, _ = read(entry["scene"])
        worst = 0.0
        for case in entry["cases"]:
            robot = Robot(model, case)
            robot.apply(still(model) | case)
            theirs = np.array(case["expected"]["acceleration"])
            worst = max(worst, np.abs(robot.acceleration() - theirs).max() / np.abs(theirs).max())
        print(f"{entry['scene']}: differs from Pinocchio by {worst:.1e}")
        assert worst < 1e-11


def case(_, rng, model):
    state = random_state(rng, model)
    robot = Robot(model, state)
    robot.apply(state)
    return state | {"expected": {"acceleration": robot.acceleration()}}


def end(model, state, steps):
    robot = Robot(model, state)
    robot.model.opt.timestep = MOTION_TIME / steps
    robot.apply(state)
    mujoco.mj_step(robot.model, robot.data, steps)
    mujoco.mj_forward(robot.model, robot.data)
    position = robot.data.xpos[robot.bodies[0]].copy()
    q, qd = (robot.joints(values).copy() for values in (robot.data.qpos, robot.data.qvel))
    return {"position": position, "rotation": robot.rotation(), "twist": robot.twist(), "q": q, "qd": qd}


def motion(name, index):
    model, _ = read(name)
    state = random_state(np.random.default_rng([5, index]), model) | still(model)
    # Light links under greater torques would spin at a hundred rad/s.
    state["joint_torque"] = 0.02 * state["joint_torque"]
    coarse, fine = (end(model, state, steps) for steps in MOTION_STEPS)
    effect = max(np.abs(fine[key] - coarse[key]).max() for key in fine)
    print(f"{name}: steps of 2e-5 and 1e-5 s differ by {effect:.1e}")
    assert effect < 1e-11
    result = {"scene": name, "time": MOTION_TIME, "step_effect": effect, "joint_torque": state["joint_torque"]}
    return result | {"start": {key: state[key] for key in fine}, "end": fine}


if __name__ == "__main__":
    check_against_pinocchio()
    save("mujoco_dry.json", random_cases(SCENES, 4, case), mujoco=mujoco.__version__)
    motions = [motion(name, index) for index, name in enumerate(MOTIONS)]
    save("mujoco_motion.json", motions, mujoco=mujoco.__version__)
