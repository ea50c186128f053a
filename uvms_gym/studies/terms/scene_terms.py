"""Modelled terms of a scene, each with the edit of the scene that removes it."""

import copy
import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from uvms_gym._core import vehicle_terms
from uvms_gym._scene import joints, matrix_of

Table = dict[str, Any]

#: Names of the term that belongs to the motion, and of all terms together.
CURRENT, ALL = "current", "all of these at once"


class Term(NamedTuple):
    """A term of the model."""

    name: str
    #: True if the scene has it.
    present: bool
    #: Removes it from a scene, in place; None if the scene lacks it, or it cannot be removed separately.
    remove: Callable[[Table], object] | None = None
    #: Note for reports.
    note: str = ""


class _Kind(NamedTuple):
    """Kind of term of bodies or joints: test for one in its water, and edit that removes it."""

    name: str
    has: Callable[[Table, Table], object]
    remove: Callable[[Table, Table], object]
    note: str = ""


def _number(name: str, table: str, key: str, neutral: Any, note: str = "") -> _Kind:
    """Kind of term that a neutral number, or list of numbers, in a table of a body or joint removes."""
    return _Kind(
        name,
        lambda part, _: np.any(part[table][key] if table else part[key]),
        lambda part, _: (part[table] if table else part).update({key: neutral}),
        note,
    )


def terms_of(scene: Table) -> list[Term]:
    """All terms that a scene can have, with their presence in this one and the edits that remove them."""
    terms = []
    for group, pick in _GROUPS.items():
        held = group == "vehicle" and scene["vehicle"]["fixed"]
        for kind in _BODY_KINDS:
            name = f"{group}: {kind.name}"
            term = Term(name, False, note="the vehicle is fixed in the world") if held else None
            terms.append(term or _of_kind(scene, name, kind, pick))
    terms += [_current(scene), *(_of_kind(scene, kind.name, kind, joints) for kind in _JOINT_KINDS)]
    terms += [_arm_base(scene), _part(scene, "payload", lambda s: s, "its mass and its hydrodynamics")]
    reached = "acts only where a sphere reaches a shape; a zero effect in this motion says nothing about others"
    terms.append(_part(scene, "contact", lambda s: s, reached))
    for key, note in vehicle_terms():
        # Fins of a scene without water do nothing.
        dry = key == "fins" and scene["water"]["density"] == 0.0
        terms.append(Term(key, False) if dry else _part(scene["vehicle"], key, lambda s: s["vehicle"], note))
    terms.append(_thrusters(scene))
    removals = [term.remove for term in terms if term.remove is not None]
    if len(removals) > 1:
        terms.append(Term(ALL, True, lambda scene: [remove(scene) for remove in removals], "rigid bodies remain"))
    has_servos = any("servo" in joint for joint in joints(scene))
    return [*terms, Term("joint servos", has_servos, note="they drive the arm" if has_servos else "")]


def edited(scene: Table, edit: Callable[[Table], object]) -> Table:
    """Edited copy of a scene."""
    scene = copy.deepcopy(scene)
    # Provenance may name removed keys.
    scene["provenance"] = {}
    edit(scene)
    return scene


def _vehicle_bodies(scene: Table) -> Iterator[Table]:
    """Vehicle and the bodies fixed to it."""
    yield scene["vehicle"]["body"]
    arm = scene.get("arm", {})
    if arm.get("base") and "joint" not in arm["mount"]:
        yield arm["base"]
    if scene.get("payload") and not joints(scene):
        yield scene["payload"]["body"]


def _link_bodies(scene: Table) -> Iterator[Table]:
    """Bodies moved by joints: links, an arm base behind a joint, a payload."""
    arm = scene.get("arm", {})
    if arm.get("base") and "joint" in arm["mount"]:
        yield arm["base"]
    yield from (link["body"] for link in arm.get("links", []) if link.get("body"))
    if scene.get("payload") and joints(scene):
        yield scene["payload"]["body"]


_GROUPS = {"vehicle": _vehicle_bodies, "links": _link_bodies}


def _feels_flow(body: Table, water: Table) -> bool:
    tables = (body["added_mass"], body["damping"]["linear"], body["damping"]["quadratic"])
    return any(np.any(table) for table in tables)


def _restores(body: Table, water: Table) -> bool:
    gravity = math.hypot(*water["gravity"])
    if gravity == 0.0:
        return False
    mass = body["mass"]
    displaced = body["buoyancy"] / gravity if "buoyancy" in body else water["density"] * body.get("volume", 0.0)
    mass_moment = mass * np.array(body["center_of_mass"])
    return mass != displaced or bool((mass_moment != displaced * np.array(body["center_of_buoyancy"])).any())


def _remove_flow(body: Table, water: Table) -> None:
    body["added_mass"] = _ZERO
    body["damping"].update(linear=_ZERO, quadratic=_ZERO)


