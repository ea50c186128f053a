"""Tree of a scene's links for other programs: frames, joints, masses and inertias, without hydrodynamics."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from uvms_gym._rotations import Floats, from_rpy, matrices
from uvms_gym._scene import buoyancy_of, matrix_of

#: Minimum edge of the box that represents a body in pictures, m.
THINNEST = 1e-3
#: Colours of vehicles and links without their own.
VEHICLE, LINK = (0.96, 0.72, 0.11), (0.55, 0.58, 0.62)


class Frame(NamedTuple):
    """Pose in a parent frame: position (3,), m, and roll, pitch, yaw (3,), rad, R = Rz Ry Rx."""

    position: Floats = np.zeros(3)
    rpy: Floats = np.zeros(3)

    @classmethod
    def of(cls, given: Mapping[str, Any] | None) -> "Frame":
        """Frame of a table of a scene; the identity without it."""
        return cls(np.array(given["position"]), np.array(given["rpy"])) if given else cls()

    @property
    def rotation(self) -> Floats:
        """Rotation matrix (3, 3)."""
        return matrices(from_rpy(self.rpy))

    @property
    def matrix(self) -> Floats:
        """Homogeneous matrix (4, 4)."""
        result = np.eye(4)
        result[:3, :3], result[:3, 3] = self.rotation, self.position
        return result

    def __matmul__(self, inner: "Frame") -> "Frame":
        """Pose of a frame within this one, in the parent of this one; exact where one of them is not rotated."""
        position = self.position + self.rotation @ inner.position if self.rpy.any() else self.position + inner.position
        if not self.rpy.any() or not inner.rpy.any():
            return Frame(position, self.rpy + inner.rpy)
        return Frame(position, angles(self.rotation @ inner.rotation))


class Matter(NamedTuple):
    """Mass, kg, centre of mass (3,), m, inertia (3, 3) about it, kg m^2, and buoyancy, N, in the axes of a link."""

    mass: float
    center_of_mass: Floats
    inertia: Floats
    buoyancy: float

    def __add__(self, other: "Matter") -> "Matter":  # type: ignore[override]
        """Both, rigidly connected."""
        mass = self.mass + other.mass
        center = (self.mass * self.center_of_mass + other.mass * other.center_of_mass) / mass
        inertia = np.zeros((3, 3))
        for part in (self, other):
            inertia += part.inertia + _point_inertia(part.mass, part.center_of_mass - center)
        return Matter(mass, center, inertia, self.buoyancy + other.buoyancy)

    def within(self, frame: Frame) -> "Matter":
        """The same in the axes of the parent of `frame`."""
        turn = frame.rotation
        center = turn @ self.center_of_mass + frame.position
        return Matter(self.mass, center, turn @ self.inertia @ turn.T, self.buoyancy)


class Link(NamedTuple):
    """A frame of a scene with the matter that it carries, if any.

    `parent` is the index of its carrier, before it in the list; None for the vehicle. `frame` is its pose in the
    carrier's frame, its joint at zero. `joint` is the table of the joint; None if it is rigidly connected.
    `coordinate` is the index of the joint in every joint array of a simulator. `meshes` are the tables of its meshes.
    """

    name: str
    parent: int | None
    frame: Frame
    joint: dict[str, Any] | None
    matter: Matter | None
    coordinate: int = -1
    meshes: Sequence[Mapping[str, Any]] = ()

    @property
    def axis(self) -> Floats:
        """Unit vector (3,) of the joint's axis."""
        axis = np.array(self.joint["axis"] if self.joint else [0.0, 0.0, 1.0])
        return np.asarray(axis / np.linalg.norm(axis))

    @property
    def prismatic(self) -> bool:
        """True for a prismatic joint."""
        return self.joint is not None and self.joint["kind"] == "prismatic"

    def box(self, shape: Mapping[str, Any] | None) -> tuple[Floats, Frame, Sequence[float]]:
        """Edges (3,), m, pose and colour for pictures: of a shape, or of the homogeneous box with these moments."""
        if shape:
            return np.array(shape["size"]), Frame(np.array(shape["position"])), shape["colour"]
        assert self.matter is not None
        mass, center, inertia, _ = self.matter
        moments, turn = np.diag(inertia), np.eye(3)
        if (inertia != np.diag(moments)).any():
            moments, turn = np.linalg.eigh(inertia)
            turn[:, 0] *= np.linalg.det(turn)
        edges = np.sqrt(np.maximum(6.0 / mass * (moments.sum() - 2.0 * moments), THINNEST**2))
        return edges, Frame(center, angles(turn)), VEHICLE if self.parent is None else LINK


