"""Writes tests/golden/imported_robots.json: robots of URDF files by Pinocchio's own reader of such files.

Run from the repository root: python tests/golden/imported_robots.py
Made with Python 3.11, pin (PyPI) 4.1.0, NumPy 2.4.6.

`pinocchio.buildModelFromUrdf` reads each file of `ROBOTS`, with a free-flyer at its root where the file has a hull, and
on a fixed base where it is an arm. Joints that the importer freezes are frozen here at the same coordinates. The mass
matrix, the bias (Coriolis and gravity), gravity's part of it and the poses of the named links are in the order
`[V; qd]` and of the joints listed, which is the importer's.
"""

import json
from pathlib import Path

import numpy as np
import pinocchio as pin

ROOT = Path(__file__).parents[1]
#: Files, whether they have a hull, frozen joints with their coordinates, and the links whose poses count.
ROBOTS = {
    "two-arms-and-grippers": (
        True,
        {"left_propeller_joint": 0.0, "right_propeller_joint": 0.0, "sonar": 0.25},
        ["left_grasp", "mast_camera"],
    ),
    "arm-with-a-branch": (False, {}, ["tool", "lamp"]),
    "vehicle-and-arm": (True, {}, ["fore"]),
}
STATES = 3


def matrix(pose: pin.SE3) -> list[list[float]]:
    return pose.homogeneous.tolist()


def solve(name: str, free: bool, frozen: dict[str, float], frames: list[str]) -> dict[str, object]:
    path = str(ROOT / f"data/robots/{name}.urdf")
    model = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer()) if free else pin.buildModelFromUrdf(path)
    reference = pin.neutral(model)
    for joint, at in frozen.items():
        index = model.joints[model.getJointId(joint)]
        reference[index.idx_q : index.idx_q + index.nq] = at if index.nq == 1 else (np.cos(at), np.sin(at))
    model = pin.buildReducedModel(model, [model.getJointId(joint) for joint in frozen], reference)
    data, first = model.createData(), 2 if free else 1
    joints = sorted(list(model.names)[first:], key=order(path).index)
    rng = np.random.default_rng(1)
    cases = []
    for _ in range(STATES):
        angles = {joint: round(float(rng.uniform(-1.5, 1.5)), 4) for joint in joints}
        rates = {joint: round(float(rng.uniform(-1.0, 1.0)), 4) for joint in joints}
        turn = pin.Quaternion(rng.normal(size=4)).normalized()
        base, twist = pin.SE3(turn, rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 6)
        q, v, columns = pin.neutral(model), np.zeros(model.nv), list(range(6)) if free else []
        if free:
            q[:7], v[:6] = pin.SE3ToXYZQUAT(base), twist
        for joint in joints:
            at = model.joints[model.getJointId(joint)]
            angle = angles[joint]
            q[at.idx_q : at.idx_q + at.nq] = angle if at.nq == 1 else (np.cos(angle), np.sin(angle))
            v[at.idx_v] = rates[joint]
            columns.append(at.idx_v)
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = pin.nonLinearEffects(model, data, q, v).copy()
        gravity = pin.computeGeneralizedGravity(model, data, q).copy()
        pin.framesForwardKinematics(model, data, q)
        case = {
            "q": [angles[joint] for joint in joints],
            "qd": [rates[joint] for joint in joints],
            "mass_matrix": mass[np.ix_(columns, columns)].tolist(),
            "bias": bias[columns].tolist(),
            "gravity": gravity[columns].tolist(),
            "poses": {frame: matrix(data.oMf[model.getFrameId(frame)]) for frame in frames},
        }
        if free:
            quaternion = base.rotation
            case |= {"rotation": quaternion.tolist(), "position": base.translation.tolist(), "twist": twist.tolist()}
        cases.append(case)
    return {"file": name, "free": free, "joints": joints, "cases": cases}


def order(path: str) -> list[str]:
    """Names of the joints, in the order of the tree: each after its parent's, branches one after the other."""
    import xml.etree.ElementTree as xml

    root = xml.parse(path).getroot()
    below: dict[str, list[tuple[str, str]]] = {}
    children = set()
    for joint in root.findall("joint"):
        ends = joint.find("parent"), joint.find("child")
        parent, child = (end.attrib["link"] for end in ends if end is not None)
        below.setdefault(parent, []).append((joint.attrib["name"], child))
        children.add(child)
    names: list[str] = []

    def visit(link: str) -> None:
        for name, child in below.get(link, []):
            names.append(name)
            visit(child)

    for link in root.findall("link"):
        if link.attrib["name"] not in children:
            visit(link.attrib["name"])
    return names


if __name__ == "__main__":
    versions = {"python": "3.11", "pinocchio": pin.__version__, "numpy": np.__version__}
    robots = [solve(name, *rest) for name, rest in ROBOTS.items()]
    text = json.dumps({"made_with": versions, "robots": robots}, separators=(",", ":"))
    (ROOT / "golden/imported_robots.json").write_text(text.replace('{"q"', '\n{"q"') + "\n")
