"""Writes tests/golden/pinocchio_dry.json: dry forward dynamics by Pinocchio.

Run from the repository root: python tests/golden/pinocchio_dry.py
Made with Python 3.11, pin (PyPI) 4.1.0, NumPy 2.4.6.

Each moving body is a Pinocchio joint: a free-flyer for the vehicle (or a fixed placement of the first joint where the
vehicle is held), then unaligned revolute and prismatic joints. Pinocchio's free-flyer velocity is the body twist
[v; omega] and its acceleration the time derivative of those six components, which is the convention here too.
`mass_matrix`, `bias` (Pinocchio's nle: Coriolis and gravity, M a + bias = applied), `end_effector` (4x4 in the world)
and `jacobian` (end-effector body twist per [V; qd]) leave out the vehicle's six where it is held. To keep the file
small they are given for the first few states of each scene.
"""

import numpy as np
import pinocchio as pin
from scene_model import random_cases, random_state, save

SCENES = [
    "petasus-pum-dry",
    "bluerov2-heavy-alpha5-dry",
    "random-fixed-loading-dry",
    "random-joint-loading-dry",
    "random-nine-joints-dry",
    "random-fixed-base-dry",
    "random-no-links-dry",
    "random-no-arm-dry",
    "petasus-pum-geared",
    "random-nine-joints-geared",
    "random-fixed-base-geared",
]
DETAILED = 4


def se3(transform):
    return pin.SE3(transform[:3, :3], transform[:3, 3])


def build(model, base):
    """Pinocchio's model and the joint index of each moving body."""
    result = pin.Model()
    result.gravity = pin.Motion(model.gravity, np.zeros(3))
    if model.fixed:
        index = [0]
    else:
        index = [result.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "vehicle")]
    for i, joint in enumerate(model.joints):
        kind = pin.JointModelPrismaticUnaligned if joint.prismatic else pin.JointModelRevoluteUnaligned
        placement = se3(joint.placement)
        if model.fixed and i == 0:
            placement = base * placement
        index.append(result.addJoint(index[-1], kind(joint.axis), placement, f"joint {i}"))
    for item in model.items:
        if index[item.owner] > 0:
            inertia = pin.Inertia(item.mass, item.center_of_mass, item.inertia)
            result.appendBodyToJoint(index[item.owner], inertia, se3(item.placement))
    if model.joints:
        result.armature = np.concatenate(
            [np.zeros(result.nv - len(model.joints)), [j.rotor_inertia for j in model.joints]]
        )
    owner, placement = model.end_effector
    frame = result.addFrame(pin.Frame("end effector", index[owner], se3(placement), pin.FrameType.OP_FRAME))
    return result, frame


def solve(model, state, detailed):
    base = pin.SE3(np.array(state["rotation"]), state["position"])
    robot, frame = build(model, base)
    data = robot.createData()
    if model.fixed:
        q, v, tau = state["q"], state["qd"], state["joint_torque"]
    else:
        q = np.concatenate([pin.SE3ToXYZQUAT(base), state["q"]])
        v = np.concatenate([state["twist"], state["qd"]])
        tau = np.concatenate([state["wrench"], state["joint_torque"]])
    acceleration = pin.aba(robot, data, q, v, tau).copy()
    mass_matrix = pin.crba(robot, data, q)
    mass_matrix = np.triu(mass_matrix) + np.triu(mass_matrix, 1).T
    bias = pin.nonLinearEffects(robot, data, q, v).copy()
    size = np.abs(mass_matrix) @ np.abs(acceleration) + np.abs(bias) + np.abs(tau)
    residual = np.abs(mass_matrix @ acceleration + bias - tau) / size.max()
    assert residual.max() < 1e-12, residual.max()
    result = {"acceleration": np.concatenate([np.zeros(6), acceleration]) if model.fixed else acceleration}
    if detailed:
        jacobian = pin.computeFrameJacobian(robot, data, q, frame, pin.ReferenceFrame.LOCAL)
        pin.framesForwardKinematics(robot, data, q)
        result |= {
            "mass_matrix": mass_matrix,
            "bias": bias,
            "end_effector": data.oMf[frame].homogeneous,
            "jacobian": jacobian,
        }
    return result


def case(i, rng, model):
    state = random_state(rng, model)
    state.pop("external")
    return state | {"expected": solve(model, state, i < DETAILED)}


if __name__ == "__main__":
    save("pinocchio_dry.json", random_cases(SCENES, 1, case), pinocchio=pin.__version__)
