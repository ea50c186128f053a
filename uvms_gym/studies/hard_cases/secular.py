"""Cases of errors that add up: long motions of which each step errs little; one body, or a vehicle with a rotor."""

import math
from functools import cache

import numpy as np

from uvms_gym.studies.hard_cases.case import Case, CaseRunner, Quantities, Reference, Scene, instants, single_body
from uvms_gym.studies.hard_cases.reference_solutions import Top, rotation_about
from uvms_gym.studies.hard_cases.spinning import run_top, top_reference
from uvms_gym.studies.hard_cases.water import FAST_TIMES, fast_reference, run_fast
from uvms_gym.studies.numerics import Floats

GRAVITY = 9.81
DENSITY = 1000.0


def neutral(mass: float, inertia: float) -> Scene:
    """Make a neutrally buoyant body, both centres at its origin."""
    return {"mass": mass, "inertia": [inertia] * 3, "volume": mass / DENSITY}


# Quadratic damping from 200 m/s.
FASTER = Case(
    name="quadratic damping at 200 m/s",
    description="5 s of deceleration from 200 m/s, and of reversal by a force: speed and distance every 0.1 s",
    run=lambda runner: run_fast(runner, 200.0),
    reference=lambda: fast_reference(200.0),
    steps={4: 0.0005, 2: 0.00025, 1: 0.0001},
    interval=FAST_TIMES[0],
    reason="the speed halves within 0.005 s at first",
)


# A free asymmetric tumble for 500 s.
LONG_TUMBLE = Top(np.array([1.0, 2.0, 2.6]), 2.0 * np.array([0.7, 0.5, -0.6]) / math.sqrt(1.1))
LONG_TUMBLE_TIMES = instants(5.0, 100)

LONG_TUMBLE_CASE = Case(
    name="tumble for 500 s",
    description="500 s of tumbling at 2 rad/s about all three axes, 1000 rad: attitude and rate every 5 s",
    run=lambda runner: run_top(runner, "long tumble", LONG_TUMBLE, LONG_TUMBLE_TIMES),
    reference=cache(lambda: top_reference(LONG_TUMBLE, LONG_TUMBLE_TIMES)),
    steps={4: 0.01, 3: 0.002, 2: 0.0025, 1: 5e-5},
    interval=5.0,
    bounds={"float32": 5e-2},
    reason="1000 rad: in float32 the rounding of up to 250 000 steps adds up to 0.02 rad",
)


# Weakly damped roll: weight and buoyancy apart make a couple, I r'' = -m g d sin r - 2 z w I r'.
ROLL = {"mass": 10.0, "inertia": 0.5, "rate": 3.0, "ratio": 1e-3, "start": 0.5}
ROLL_TIMES = instants(0.5, 120)


def _run_roll(runner: CaseRunner) -> Quantities:
    mass, inertia, rate, ratio, start = ROLL.values()
    above = inertia * rate**2 / (mass * GRAVITY)
    body = neutral(mass, inertia) | {
        "center_of_buoyancy": [0.0, 0.0, above],
        "damping": {"linear": [0.0] * 3 + [2.0 * ratio * rate * inertia] * 3},
    }
    s = runner.simulator(single_body("weakly damped roll", body, DENSITY, gravity=[0.0, 0.0, -GRAVITY]))
    s.set_state(rotation=rotation_about(np.eye(3)[0], start)[0])
    return runner.sampled(s, ROLL_TIMES, ["attitude", "rate"])


@cache
def _roll_reference() -> Reference:
    from scipy.integrate import solve_ivp

    _, _, rate, ratio, start = ROLL.values()

    def rates(_: float, y: Floats) -> list[float]:
        return [y[1], -rate * rate * math.sin(y[0]) - 2.0 * ratio * rate * y[1]]

    fine, coarse = (
        solve_ivp(rates, (0.0, ROLL_TIMES[-1]), [start, 0.0], "DOP853", ROLL_TIMES, rtol=rtol, atol=rtol).y
        for rtol in (1e-13, 1e-11)
    )
    x = np.eye(3)[0]
    values = {"attitude": rotation_about(x, fine[0]), "rate": np.outer(fine[1], x)}
    return Reference(values, "equation of the roll, by SciPy, two tolerances", float(np.abs(fine - coarse).max()))


WEAK_DAMPING = Case(
    name="weakly damped roll",
    description="60 s of roll at 3 rad/s from 0.5 rad, damping ratio 0.001: attitude and rate every 0.5 s",
    run=_run_roll,
    reference=_roll_reference,
    steps={4: 0.01, 3: 0.004, 2: 0.002, 1: 0.0005},
    interval=0.5,
    reason="180 rad of phase: the relative error of the period, (h rate)^p, counts 180 times",
)


