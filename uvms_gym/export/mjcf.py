"""MJCF of a scene, for MuJoCo: a body per link, rigidly connected ones without joint."""

import math
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from uvms_gym._rotations import Floats
from uvms_gym.export.omissions import joints, text_of, water_and_vehicle
from uvms_gym.export.tree import Frame, Link, Matter, tree

#: Step of a scene without a recommended one, s.
STEP = 0.01
#: Minimum moment of inertia of a body with a joint, kg m^2, which MuJoCo needs.
SMALLEST = 1e-12


def export(scene: dict[str, Any]) -> tuple[str, list[str]]:
    """MJCF text of a scene as `load_scene` gives it, and the lines of what is left out."""
    links = tree(scene)
    root = ET.Element("mujoco", model=scene["name"])
    ET.SubElement(root, "compiler", angle="radian", eulerseq="XYZ")
    defaults = ET.SubElement(root, "default")
    ET.SubElement(defaults, "geom", type="box", mass="0", contype="0", conaffinity="0")
    ET.SubElement(defaults, "site", size="0.01")
    option = {"timestep": numbers((scene.get("integration") or {}).get("step", STEP)), "integrator": "implicitfast"}
    gravity = scene["water"]["gravity"]
    ET.SubElement(root, "option", option, gravity=numbers(gravity), density="0", viscosity="0")
    world = ET.SubElement(root, "worldbody")
    bodies: list[ET.Element] = []
    for link in links:
        parent = world if link.parent is None else bodies[link.parent]
        bodies.append(body := add_body(parent, link, free=not scene["vehicle"]["fixed"]))
        if not link.matter:
            ET.SubElement(body, "site", name=link.name)
            continue
        if weight := link.matter.mass * math.hypot(*gravity):
            body.set("gravcomp", numbers(link.matter.buoyancy / weight))
        _box(body, link, scene["vehicle"].get("shape") if link.parent is None else None)
    drives = ET.SubElement(root, "actuator")
    for thruster in scene["vehicle"]["thrusters"]:
        _thruster(bodies[0], drives, thruster, scene["vehicle"].get("thruster_lag"))
    thrusters = {thruster["name"] for thruster in scene["vehicle"]["thrusters"]}
    targets = [0.0] * len(scene["vehicle"]["thrusters"])
    moving = [(link.name, link.joint) for link in links if link.joint]
    for name, joint in moving:
        drive = ET.SubElement(drives, "position" if joint.get("servo") else "motor")
        # Actuators have one space of names.
        drive.set("name", f"joint {name}" if name in thrusters else name)
        _joint_drive(drive, name, joint)
        targets.append(joint["home"] if joint.get("servo") else 0.0)
    pose = [] if scene["vehicle"]["fixed"] else [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    if pose or moving:
        key = ET.SubElement(ET.SubElement(root, "keyframe"), "key", name="home")
        key.set("qpos", numbers([*pose, *(joint["home"] for _, joint in moving)]))
        if targets:
            key.set("ctrl", numbers(targets))
    lines = _omissions(scene, links)
    return text_of(root, scene, "MJCF", lines), lines


def _omissions(scene: dict[str, Any], links: list[Link]) -> list[str]:
    lines = water_and_vehicle(scene)
    if any(link.matter and link.matter.buoyancy for link in links):
        lines.append("centres of buoyancy: buoyancy (gravcomp) acts at the centres of mass, without righting moments")
    lines += joints(
        links,
        limits="stiffness and damping of end stops (ranges have MuJoCo's)",
        friction__coulomb="smooth Coulomb friction (frictionloss is constant)",
        friction__static="static friction",
        detent="detents",
        actuator="maximum torque of a linear actuator, by the angle",
        speed="maximum speed of references",
        prescribed="prescribed motion (a servo or motor drives the joint)",
    )
    if drawn := [link.name for link in links if link.meshes]:
        lines.append(f"meshes for pictures (boxes are written): {', '.join(drawn)}")
    light = [link.name for link in links if link.matter and _moves(link) and _light(link.matter)]
    if light:
        lines.append(f"moments of inertia below {SMALLEST:g} kg m2 (raised): {', '.join(light)}")
    return lines


def add_body(parent: ET.Element, link: Link, *, free: bool = True) -> ET.Element:
    """Add a body with its joint, without actuator, and its inertia."""
    body = ET.SubElement(parent, "body", {"name": link.name} | _pose(link.frame))
    if link.joint:
        kind, friction = "slide" if link.prismatic else "hinge", link.joint["friction"]
        joint = ET.SubElement(body, "joint", name=link.name, type=kind, axis=numbers(link.axis))
        terms = {"damping": friction["viscous"], "frictionloss": friction.get("coulomb")}
        if spring := link.joint.get("spring"):
            terms |= {"stiffness": spring["stiffness"], "springref": spring["rest"]}
        for key, value in (terms | {"armature": link.joint.get("rotor_inertia")}).items():
            if value:
                joint.set(key, numbers(value))
        if limits := link.joint.get("limits"):
            joint.set("range", numbers([limits["lower"], limits["upper"]]))
    elif link.parent is None and free:
        ET.SubElement(body, "freejoint", name=link.name)
    if link.matter:
        ET.SubElement(body, "inertial", _inertia(link.matter, _moves(link)))
    return body


def numbers(values: Any) -> str:
    """Numbers as text that reads back as the same numbers."""
    return " ".join(repr(float(x)).removesuffix(".0") for x in np.ravel(values))


def thruster_wrench(thruster: dict[str, Any]) -> Floats:
    """Wrench (6,) per newton of thrust at the thruster's position, in the vehicle's axes."""
    axis = np.array(thruster["axis"]) / np.linalg.norm(thruster["axis"])
    wrench = np.concatenate([axis, np.zeros(3)]) * (1.0 - (thruster.get("deduction") or 0.0))
    if (induced := thruster.get("induced")) is not None:
        force, moment = np.split(np.array(induced, dtype=np.float64), 2)
        wrench = wrench + np.concatenate([force, moment - np.cross(thruster["position"], force)])
    return wrench


def _moves(link: Link) -> bool:
    return link.joint is not None or link.parent is None


def _light(matter: Matter) -> bool:
    """True if a moment of inertia is below the minimum."""
    return bool(np.linalg.eigvalsh(matter.inertia)[0] < SMALLEST)


def _pose(frame: Frame) -> dict[str, str]:
    parts = {"pos": frame.position, "euler": frame.rpy}
    return {key: numbers(part) for key, part in parts.items() if part.any()}


def _inertia(matter: Matter, moves: bool) -> dict[str, str]:
    found = {"pos": numbers(matter.center_of_mass), "mass": numbers(matter.mass)}
    c = matter.inertia + SMALLEST * np.eye(3) if moves and _light(matter) else matter.inertia
    moments = np.diag(c)
    if (c == np.diag(moments)).all():
        return found | {"diaginertia": numbers(moments)}
    return found | {"fullinertia": numbers([*moments, c[0, 1], c[0, 2], c[1, 2]])}


def _box(body: ET.Element, link: Link, shape: dict[str, Any] | None) -> None:
    """Box for pictures, without mass and contact."""
    edges, frame, colour = link.box(shape)
    ET.SubElement(body, "geom", {"size": numbers(edges / 2.0)} | _pose(frame), rgba=numbers([*colour, 1.0]))


def _thruster(body: ET.Element, drives: ET.Element, thruster: dict[str, Any], lag: float | None) -> None:
    name, limits = thruster["name"], numbers(thruster["limits"])
    site = f"thruster {name}"
    ET.SubElement(body, "site", name=site, pos=numbers(thruster["position"]))
    drive = {"name": name, "site": site, "gear": numbers(thruster_wrench(thruster))}
    drive |= {"ctrlrange": limits, "forcerange": limits}
    lag = thruster.get("lag", lag)
    if lag:
        drive |= {"dyntype": "filterexact", "dynprm": numbers(lag)}
    ET.SubElement(drives, "general", drive)


def _joint_drive(drive: ET.Element, name: str, joint: dict[str, Any]) -> None:
    drive.set("joint", name)
    if servo := joint.get("servo"):
        drive.set("kp", numbers(servo["kp"]))
        drive.set("kv", numbers(servo["kd"]))
    if (effort := joint.get("effort")) is not None:
        drive.set("forcerange", numbers([-effort, effort]))
