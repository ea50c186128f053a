"""Scenes with contact for this package and for MuJoCo: the same bodies, shapes, gravity and friction, without water."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from uvms_gym.studies.numerics import Floats

#: Gravity, m/s^2, coefficient of friction, and the time between samples, s, which every step divides.
GRAVITY, FRICTION, SAMPLE = 9.81, 0.4, 0.02
#: Numbers of the law of contact in all scenes: N/m, s/m, m, m/s.
LAW = {"stiffness": 5000.0, "dissipation": 2.0, "ramp": 0.0005, "friction": FRICTION, "slip_speed": 0.001}
#: Share of the start's speed below which a body is at rest.
REST = 0.01


@dataclass(frozen=True)
class Track:
    """Motion at multiples of `SAMPLE`, the start included."""

    #: Coordinate of the scene, m or rad, and its rate, (k,).
    x: Floats
    v: Floats
    #: Penetration at the end, m.
    depth: float


@dataclass(frozen=True, eq=False)
class ContactScene:
    """A scene with contact, and its motion from a start."""

    name: str
    description: str
    #: Scene of this package, and start and inputs of its simulator.
    scene: Mapping[str, Any]
    start: Mapping[str, Any]
    inputs: Mapping[str, Any]
    #: Bodies of MuJoCo's world and its actuators, and positions and velocities at the start.
    bodies: str
    actuators: str
    #: Names of MuJoCo's shapes that touch.
    pairs: Sequence[tuple[str, str]]
    qpos: Sequence[float]
    qvel: Sequence[float]
    #: Duration, s, and step of references, s.
    time: float
    fine: float
    #: Normal force of each contact at rest, N, and mass of the body that it moves, kg.
    load: float
    mass: float
    #: Index of the observed coordinate in the position of the vehicle, or -1 for the last joint.
    coordinate: int
    #: Results by name, which a step must leave within 1 %.
    results: Callable[[Track], dict[str, float]]
    #: Direction of gravity.
    down: Sequence[float] = (0.0, 0.0, -1.0)

    @property
    def depth(self) -> float:
        """Penetration at rest, m."""
        return self.load / LAW["stiffness"] + 0.5 * LAW["ramp"]

    @property
    def gravity(self) -> list[float]:
        """Gravity, m/s^2, world axes."""
        return [GRAVITY * x for x in self.down]

    def time_to_rest(self, track: Track) -> float:
        """Time after which no sample is faster than `REST` times the fastest one, s; 0 without motion."""
        speed = np.abs(track.v)
        fast = np.flatnonzero(speed > REST * speed.max())
        return float(SAMPLE * (1 + fast[-1])) if fast.size else 0.0


def _scene(name: str, body: dict[str, Any], law: dict[str, Any], contact: dict[str, Any], down: Any) -> dict[str, Any]:
    water = {"density": 0.0, "gravity": [GRAVITY * x for x in down]}
    return {"name": name, "water": water, "vehicle": {"name": name, "body": body}, "contact": law | contact}


_FLOOR = {"name": "floor", "kind": "plane"}
_PLANE = '<geom name="floor" type="plane" size="1 1 1"/>'
_DOWN = (0.0, 0.0, -1.0)
_RADIUS, _HEIGHT, _BALL = 0.03, 0.05, 0.2


def _flight_energy(track: Track) -> Floats:
    """Energy per mass of a ball relative to touching the floor, J/kg; NaN in contact."""
    height = track.x - _RADIUS
    return np.where(height > 0.0, GRAVITY * height + 0.5 * track.v**2, np.nan)


def _exit_speed(track: Track) -> float:
    """Speed after the first bounce, m/s, from the first sample in flight after it; 0 without one."""
    energy = _flight_energy(track)[np.maximum.accumulate(track.v > 0.0)]
    flights = energy[np.isfinite(energy)]
    return math.sqrt(2.0 * float(flights[0])) if flights.size else 0.0


def _remaining_energy(track: Track) -> float:
    energy = _flight_energy(track)
    return float(energy[np.isfinite(energy)][-1] / energy[0])


def _ball(
    name: str, description: str, dissipation: float, results: Callable[[Track], dict[str, float]]
) -> ContactScene:
    sphere = {"name": "ball", "on": "vehicle", "position": [0.0, 0.0, 0.0], "radius": _RADIUS}
    law = LAW | {"dissipation": dissipation}
    inertia = 0.4 * _BALL * _RADIUS**2
    body = {"mass": _BALL, "inertia": [inertia] * 3}
    return ContactScene(
        name=name,
        description=description,
        scene=_scene(name, body, law, {"spheres": [sphere], "shapes": [_FLOOR]}, _DOWN),
        start={"position": [0.0, 0.0, _RADIUS + _HEIGHT]},
        inputs={},
        bodies=f'{_PLANE}<body><freejoint/><inertial pos="0 0 0" mass="{_BALL}" diaginertia="{inertia} {inertia} '
        f'{inertia}"/><geom name="ball" type="sphere" size="{_RADIUS}" mass="0"/></body>',
        pairs=[("floor", "ball")],
        actuators="",
        qpos=[0.0, 0.0, _RADIUS + _HEIGHT, 1.0, 0.0, 0.0, 0.0],
        qvel=[0.0] * 6,
        time=2.0,
        fine=1e-5,
        load=_BALL * GRAVITY,
        mass=_BALL,
        coordinate=2,
        results=results,
    )


_MASS, _EDGES, _FOOT = 2.0, np.array([0.4, 0.3, 0.2]), 0.02


def _box(
    name: str,
    description: str,
    slope: float,
    speed: float,
    time: float,
    fine: float,
    results: Callable[[Track], dict[str, float]],
) -> ContactScene:
    """A box on four spheres, on a plane that falls along x; at the start in equilibrium normal to the plane."""
    down = (math.sin(slope), 0.0, -math.cos(slope))
    corners = [[x * 0.18, y * 0.13, -0.1] for x in (1.0, -1.0) for y in (1.0, -1.0)]
    spheres: list[dict[str, Any]] = [
        {"name": f"foot {k}", "on": "vehicle", "position": p, "radius": _FOOT} for k, p in enumerate(corners)
    ]
    inertia = (_MASS / 12.0 * (np.sum(_EDGES**2) - _EDGES**2)).tolist()
    load = 0.25 * _MASS * GRAVITY * math.cos(slope)
    height = 0.1 + _FOOT - load / LAW["stiffness"] - 0.5 * LAW["ramp"]
    feet = "".join(
        f'<geom name="foot {k}" type="sphere" size="{_FOOT}" mass="0" pos="{p[0]} {p[1]} {p[2]}"/>'
        for k, p in enumerate(corners)
    )
    return ContactScene(
        name=name,
        description=description,
        scene=_scene(name, {"mass": _MASS, "inertia": inertia}, LAW, {"spheres": spheres, "shapes": [_FLOOR]}, down),
        start={"position": [0.0, 0.0, height], "twist": [speed, 0.0, 0.0, 0.0, 0.0, 0.0]},
        inputs={},
        bodies=f'{_PLANE}<body><freejoint/><inertial pos="0 0 0" mass="{_MASS}" '
        f'diaginertia="{inertia[0]} {inertia[1]} {inertia[2]}"/>{feet}</body>',
        pairs=[("floor", sphere["name"]) for sphere in spheres],
        actuators="",
        qpos=[0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0],
        qvel=[speed, 0.0, 0.0, 0.0, 0.0, 0.0],
        time=time,
        fine=fine,
        load=load,
        mass=_MASS,
        coordinate=0,
        results=results,
        down=down,
    )


def _lever() -> ContactScene:
    """A finger on a slide pushes a damped lever by a constant force."""
    radius, length, width, damping, inertia, gap, lever, force = 0.01, 0.2, 0.02, 0.6, 0.01, 0.005, 0.12, 2.0
    finger, slide = {"mass": 0.5, "viscous": 2.0}, -(radius + 0.5 * width + gap)
    scene: dict[str, Any] = {
        "name": "lever",
        "water": {"density": 0.0, "gravity": [0.0, 0.0, 0.0]},
        "vehicle": {"name": "base", "fixed": True, "body": {"mass": 1.0, "inertia": [1.0] * 3}},
        "arm": {
            "name": "finger",
            "links": [
                {
                    "name": "finger",
                    "body": {"mass": finger["mass"], "inertia": [1e-4] * 3},
                    "joint": {
                        "kind": "prismatic",
                        "axis": [0.0, 1.0, 0.0],
                        "frame": {"position": [lever, slide, 0.0]},
                        "friction": {"viscous": finger["viscous"]},
                    },
                }
            ],
        },
        "contact": LAW
        | {
            "spheres": [{"name": "finger", "on": "finger", "position": [0.0, 0.0, 0.0], "radius": radius}],
            "shapes": [
                {
                    "name": "bar",
                    "on": "lever",
                    "kind": "box",
                    "size": [length, width, width],
                    "frame": {"position": [0.5 * length, 0.0, 0.0]},
                }
            ],
        },
        "fixtures": [
            {
                "name": "lever",
                "joint": {
                    "kind": "revolute",
                    "axis": [0.0, 0.0, 1.0],
                    "rotor_inertia": inertia,
                    "friction": {"viscous": damping},
                },
            }
        ],
    }
    bodies = (
        f'<body pos="{lever} {slide} 0"><joint type="slide" name="slide" axis="0 1 0" damping="{finger["viscous"]}"/>'
        f'<inertial pos="0 0 0" mass="{finger["mass"]}" diaginertia="1e-4 1e-4 1e-4"/>'
        f'<geom name="finger" type="sphere" size="{radius}" mass="0"/></body>'
        f'<body><joint type="hinge" axis="0 0 1" damping="{damping}"/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>'
        f'<geom name="bar" type="box" pos="{0.5 * length} 0 0" size="{0.5 * length} {0.5 * width} {0.5 * width}" '
        'mass="0"/></body>'
    )
    return ContactScene(
        name="lever",
        description=f"finger of {finger['mass']} kg pushes a lever with damping of {damping} N m s/rad by {force:g} N",
        scene=scene,
        start={},
        inputs={"joint_torque": [force, 0.0]},
        bodies=bodies,
        pairs=[("bar", "finger")],
        actuators=f'<motor joint="slide" gear="{force}"/>',
        qpos=[0.0, 0.0],
        qvel=[0.0, 0.0],
        time=1.0,
        fine=2e-5,
        load=force,
        mass=finger["mass"],
        coordinate=-1,
        results=lambda track: {"angle (rad)": float(track.x[-1])},
        down=(0.0, 0.0, 0.0),
    )


def _creep(track: Track) -> dict[str, float]:
    half = len(track.x) // 2
    return {"creep (m/s)": float((track.x[-1] - track.x[half]) / (SAMPLE * (len(track.x) - 1 - half)))}


DROP = _ball(
    "drop",
    "ball of 0.2 kg falls from 50 mm on a plane",
    LAW["dissipation"],
    lambda track: {"depth (m)": track.depth, "exit speed (m/s)": _exit_speed(track)},
)
SLIDE = _box(
    "slide",
    "box of 2 kg on four spheres slides from 0.5 m/s to rest",
    0.0,
    0.5,
    1.0,
    2e-5,
    lambda track: {"distance (m)": float(track.x[-1] - track.x[0])},
)
SCENES: tuple[ContactScene, ...] = (
    DROP,
    _ball(
        "bounce",
        "the same ball without dissipation: energy of flight after 2 s by the energy at the start",
        0.0,
        lambda track: {"energy": _remaining_energy(track)},
    ),
    SLIDE,
    _box("rest", "the box at rest on a level plane for 60 s", 0.0, 0.0, 60.0, 5e-4, _creep),
    _box(
        "slope", "the box on a slope at half of the limit of friction for 60 s", math.atan(0.2), 0.0, 60.0, 5e-4, _creep
    ),
    _lever(),
)