def tree(scene: dict[str, Any]) -> list[Link]:
    """Links of a scene as `load_scene` gives it: vehicle, base, arm links, end effectors, payload.

    Depth first: whatever a link carries follows it.
    """
    vehicle = scene["vehicle"]
    own = _matter(vehicle["body"], scene)
    links = [Link("vehicle", None, Frame(), None, own, meshes=vehicle.get("meshes", ()))]
    # Rigid joints of URDF have names, too.
    taken = {"world", "vehicle", "vehicle_fixed", "vehicle_floating"}
    ends: dict[str | None, int] = {}

    def add(
        name: str, parent: int, frame: Frame, joint: dict[str, Any] | None, part: Mapping[str, Any], key: str = "body"
    ) -> int:
        while name in taken:
            name += "_"
        taken.update((name, f"{name}_fixed"))
        if joint:
            frame = frame @ Frame.of(joint.get("frame"))
        moves = joint is not None and joint["kind"] != "fixed"
        coordinate = sum(link.joint is not None for link in links) if moves else -1
        matter, meshes = _matter(part.get(key), scene), part.get("meshes", ())
        links.append(Link(name, parent, frame, joint if moves else None, matter, coordinate, meshes))
        return len(links) - 1

    if arm := scene.get("arm"):
        mount = arm["mount"]
        carrier = add("base", 0, Frame.of(mount.get("frame")), mount.get("joint"), arm, "base")
        places = {"vehicle": 0, "base": carrier}
        for link in arm["links"]:
            parent = places.get(link.get("parent"), carrier)
            carrier = places[link["name"]] = add(link["name"], parent, Frame(), link["joint"], link)
        named = {"end_effector": arm["end_effector"], **arm.get("end_effectors", {})}
        for name, end in named.items():
            ends[name] = add(name, places.get(end.get("on"), carrier), Frame.of(end), None, {})
    if payload := scene.get("payload"):
        on = ends.get(payload.get("on"), ends.get("end_effector", 0))
        add("payload", on, Frame.of(payload.get("frame")), None, payload)
    return _depth_first(links)


def merged(links: Sequence[Link]) -> list[Link]:
    """The moving bodies of a tree, rigidly connected links merged into one."""
    bodies: list[Link] = []
    places: list[tuple[int, Frame]] = []
    for link in links:
        body, at = (None, Frame()) if link.parent is None else places[link.parent]
        frame = at @ link.frame
        if body is None or link.joint is not None:
            bodies.append(link._replace(parent=body, frame=frame))
            places.append((len(bodies) - 1, Frame()))
            continue
        places.append((body, frame))
        if link.matter:
            own, added = bodies[body].matter, link.matter.within(frame)
            bodies[body] = bodies[body]._replace(matter=own + added if own else added)
    return bodies


def angles(turn: Floats) -> Floats:
    """Roll, pitch and yaw (3,), rad, of a rotation matrix (3, 3); accurate to rounding at every pitch."""
    yaw = np.arctan2(turn[1, 0], turn[0, 0])
    pitch = np.arctan2(-turn[2, 0], np.hypot(turn[0, 0], turn[1, 0]))
    s, c = np.sin(yaw), np.cos(yaw)
    return np.array([np.arctan2(s * turn[0, 2] - c * turn[1, 2], c * turn[1, 1] - s * turn[0, 1]), pitch, yaw])


def _matter(body: dict[str, Any] | None, scene: dict[str, Any]) -> Matter | None:
    if not body or not body["mass"]:
        return None
    inertia, center = matrix_of(body["inertia"]), np.array(body["center_of_mass"])
    if body["inertia_at"] == "origin":
        inertia = inertia - _point_inertia(body["mass"], center)
    return Matter(body["mass"], center, inertia, buoyancy_of(body, scene["water"]))


def _point_inertia(mass: float, offset: Floats) -> Floats:
    """Inertia (3, 3) of a point mass at `offset`, for the parallel-axis theorem."""
    return np.asarray(mass * ((offset @ offset) * np.eye(3) - np.outer(offset, offset)))


def _depth_first(links: list[Link]) -> list[Link]:
    order: list[int] = []
    open_links = [0]
    while open_links:
        order.append(open_links.pop())
        open_links += reversed([i for i, link in enumerate(links) if link.parent == order[-1]])
    places = {old: new for new, old in enumerate(order)}
    return [links[i]._replace(parent=None if i == 0 else places[links[i].parent or 0]) for i in order]
