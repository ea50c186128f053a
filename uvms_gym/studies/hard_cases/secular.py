"""Cases of errors that add up: long motions with small errors in each step; one body, or a vehicle with a rotor."""

import math
from functools import cache

import numpy as np

from uvms_gym._rotations import about
from uvms_gym.studies.hard_cases.case import (
    Case,
    Reference,
    Scene,
    instants,
    link,
    motion,
    single_body,
    with_arm,
)
from uvms_gym.studies.hard_cases.reference_solutions import Top, precession, solve_twice
from uvms_gym.studies.hard_cases.spinning import top_case
from uvms_gym.studies.hard_cases.water import fast_case
from uvms_gym.studies.numerics import Floats

X, _, Z = np.eye(3)
GRAVITY = 9.81
DENSITY = 1000.0


def neutral(mass: float, inertia: float) -> Scene:
    """Make a neutrally buoyant body, both centres at its origin."""
    return {"mass": mass, "inertia": [inertia] * 3, "volume": mass / DENSITY}


FASTER = fast_case(
    "quadratic damping at 200 m/s",
    "5 s of deceleration from 200 m/s, and of reversal by a force: speed and distance every 0.1 s",
    200.0,
    steps={4: 0.0005, 2: 0.00025, 1: 0.0001},
    reason="the speed halves within 0.005 s at first",
)

LONG_TUMBLE = top_case(
    "tumble for 500 s",
    "500 s of tumbling at 2 rad/s about all three axes, 1000 rad: attitude and rate every 5 s",
    "long tumble",
    Top(np.array([1.0, 2.0, 2.6]), 2.0 * np.array([0.7, 0.5, -0.6]) / math.sqrt(1.1)),
    instants(5.0, 100),
    steps={4: 0.01, 3: 0.002, 2: 0.0025, 1: 5e-5},
    interval=5.0,
    bounds={"float32": 5e-2},
    reason="1000 rad: in float32 the rounding of up to 250 000 steps adds up to 0.02 rad",
)


# Weakly damped roll: weight and buoyancy apart make a couple, I r'' = -m g d sin r - 2 z w I r'.
ROLL = {"mass": 10.0, "inertia": 0.5, "rate": 3.0, "ratio": 1e-3, "start": 0.5}
ROLL_TIMES = instants(0.5, 120)


def _roll_scene() -> Scene:
    mass, inertia, rate, ratio, _ = ROLL.values()
    above = inertia * rate**2 / (mass * GRAVITY)
    body = neutral(mass, inertia) | {
        "center_of_buoyancy": [0.0, 0.0, above],
        "damping": {"linear": [0.0] * 3 + [2.0 * ratio * rate * inertia] * 3},
    }
    return single_body("weakly damped roll", body, DENSITY, gravity=[0.0, 0.0, -GRAVITY])


@cache
def _roll_reference() -> Reference:
    _, _, rate, ratio, start = ROLL.values()

    def rates(_: float, y: Floats) -> list[float]:
        return [y[1], -rate * rate * math.sin(y[0]) - 2.0 * ratio * rate * y[1]]

    (angle, speed), uncertainty = solve_twice(rates, [start, 0.0], ROLL_TIMES)
    values = {"attitude": about(X, angle), "rate": np.outer(speed, X)}
    return Reference(values, "equation of the roll, by SciPy, two tolerances", uncertainty)


WEAK_DAMPING = Case(
    name="weakly damped roll",
    description="60 s of roll at 3 rad/s from 0.5 rad, damping ratio 0.001: attitude and rate every 0.5 s",
    run=motion(_roll_scene, ROLL_TIMES, ["attitude", "rate"], rotation=about(X, ROLL["start"])),
    reference=_roll_reference,
    steps={4: 0.01, 3: 0.004, 2: 0.002, 1: 0.0005},
    interval=0.5,
    reason="180 rad of phase: the relative error of the period, (h rate)^p, counts 180 times",
)


# A nearly neutrally buoyant body rises against quadratic damping, v = v_t tanh(t/T), z = v_t T ln cosh(t/T), and spins.
RISE = {"mass": 10.0, "added": 8.0, "surplus": 1e-3, "drag": 20.0, "spin": 0.3}
RISE_TIMES = instants(5.0, 20)


def _rise_scene() -> Scene:
    mass, added, surplus, drag, _ = RISE.values()
    body = {
        "mass": mass,
        "inertia": [0.5] * 3,
        "volume": (mass + surplus) / DENSITY,
        "added_mass": [added] * 3 + [0.0] * 3,
        "damping": {"quadratic": [drag] * 3 + [0.0] * 3},
    }
    return single_body("rise", body, DENSITY, gravity=[0.0, 0.0, -GRAVITY])


def _rise_reference() -> Reference:
    mass, added, surplus, drag, spin = RISE.values()
    terminal = math.sqrt(surplus * GRAVITY / drag)
    scale = (mass + added) / (drag * terminal)
    values = {
        "position": np.outer(terminal * scale * np.log(np.cosh(RISE_TIMES / scale)), Z),
        "velocity": np.outer(terminal * np.tanh(RISE_TIMES / scale), Z),
        "attitude": about(Z, spin * RISE_TIMES),
    }
    return Reference(values, "closed form")


SLOW_RISE = Case(
    name="slow rise",
    description="a body 1e-4 lighter than its water rises and spins for 100 s: pose and velocity every 5 s",
    run=motion(
        _rise_scene, RISE_TIMES, ["position", "velocity", "attitude"], twist=[0.0, 0.0, 0.0, 0.0, 0.0, RISE["spin"]]
    ),
    reference=_rise_reference,
    steps={2: 0.1, 1: 0.005},
    interval=5.0,
)


# A rotor at 300 rad/s in a free vehicle, both symmetric about its axis z: a gyrostat (see `precession`).
GYROSTAT = {"transverse": 0.05, "axial": 0.06, "rotor": 0.001, "speed": 300.0}
GYROSTAT_RATE = np.array([0.3, -0.2, 0.5])
GYROSTAT_TIMES = instants(0.5, 40)


def _gyrostat_scene() -> Scene:
    transverse, axial, rotor, _ = GYROSTAT.values()
    vehicle = {"mass": 5.0, "inertia": [transverse - rotor, transverse - rotor, axial]}
    return with_arm(single_body("gyrostat", vehicle), link("rotor", {"mass": 0.2, "inertia": [rotor] * 3}))


def _gyrostat_reference() -> Reference:
    transverse, axial, rotor, speed = GYROSTAT.values()
    values = precession(transverse, axial + rotor, GYROSTAT_RATE, GYROSTAT_TIMES, rotor * speed)
    return Reference(values | {"q'": np.full((len(GYROSTAT_TIMES), 1), speed)}, "closed form")


GYROSTAT_CASE = Case(
    name="rotor in a free vehicle",
    description="a rotor at 300 rad/s makes a free vehicle precess at 7 rad/s, 20 s: attitude, rates every 0.5 s",
    run=motion(
        _gyrostat_scene,
        GYROSTAT_TIMES,
        ["attitude", "rate", "q'"],
        twist=[0.0, 0.0, 0.0, *GYROSTAT_RATE],
        qd=[GYROSTAT["speed"]],
    ),
    reference=_gyrostat_reference,
    steps={4: 0.0025, 3: 0.00125, 2: 0.0005, 1: 0.0001},
    interval=0.5,
    reason="132 rad of precession: the relative error of its rate, (h rate)^p, counts 132 times",
)

CASES = (FASTER, LONG_TUMBLE, WEAK_DAMPING, SLOW_RISE, GYROSTAT_CASE)
