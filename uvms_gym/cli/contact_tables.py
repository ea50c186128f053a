"""Tables of a scene's contact: spheres, shapes and fixtures."""

from typing import Any

from uvms_gym._scene import surroundings
from uvms_gym.cli.output import table

_LAW = ("stiffness", "dissipation", "ramp", "friction", "slip_speed")
_PLACE = ("x m", "y m", "z m")


def show_contact(scene: dict[str, Any]) -> None:
    """Print spheres, shapes and fixtures of a scene."""
    found = surroundings(scene)
    spheres = [
        (sphere["name"], sphere["on"], *_numbers(*sphere["position"], sphere["radius"])) for sphere in found["spheres"]
    ]
    if spheres:
        title = "Spheres of contact, in the frames of their bodies"
        table(title, ("sphere", "on", *_PLACE, "radius m"), spheres, text_columns=2)
    shapes, laws = [], []
    for shape in found["shapes"]:
        shapes.append((shape["name"], shape["on"], shape["kind"], _size(shape), *_numbers(*shape["frame"]["position"])))
        laws.append((shape["name"], *_numbers(*(shape.get(key, scene["contact"][key]) for key in _LAW))))
    if shapes:
        title = "Shapes of contact, in the world or the frames of their fixtures"
        table(title, ("shape", "on", "kind", "size m", *_PLACE), shapes, text_columns=4)
        units = ("N/m", "s/m", "ramp m", "friction", "slip m/s")
        table("Numbers of the law of contact", ("shape", *units), laws)
    fixtures = []
    for fixture in found["fixtures"]:
        joint = fixture["joint"]
        limits, friction = joint.get("limits"), joint.get("friction") or {}
        reach = " to ".join(_numbers(limits["lower"], limits["upper"])) if limits else "unlimited"
        stop, spring = (limits or {}).get("stiffness", 0.0), (joint.get("spring") or {}).get("stiffness", 0.0)
        loss = (friction.get("viscous", 0.0), friction.get("coulomb", 0.0))
        row = (fixture["name"], joint["kind"], reach, *_numbers(joint["home"], stop, spring, *loss))
        fixtures.append(row)
    if fixtures:
        names = ("fixture", "joint", "range", "at the start", "stop", "spring", "viscous", "Coulomb")
        title = "Fixtures: rad, N m and N m/rad where they turn, m, N and N/m where they slide, viscous friction per s"
        table(title, names, fixtures, text_columns=3)


def _numbers(*values: float) -> tuple[str, ...]:
    return tuple(f"{value:.4g}" for value in values)


def _size(shape: dict[str, Any]) -> str:
    match shape["kind"]:
        case "box":
            return " x ".join(_numbers(*shape["size"]))
        case "cylinder":
            return "radius {}, length {}".format(*_numbers(shape["radius"], shape["length"]))
        case "torus":
            return "radius {}, tube {}".format(*_numbers(shape["radius"], shape["tube"]))
        case _:
            return "unbounded"