def _make_weightless(body: Table, water: Table) -> None:
    """Set the volume whose water weighs the same as the body, at its centre of mass."""
    mass, density = body["mass"], water["density"]
    volume = mass / density
    # The difference must be exactly zero, without rounding.
    near = (volume, math.nextafter(volume, 0.0), math.nextafter(volume, math.inf))
    body["volume"] = next((v for v in near if density * v == mass), volume)
    body.pop("buoyancy", None)
    body["center_of_buoyancy"] = body["center_of_mass"]


_ZERO = [0.0] * 6
_BODY_KINDS = (
    _number(
        "added mass",
        "",
        "added_mass",
        _ZERO,
        "with its convective (Munk) part, which follows from the same matrix and cannot be removed separately",
    ),
    _Kind(
        "added mass, off-diagonal",
        lambda body, _: np.any((full := matrix_of(body["added_mass"])) != np.diag(np.diag(full))),
        lambda body, _: body.update(added_mass=np.diag(matrix_of(body["added_mass"])).tolist()),
        "off-diagonal entries in the frame of the given coefficients",
    ),
    _number("linear damping", "damping", "linear", _ZERO),
    _number("quadratic damping", "damping", "quadratic", _ZERO),
    _Kind("added mass, damping", _feels_flow, _remove_flow, "all of the above at once"),
    _Kind(
        "weight, buoyancy",
        _restores,
        _make_weightless,
        "removed by buoyancy equal to the weight of a body, at its centre of mass",
    ),
)

_ONLY_WHERE_REACHED = "acts only where a joint reaches it; a zero effect in this motion says nothing about others"
_JOINT_KINDS = (
    _number("joint friction, viscous", "friction", "viscous", 0.0),
    _Kind(
        "joint friction, Coulomb",
        lambda joint, _: joint["friction"]["coulomb"] or joint["friction"].get("static"),
        lambda joint, _: joint.update(friction={"viscous": joint["friction"]["viscous"]}),
    ),
    _Kind(
        "springs, detents",
        lambda joint, _: "spring" in joint or "detent" in joint,
        lambda joint, _: [joint.pop(key, None) for key in ("spring", "detent")],
    ),
    _Kind(
        "end stops",
        lambda joint, _: "limits" in joint and joint["limits"]["stiffness"] + joint["limits"]["damping"] > 0.0,
        lambda joint, _: joint.pop("limits", None),
        _ONLY_WHERE_REACHED,
    ),
    _Kind(
        "effort limits",
        lambda joint, _: "effort" in joint,
        lambda joint, _: joint.pop("effort", None),
        _ONLY_WHERE_REACHED,
    ),
)


def _of_kind(scene: Table, name: str, kind: _Kind, pick: Callable[[Table], Iterable[Table]]) -> Term:
    water = scene["water"]
    if not any(kind.has(part, water) for part in pick(scene)):
        return Term(name, False)
    if kind.remove is _make_weightless and water["density"] == 0.0:
        return Term(name, True, note="no edit removes the weight of single bodies without water")

    def remove(scene: Table) -> None:
        for part in pick(scene):
            kind.remove(part, water)

    return Term(name, True, remove, kind.note)


def _current(scene: Table) -> Term:
    bodies = [*([] if scene["vehicle"]["fixed"] else _vehicle_bodies(scene)), *_link_bodies(scene)]
    if not any(_feels_flow(body, scene["water"]) for body in bodies):
        return Term(CURRENT, False, note="no body of the scene interacts with the water")
    note = "belongs to the motion, not to the scene; the kernel computes with a current in any case"
    return Term(CURRENT, True, lambda scene: scene["water"].update(current=[0.0, 0.0, 0.0]), note)


def _arm_base(scene: Table) -> Term:
    arm = scene.get("arm", {})
    if not arm.get("base"):
        return Term("arm base", False)
    if "joint" in arm["mount"]:
        return Term("arm base", True, note="it carries a joint, which needs its mass")
    return Term("arm base", True, lambda scene: scene["arm"].pop("base", None), "its mass and its hydrodynamics")


def _part(table: Table, key: str, pick: Callable[[Table], Table], note: str) -> Term:
    """Term of a part that may be in a table of the scene, which `pick` finds."""
    if not table.get(key):
        return Term(key, False)
    return Term(key, True, lambda scene: pick(scene).pop(key, None), note)


_DYNAMICS = ("lag", "dead_band", "map", "ambient_flow")


def _thrusters(scene: Table) -> Term:
    vehicle = scene["vehicle"]
    if not (vehicle.get("thruster_lag") or any(t.get(key) for t in vehicle["thrusters"] for key in _DYNAMICS)):
        return Term("thruster dynamics", False)

    def remove(scene: Table) -> None:
        scene["vehicle"].pop("thruster_lag", None)
        for thruster in scene["vehicle"]["thrusters"]:
            for key in _DYNAMICS:
                thruster.pop(key, None)

    return Term("thruster dynamics", True, remove, "this motion is driven by wrenches: only the cost is measured")