# A nearly neutrally buoyant body rises against quadratic damping, v = v_t tanh(t/T), z = v_t T ln cosh(t/T), and spins.
RISE = {"mass": 10.0, "added": 8.0, "surplus": 1e-3, "drag": 20.0, "spin": 0.3}
RISE_TIMES = instants(5.0, 20)


def _run_rise(runner: CaseRunner) -> Quantities:
    mass, added, surplus, drag, spin = RISE.values()
    body = {
        "mass": mass,
        "inertia": [0.5] * 3,
        "volume": (mass + surplus) / DENSITY,
        "added_mass": [added] * 3 + [0.0] * 3,
        "damping": {"quadratic": [drag] * 3 + [0.0] * 3},
    }
    s = runner.simulator(single_body("rise", body, DENSITY, gravity=[0.0, 0.0, -GRAVITY]))
    s.set_state(twist=[0.0, 0.0, 0.0, 0.0, 0.0, spin])
    return runner.sampled(s, RISE_TIMES, ["position", "velocity", "attitude"])


def _rise_reference() -> Reference:
    mass, added, surplus, drag, spin = RISE.values()
    terminal = math.sqrt(surplus * GRAVITY / drag)
    scale, z = (mass + added) / (drag * terminal), np.eye(3)[2]
    values = {
        "position": np.outer(terminal * scale * np.log(np.cosh(RISE_TIMES / scale)), z),
        "velocity": np.outer(terminal * np.tanh(RISE_TIMES / scale), z),
        "attitude": rotation_about(z, spin * RISE_TIMES),
    }
    return Reference(values, "closed form")


SLOW_RISE = Case(
    name="slow rise",
    description="a body 1e-4 lighter than its water rises and spins for 100 s: pose and velocity every 5 s",
    run=_run_rise,
    reference=_rise_reference,
    steps={2: 0.1, 1: 0.005},
    interval=5.0,
)


# A rotor at 300 rad/s in a free vehicle, both symmetric about its axis z: a gyrostat. Its angular momentum H is
# constant, and so is H_3 in body axes: precession about H at |H|/A and rotation about z at w_3 - H_3/A, with the
# transverse inertia A of both.
GYROSTAT = {"transverse": 0.05, "axial": 0.06, "rotor": 0.001, "speed": 300.0}
GYROSTAT_RATE = np.array([0.3, -0.2, 0.5])
GYROSTAT_TIMES = instants(0.5, 40)


def _run_gyrostat(runner: CaseRunner) -> Quantities:
    transverse, axial, rotor, speed = GYROSTAT.values()
    vehicle = {"mass": 5.0, "inertia": [transverse - rotor, transverse - rotor, axial]}
    scene = single_body("gyrostat", vehicle)
    link = {"mass": 0.2, "inertia": [rotor] * 3}
    joint = {"kind": "revolute", "axis": [0.0, 0.0, 1.0]}
    scene["arm"] = {"name": "arm", "links": [{"name": "rotor", "joint": joint, "body": link}]}
    s = runner.simulator(scene)
    s.set_state(twist=np.concatenate([np.zeros(3), GYROSTAT_RATE]), qd=[speed])
    return runner.sampled(s, GYROSTAT_TIMES, ["attitude", "rate", "q'"])


def _gyrostat_reference() -> Reference:
    transverse, axial, rotor, speed = GYROSTAT.values()
    inertia, spin = np.array([transverse, transverse, axial + rotor]), np.array([0.0, 0.0, rotor * speed])
    momentum = inertia * GYROSTAT_RATE + spin
    size, z, t = float(np.linalg.norm(momentum)), np.eye(3)[2], GYROSTAT_TIMES
    turned = rotation_about(z, (GYROSTAT_RATE[2] - momentum[2] / transverse) * t)
    attitude = rotation_about(momentum / size, size / transverse * t) @ turned
    values = {
        "attitude": attitude,
        "rate": (np.swapaxes(attitude, 1, 2) @ momentum - spin) / inertia,
        "q'": np.full((len(t), 1), speed),
    }
    return Reference(values, "closed form")


GYROSTAT_CASE = Case(
    name="rotor in a free vehicle",
    description="a rotor at 300 rad/s makes a free vehicle precess at 7 rad/s, 20 s: attitude, rates every 0.5 s",
    run=_run_gyrostat,
    reference=_gyrostat_reference,
    steps={4: 0.0025, 3: 0.00125, 2: 0.0005, 1: 0.0001},
    interval=0.5,
    reason="132 rad of precession: the relative error of its rate, (h rate)^p, counts 132 times",
)

CASES = (FASTER, LONG_TUMBLE_CASE, WEAK_DAMPING, SLOW_RISE, GYROSTAT_CASE)
