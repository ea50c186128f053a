"""Scenes for the golden data: reads the TOML format into a flat chain of moving bodies.

Written from the format's description alone; shares no code with the simulator. Works in any number type:
`read(path)` gives floats, `read(path, mpmath.mpf, mpmath)` gives arbitrary precision. Twists and wrenches are
ordered [linear; angular]; transforms are 4x4 matrices.

The chain: moving body 0 is the vehicle, then one moving body per joint, each the child of the one before it.
Everything with mass is an `Item` rigidly attached to a moving body.
"""

import json
import math
import platform
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
SCENES = HERE / "scenes"


@dataclass
class Joint:
    """A joint and the placement of its frame in the parent moving body at q = 0."""

    placement: np.ndarray
    prismatic: bool
    axis: np.ndarray
    rotor_inertia: object
    viscous: object
    coulomb: object
    coulomb_speed: object
    limits: tuple | None
    effort: object | None


@dataclass
class Item:
    """A body with mass, fixed to moving body `owner`; `placement` is its frame there.

    `center_of_mass`, `center_of_buoyancy` and `hydrodynamic_frame` are in the item's frame, `inertia` is about the
    centre of mass, `added_mass`, `linear` and `quadratic` are in the hydrodynamic frame.
    """

    owner: int
    placement: np.ndarray
    mass: object
    center_of_mass: np.ndarray
    inertia: np.ndarray
    volume: object
    center_of_buoyancy: np.ndarray
    hydrodynamic_frame: np.ndarray
    added_mass: np.ndarray
    linear: np.ndarray
    quadratic: np.ndarray


@dataclass
class Model:
    """A scene as a chain. `end_effector` is (owner, placement)."""

    name: str
    density: object
    gravity: np.ndarray
    fixed: bool
    joints: list
    items: list
    end_effector: tuple


class Reader:
    """Turns parsed TOML into a `Model` with numbers of one type."""

    def __init__(self, number, lib):
        self.number = number
        self.lib = lib
        self.dtype = float if number is float else object

    def array(self, values):
        values = np.asarray(values).astype(object)
        return np.array([self.number(v) for v in values.ravel()], dtype=self.dtype).reshape(values.shape)

    def vector(self, table, key):
        return self.array(table.get(key, [0.0, 0.0, 0.0]))

    def matrix6(self, table, key):
        values = np.array(table.get(key, [0.0] * 6), dtype=float)
        return self.array(np.diag(values) if values.shape == (6,) else values)

    def frame(self, table):
        table = table or {}
        return translation(self.vector(table, "position"), self) @ rotation_rpy(self.vector(table, "rpy"), self)

    def joint(self, table, before):
        axis = self.array(table["axis"])
        friction = table.get("friction", {})
        limits = table.get("limits")
        if limits is not None:
            limits = tuple(self.number(limits.get(k, 0.0)) for k in ("lower", "upper", "stiffness", "damping"))
        effort = table.get("effort")
        return Joint(
            placement=before @ self.frame(table.get("frame")),
            prismatic={"revolute": False, "prismatic": True}[table["kind"]],
            axis=axis / self.lib.sqrt(axis @ axis),
            rotor_inertia=self.number(table.get("rotor_inertia", 0.0)),
            viscous=self.number(friction.get("viscous", 0.0)),
            coulomb=self.number(friction.get("coulomb", 0.0)),
            coulomb_speed=self.number(friction.get("coulomb_speed", 0.01)),
            limits=limits,
            effort=None if effort is None else self.number(effort),
        )

    def item(self, table, owner, placement, density, gravity):
        mass = self.number(table["mass"])
        com = self.vector(table, "center_of_mass")
        inertia = np.array(table["inertia"], dtype=float)
        if inertia.shape == (3,):
            inertia = np.diag(inertia)
        elif inertia.shape == (6,):
            xx, xy, xz, yy, yz, zz = inertia
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        inertia = self.array(inertia)
        if table.get("inertia_at", "com") == "origin":
            # Parallel axes: I_o = I_c + m (c'c 1 - c c').
            inertia = inertia - mass * ((com @ com) * np.eye(3, dtype=int) - np.outer(com, com))
        if "volume" in table:
            volume = self.number(table["volume"])
        elif "buoyancy" in table:
            volume = self.number(table["buoyancy"]) / (density * self.lib.sqrt(gravity @ gravity))
        else:
            volume = self.number(0.0)
        damping = table.get("damping", {})
        return Item(
            owner,
            placement,
            mass,
            com,
            inertia,
            volume,
            self.vector(table, "center_of_buoyancy"),
            self.frame(table.get("hydrodynamic_frame")),
            self.matrix6(table, "added_mass"),
            self.matrix6(damping, "linear"),
            self.matrix6(damping, "quadratic"),
        )

    def model(self, scene):
        density = self.number(scene["water"]["density"])
        gravity = self.array(scene["water"]["gravity"])
        vehicle = scene["vehicle"]
        here, owner, joints = self.frame(None), 0, []
        items = [self.item(vehicle["body"], 0, here, density, gravity)]
        arm = scene.get("arm")
        if arm is not None:
            mount = arm.get("mount", {})
            here = self.frame(mount.get("frame"))
            if "joint" in mount:
                joints.append(self.joint(mount["joint"], here))
                owner, here = 1, self.frame(None)
            if "base" in arm:
                items.append(self.item(arm["base"], owner, here, density, gravity))
            for link in arm.get("links", []):
                joints.append(self.joint(link["joint"], here))
                owner, here = owner + 1, self.frame(None)
                items.append(self.item(link["body"], owner, here, density, gravity))
            here = here @ self.frame(arm.get("end_effector"))
        if "payload" in scene:
            placement = here @ self.frame(scene["payload"].get("frame"))
            items.append(self.item(scene["payload"]["body"], owner, placement, density, gravity))
        return Model(scene["name"], density, gravity, vehicle.get("fixed", False), joints, items, (owner, here))


