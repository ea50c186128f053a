"""Cases of errors that add up: long motions with small errors in each step; one body, or a vehicle with a rotor."""

import math

import numpy as np

from uvms_gym._rotations import about
from uvms_gym.studies.hard_cases.case import Case, Quantities, Reference, instants, motion_case
from uvms_gym.studies.hard_cases.reference_solutions import precession, solve_twice
from uvms_gym.studies.hard_cases.scenes import DENSITY, GRAVITY, link, neutral, single_body, with_arm
from uvms_gym.studies.hard_cases.spinning import TUMBLE_INERTIA, top_case, tumble_spin
from uvms_gym.studies.hard_cases.water import fast_case
from uvms_gym.studies.numerics import Floats

X, _, Z = np.eye(3)


FASTER = fast_case(
    "quadratic damping at 200 m/s",
    200.0,
    {4: 0.0005, 2: 0.00025, 1: 0.0001},
    "the speed halves within 0.005 s at first",
)

LONG_TUMBLE = top_case(
    "tumble for 500 s",
    "500 s of tumbling at 2 rad/s about all three axes, 1000 rad: attitude and rate every 5 s",
    TUMBLE_INERTIA,
    tumble_spin(2.0),
    instants(5.0, 100),
    {4: 0.01, 3: 0.002, 2: 0.0025, 1: 5e-5},
    bounds={"float32": 5e-2},
    reason="1000 rad: in float32 the rounding of up to 250 000 steps adds up to 0.02 rad",
)


def _roll() -> Case:
    """Weakly damped roll: weight and buoyancy apart make a couple, I r'' = -m g d sin r - 2 z w I r'."""
    mass, inertia, rate, ratio, start = 10.0, 0.5, 3.0, 1e-3, 0.5
    body = neutral(mass, inertia) | {
        "center_of_buoyancy": [0.0, 0.0, inertia * rate**2 / (mass * GRAVITY)],
        "damping": {"linear": [0.0] * 3 + [2.0 * ratio * rate * inertia] * 3},
    }

    def rates(_: float, y: Floats) -> list[float]:
        return [y[1], -rate * rate * math.sin(y[0]) - 2.0 * ratio * rate * y[1]]

    def reference(times: Floats) -> Reference:
        (angle, speed), uncertainty = solve_twice(rates, [start, 0.0], times)
        values = {"attitude": about(X, angle), "rate": np.outer(speed, X)}
        return Reference(values, "equation of the roll, by SciPy, two tolerances", uncertainty)

    return motion_case(
        "weakly damped roll",
        "60 s of roll at 3 rad/s from 0.5 rad, damping ratio 0.001: attitude and rate every 0.5 s",
        single_body("weakly damped roll", body, DENSITY, GRAVITY),
        instants(0.5, 120),
        reference,
        {4: 0.01, 3: 0.004, 2: 0.002, 1: 0.0005},
        {"rotation": about(X, start)},
        reason="180 rad of phase: the relative error of the period, (h rate)^p, counts 180 times",
    )


def _rise() -> Case:
    """A nearly neutral body rises against quadratic damping, v = v_t tanh(t/T), z = v_t T ln cosh(t/T), and spins."""
    mass, added, surplus, drag, spin = 10.0, 8.0, 1e-3, 20.0, 0.3
    body = {
        "mass": mass,
        "inertia": [0.5] * 3,
        "volume": (mass + surplus) / DENSITY,
        "added_mass": [added] * 3 + [0.0] * 3,
        "damping": {"quadratic": [drag] * 3 + [0.0] * 3},
    }

    def reference(times: Floats) -> Quantities:
        terminal = math.sqrt(surplus * GRAVITY / drag)
        scale = (mass + added) / (drag * terminal)
        return {
            "position": np.outer(terminal * scale * np.log(np.cosh(times / scale)), Z),
            "velocity": np.outer(terminal * np.tanh(times / scale), Z),
            "attitude": about(Z, spin * times),
        }

    return motion_case(
        "slow rise",
        "a body 1e-4 lighter than its water rises and spins for 100 s: pose and velocity every 5 s",
        single_body("rise", body, DENSITY, GRAVITY),
        instants(5.0, 20),
        reference,
        {2: 0.1, 1: 0.005},
        {"twist": [0.0, 0.0, 0.0, 0.0, 0.0, spin]},
    )


def _gyrostat() -> Case:
    """A rotor in a free vehicle, both symmetric about its axis z: a gyrostat (see `precession`)."""
    transverse, axial, rotor, speed, rate = 0.05, 0.06, 0.001, 300.0, np.array([0.3, -0.2, 0.5])
    vehicle = single_body("gyrostat", {"mass": 5.0, "inertia": [transverse - rotor, transverse - rotor, axial]})

    def reference(times: Floats) -> Quantities:
        values = precession(transverse, axial + rotor, rate, times, rotor * speed)
        return values | {"q'": np.full((len(times), 1), speed)}

    return motion_case(
        "rotor in a free vehicle",
        "a rotor at 300 rad/s makes a free vehicle precess at 7 rad/s, 20 s: attitude, rates every 0.5 s",
        with_arm(vehicle, link("rotor", {"mass": 0.2, "inertia": [rotor] * 3})),
        instants(0.5, 40),
        reference,
        {4: 0.0025, 3: 0.00125, 2: 0.0005, 1: 0.0001},
        {"twist": [0.0, 0.0, 0.0, *rate], "qd": [speed]},
        reason="132 rad of precession: the relative error of its rate, (h rate)^p, counts 132 times",
    )


CASES = (FASTER, LONG_TUMBLE, _roll(), _rise(), _gyrostat())
