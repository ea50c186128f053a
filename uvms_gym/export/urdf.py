"""URDF of a scene: a link per link of the scene, rigidly connected ones by fixed joints. [wiki.ros.org/urdf/XML]"""

from typing import Any
from xml.etree import ElementTree as ET

from uvms_gym.export.mjcf import numbers
from uvms_gym.export.omissions import joints, text_of, water_and_vehicle
from uvms_gym.export.tree import Frame, Link, tree

#: Limit in place of none, where URDF needs a number: m, N m or N, rad/s or m/s.
UNLIMITED = 1e6


def export(scene: dict[str, Any]) -> tuple[str, list[str]]:
    """URDF text of a scene as `load_scene` gives it, and the lines of what is left out."""
    links = tree(scene)
    root = ET.Element("robot", name=scene["name"])
    ET.SubElement(root, "link", name="world")
    for link in links:
        _link(root, link, scene["vehicle"].get("shape") if link.parent is None else None)
        parent = "world" if link.parent is None else links[link.parent].name
        free = "fixed" if scene["vehicle"]["fixed"] else "floating"
        _joint(root, link, parent, free if link.parent is None else "fixed")
    lines = _omissions(scene, links)
    return text_of(root, scene, "URDF", lines), lines


def _omissions(scene: dict[str, Any], links: list[Link]) -> list[str]:
    lines = water_and_vehicle(scene)
    lines.insert(0, "water and gravity: density, volumes and centres of buoyancy")
    if thrusters := scene["vehicle"]["thrusters"]:
        lines.append(f"thrusters: {', '.join(thruster['name'] for thruster in thrusters)}")
    lines += joints(
        links,
        servo="gains of servos",
        home="joint coordinates at the start",
        limits="stiffness and damping of end stops",
        friction__coulomb="smooth Coulomb friction (<dynamics friction> is constant)",
        friction__static="static friction",
        spring="springs",
        detent="detents",
        actuator="maximum torque of a linear actuator, by the angle",
        prescribed="prescribed motion",
        rotor_inertia="rotor inertia (attribute armature of <dynamics>, which few programs read)",
    )
    for key, text in (("effort", "torques"), ("speed", "speeds")):
        if unlimited := [link.name for link in links if link.joint and link.joint.get(key) is None]:
            lines.append(f"unlimited {text} ({UNLIMITED:g} is written): {', '.join(unlimited)}")
    if endless := [link.name for link in links if link.prismatic and not (link.joint or {}).get("limits")]:
        lines.append(f"unlimited ranges ({UNLIMITED:g} m is written): {', '.join(endless)}")
    return lines


def _link(root: ET.Element, link: Link, shape: dict[str, Any] | None) -> None:
    element = ET.SubElement(root, "link", name=link.name)
    for mesh in link.meshes:
        visual = ET.SubElement(element, "visual")
        _origin(visual, Frame.of(mesh))
        scale = numbers(mesh["scale"])
        ET.SubElement(ET.SubElement(visual, "geometry"), "mesh", filename=f"file://{mesh['file']}", scale=scale)
    if not link.matter:
        return
    c = link.matter.inertia
    moments = {"ixx": c[0, 0], "ixy": c[0, 1], "ixz": c[0, 2], "iyy": c[1, 1], "iyz": c[1, 2], "izz": c[2, 2]}
    inertial = ET.SubElement(element, "inertial")
    _origin(inertial, Frame(link.matter.center_of_mass))
    ET.SubElement(inertial, "mass", value=numbers(link.matter.mass))
    ET.SubElement(inertial, "inertia", {name: numbers(moment) for name, moment in moments.items()})
    if link.meshes:
        return
    edges, frame, colour = link.box(shape)
    visual = ET.SubElement(element, "visual")
    _origin(visual, frame)
    ET.SubElement(ET.SubElement(visual, "geometry"), "box", size=numbers(edges))
    material = ET.SubElement(visual, "material", name=f"{link.name} colour")
    ET.SubElement(material, "color", rgba=numbers([*colour, 1.0]))


def _joint(root: ET.Element, link: Link, parent: str, rigid: str) -> None:
    """Joint above a link, with the link's name if it moves; `rigid` is its type where the scene has none."""
    joint = link.joint
    limits = (joint or {}).get("limits")
    turning = "revolute" if limits else "continuous"
    kind = rigid if joint is None else "prismatic" if link.prismatic else turning
    name = link.name if joint else f"{link.name}_{rigid}"
    element = ET.SubElement(root, "joint", name=name, type=kind)
    _origin(element, link.frame)
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=link.name)
    if joint is None:
        return
    ET.SubElement(element, "axis", xyz=numbers(link.axis))
    bound = {key: numbers(UNLIMITED if (x := joint.get(name)) is None else x) for key, name in _BOUNDS.items()}
    if limits or link.prismatic:
        lower, upper = (limits["lower"], limits["upper"]) if limits else (-UNLIMITED, UNLIMITED)
        bound |= {"lower": numbers(lower), "upper": numbers(upper)}
    ET.SubElement(element, "limit", bound)
    dynamics = {"damping": joint["friction"]["viscous"], "friction": joint["friction"]["coulomb"]}
    if rotor := joint.get("rotor_inertia"):
        dynamics["armature"] = rotor
    ET.SubElement(element, "dynamics", {key: numbers(value) for key, value in dynamics.items()})


#: Keys of a joint of a scene, by attributes of <limit>.
_BOUNDS = {"effort": "effort", "velocity": "speed"}


def _origin(parent: ET.Element, frame: Frame) -> None:
    parts = {"xyz": frame.position, "rpy": frame.rpy}
    if given := {key: numbers(part) for key, part in parts.items() if part.any()}:
        ET.SubElement(parent, "origin", given)