def homogeneous(rotation, position, reader):
    result = reader.array(np.eye(4))
    result[:3, :3] = rotation
    result[:3, 3] = position
    return result


def translation(position, reader):
    return homogeneous(reader.array(np.eye(3)), position, reader)


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def rotation_about(axis, angle, reader):
    """Rodrigues' formula."""
    K, sine, cosine = skew(axis), reader.lib.sin(angle), reader.lib.cos(angle)
    rotation = reader.array(np.eye(3)) + sine * K + (1 - cosine) * (K @ K)
    return homogeneous(rotation, reader.array(np.zeros(3)), reader)


def rotation_rpy(angles, reader):
    """Rz(yaw) Ry(pitch) Rx(roll)."""
    x, y, z = (rotation_about(axis, angle, reader) for axis, angle in zip(reader.array(np.eye(3)), angles))
    return z @ y @ x


def load(name):
    """The parsed TOML of golden scene `name`."""
    return tomllib.loads((SCENES / f"{name}.toml").read_text())


def read(name, number=float, lib=math):
    """Golden scene `name` as (Model, Reader)."""
    reader = Reader(number, lib)
    return reader.model(load(name)), reader


def random_state(rng, model, beyond_limits=False):
    """A random state and inputs, in short decimals but for the rotation matrix."""

    def short(values):
        return np.round(np.asarray(values, dtype=float), 4)

    def wrench(size):
        return short(rng.normal(size=6) * size * np.array([1, 1, 1, 0.3, 0.3, 0.3]))

    quaternion = rng.normal(size=4)
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    q, torque = [], []
    for joint in model.joints:
        reach = 0.3 if joint.prismatic else 2.0
        lower, upper = (-reach, reach) if joint.limits is None else (float(joint.limits[0]), float(joint.limits[1]))
        spare = 0.15 * (upper - lower) if beyond_limits else 0.0
        q.append(rng.uniform(max(lower, -np.pi) - spare, min(upper, np.pi) + spare))
        most = 10.0 if joint.effort is None else 0.9 * float(joint.effort)
        torque.append(rng.uniform(-most, most))
    scale = float(model.items[0].mass)
    return {
        "position": short(rng.normal(size=3)),
        "rotation": rotation,
        "twist": np.zeros(6) if model.fixed else short(rng.normal(size=6) * 0.8),
        "q": short(q),
        "qd": short(rng.normal(size=len(q)) * 0.7),
        "joint_torque": short(torque),
        "wrench": wrench(scale),
        "external": [wrench(5.0) for _ in range(1 + len(q))],
    }


def plain(value):
    """NumPy arrays and mpmath numbers as lists and floats, for JSON."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0):
        return [plain(v) for v in value]
    return value if isinstance(value, (str, bool, int)) else float(value)


def save(file, scenes, **versions):
    """Writes golden data with the versions of programs, one case per line."""
    made_with = {"python": platform.python_version(), **versions, "numpy": np.__version__}
    text = json.dumps(plain({"made_with": made_with, "scenes": scenes}), separators=(",", ":"))
    (HERE / file).write_text(text.replace('{"scene"', '\n{"scene"').replace('{"position"', '\n{"position"') + "\n")


def random_cases(names, stream, case):
    """Ten cases of each scene, `case(i, rng, model)`, with random numbers of a stream."""
    scenes = []
    for index, name in enumerate(names):
        (model, _), rng = read(name), np.random.default_rng([stream, index])
        scenes.append({"scene": name, "cases": [case(i, rng, model) for i in range(10)]})
    return scenes
