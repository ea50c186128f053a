"""Cases of oscillations: undamped and driven joints, over many periods or revolutions; errors add up."""

import math
from functools import cache

import numpy as np

from uvms_gym import Simulator
from uvms_gym.studies.hard_cases.case import (
    Case,
    CaseRunner,
    Quantities,
    Reference,
    Scene,
    instants,
    link,
    motion,
    single_body,
    with_arm,
)
from uvms_gym.studies.hard_cases.reference_solutions import solve_twice
from uvms_gym.studies.hard_cases.secular import DENSITY, GRAVITY, neutral
from uvms_gym.studies.numerics import Floats


def _hinged(name: str, mass: float, inertia: float, com: float, fixed: bool) -> Scene:
    """Make the scene of a vehicle of 2 kg with a neutral link on a joint about y at its origin."""
    scene = single_body(name, neutral(2.0, 0.02), DENSITY, gravity=[0.0, 0.0, -GRAVITY])
    body = neutral(mass, inertia) | {"center_of_mass": [0.0, 0.0, -com]}
    return with_arm(scene, link("link", body, 1), fixed=fixed)


# An undamped pendulum of 22 rad/s: a neutrally buoyant link on the centre of mass of a vehicle, free or fixed, whose
# weight and buoyancy make a couple. The vehicle does not rotate, and both together stay: q'' = -m g l / I sin q with
# I = I_c + mu l^2, mu the reduced mass of both, or m with a fixed vehicle.
JOINT = {"vehicle": 2.0, "mass": 0.5, "com": 0.012, "rate": 22.0}
JOINT_STARTS = np.array([0.1, 2.5])
JOINT_TIMES = instants(0.25, 40)


def _run_joint(runner: CaseRunner) -> Quantities:
    vehicle, mass, com, rate = JOINT.values()
    values: Quantities = {}
    for which, reduced in (("held", mass), ("free", mass * vehicle / (mass + vehicle))):
        inertia = mass * GRAVITY * com / rate**2 - reduced * com * com
        scene = _hinged("undamped joint", mass, inertia, com, which == "held")
        state = {"q": JOINT_STARTS[:, None]}
        found = motion(scene, JOINT_TIMES, _observe_joints, len(JOINT_STARTS), **state)(runner)
        for i, start in enumerate(JOINT_STARTS):
            values |= {f"{name}, {which}, {start:g} rad": found[name][:, i] for name in ("q", "q'")}
    # Of the free one, relative to 0.1 m.
    return values | {"position, free": 0.1 + found["position"]}


def _observe_joints(s: Simulator) -> Quantities:
    return {"q": s.q, "q'": s.qd, "position": s.position}


def _joint_reference() -> Reference:
    from scipy.special import ellipj, ellipk

    vehicle, mass, com, rate = JOINT.values()
    values: Quantities = {}
    positions = np.zeros((len(JOINT_TIMES), len(JOINT_STARTS), 3))
    for i, start in enumerate(JOINT_STARTS):
        k = math.sin(0.5 * start)
        sn, cn, _, _ = ellipj(rate * JOINT_TIMES + ellipk(k * k), k * k)
        q = 2.0 * np.arcsin(k * sn)
        for which in ("held", "free"):
            values |= {f"q, {which}, {start:g} rad": q[:, None]}
            values |= {f"q', {which}, {start:g} rad": (2.0 * k * rate * cn)[:, None]}
        part = mass / (mass + vehicle) * com
        positions[:, i, 0] = part * (np.sin(q) - math.sin(start))
        positions[:, i, 2] = part * (np.cos(q) - math.cos(start))
    return Reference(values | {"position, free": 0.1 + positions}, "Jacobi elliptic functions")


UNDAMPED_JOINT = Case(
    name="undamped joint of 22 rad/s",
    description="a pendulum joint on a fixed and on a free vehicle, amplitudes 0.1 and 2.5 rad, 10 s: joint, position",
    run=_run_joint,
    reference=_joint_reference,
    steps={4: 0.0005, 2: 0.000125, 1: 1e-5},
    implicit_steps={2: 0.0001},
    interval=0.25,
    bounds={"float32": 2e-2},
    reason="220 rad of phase: the relative error of the period, (h rate)^p, and in float32 rounding, count 220 times",
)


# A rotor off balance on a fixed vehicle, under gravity: q'^2 = W^2 - 2 w^2 (1 - cos q), so q/2 = am(W t/2, (2 w/W)^2).
ROTOR = {"mass": 0.5, "com": 0.012, "rate": 22.0, "speed": 300.0}
ROTOR_TIMES = instants(0.5, 40)


def _rotor_scene() -> Scene:
    mass, com, rate, _ = ROTOR.values()
    return _hinged("rotor", mass, mass * GRAVITY * com / rate**2 - mass * com * com, com, True)


def _rotor_reference() -> Reference:
    from scipy.special import ellipj

    _, _, rate, speed = ROTOR.values()
    _, _, dn, amplitude = ellipj(0.5 * speed * ROTOR_TIMES, (2.0 * rate / speed) ** 2)
    return Reference({"q": 2.0 * amplitude[:, None], "q'": speed * dn[:, None]}, "Jacobi elliptic functions")


ROTOR_CASE = Case(
    name="rotor at 300 rad/s",
    description="a rotor off balance on a fixed vehicle, under gravity, 20 s: 955 revolutions, joint every 0.5 s",
    run=motion(_rotor_scene, ROTOR_TIMES, ["q", "q'"], qd=[ROTOR["speed"]]),
    reference=_rotor_reference,
    steps={4: 0.0005, 3: 0.0002, 2: 0.0001, 1: 2e-5},
    interval=0.5,
    bounds={"float32": 2e-2},
    judges_warnings=False,
    reason="6000 rad: the relative error of the speed counts 300 times a second, and so does its rounding in float32; "
    "warnings set the angle against a radian",
)

# Resonance: a link on a spring of 4 pi rad/s between it and a free vehicle, whose rest position jumps from side to side
# every half period. In each, q turns about the rest position by half a revolution: 2 k a after k of them.
RESONANCE = {"vehicle": 2.0, "mass": 0.5, "rate": 4.0 * math.pi, "push": 0.01}
RESONANCE_QUARTER, RESONANCE_HALVES = 0.125, 160


def _run_resonance(runner: CaseRunner) -> Quantities:
    vehicle, mass, rate, push = RESONANCE.values()
    stiffness = mass * vehicle / (mass + vehicle) * rate**2
    body, spring = {"mass": mass, "inertia": [0.01] * 3}, {"kp": stiffness, "kd": 0.0}
    scene = single_body("resonance", {"mass": vehicle, "inertia": [0.1] * 3})
    s = runner.simulator(with_arm(scene, link("link", body, 0, kind="prismatic", servo=spring)))
    rows = []
    for k in range(2 * RESONANCE_HALVES):
        runner.advance(s, RESONANCE_QUARTER, joint_target=[push if k % 4 < 2 else -push])
        rows.append((s.q[0], s.qd[0], s.position[0]))
    return dict(zip(("q", "q'", "position"), map(np.array, zip(*rows, strict=True)), strict=True))


def _resonance_reference() -> Reference:
    vehicle, mass, rate, push = RESONANCE.values()
    q, qd = np.zeros((2, 2 * RESONANCE_HALVES))
    for k in range(RESONANCE_HALVES):
        rest, start = (push, -2.0 * k * push) if k % 2 == 0 else (-push, 2.0 * k * push)
        q[2 * k : 2 * k + 2] = rest, 2.0 * rest - start
        qd[2 * k] = rate * (rest - start)
    position = np.outer(q, np.array([-mass / (mass + vehicle), 0.0, 0.0]))
    return Reference({"q": q[:, None], "q'": qd[:, None], "position": position}, "closed form")


RESONANCE_CASE = Case(
    name="resonance",
    description="a sliding link on a spring, driven at its natural frequency for 80 periods: joint, vehicle's position",
    run=_run_resonance,
    reference=_resonance_reference,
    steps={4: 0.00125, 3: 0.001, 2: 0.00025, 1: 5e-5},
    interval=RESONANCE_QUARTER,
    bounds={"float32": 5e-3},
    reason="500 rad of phase: the relative error of the period, (h rate)^p, and in float32 rounding, count 500 times",
)


# A stiff mode beside an undamped one: a link slides on a spring of 5 rad/s, and across it a second link against damping
# of rate 1000/s. The vehicle is fixed; at right angles neither acts on the other.
STIFF_PAIR = {"rate": 5.0, "start": 0.3, "fast": 1000.0, "slow": 2.0, "target": 0.2}
STIFF_PAIR_MASSES = (2.0, 0.5)
STIFF_PAIR_TIMES = instants(0.5, 40)


def _run_stiff_pair(runner: CaseRunner) -> Quantities:
    rate, start, fast, slow, target = STIFF_PAIR.values()
    first, second = STIFF_PAIR_MASSES
    springs = (
        {"kp": (first + second) * rate**2, "kd": 0.0},
        {"kp": second * fast * slow, "kd": second * (fast + slow)},
    )
    links = (
        link("xy"[k], {"mass": mass, "inertia": [0.01] * 3}, k, kind="prismatic", servo=springs[k])
        for k, mass in enumerate(STIFF_PAIR_MASSES)
    )
    scene = single_body("stiff and undamped", {"mass": 1.0, "inertia": [1.0] * 3})
    s = runner.simulator(with_arm(scene, *links, fixed=True))
    s.set_state(q=[start, 0.0])
    return runner.sampled(s, STIFF_PAIR_TIMES, ["q", "q'"], joint_target=[0.0, target])


def _stiff_pair_reference() -> Reference:
    rate, start, fast, slow, target = STIFF_PAIR.values()
    t = STIFF_PAIR_TIMES
    slowly, fastly = np.exp(-slow * t), np.exp(-fast * t)
    damped = target * (1.0 - (fast * slowly - slow * fastly) / (fast - slow))
    q = np.stack([start * np.cos(rate * t), damped], axis=1)
    damped_rate = target * fast * slow * (slowly - fastly) / (fast - slow)
    qd = np.stack([-start * rate * np.sin(rate * t), damped_rate], axis=1)
    return Reference({"q": q, "q'": qd}, "closed form")


STIFF_AND_UNDAMPED = Case(
    name="stiff beside undamped",
    description="sliding links: one undamped at 5 rad/s, one across it against damping of 1000/s, 20 s: joints",
    run=_run_stiff_pair,
    reference=_stiff_pair_reference,
    steps={2: 0.0005, 1: 2e-5},
    implicit_steps={2: 0.00125},
    interval=0.5,
    reason="explicit methods need steps below the time constant of 1 ms; the oscillation limits linearly implicit ones",
)


# Nine decades of mass: a chain of four pendulums, each a thousandth of the one above. Lagrange's equations in the
# angles from the vertical, with the mass centre of each link at the next hinge.
CHAIN_MASSES, CHAIN_LENGTHS = 10.0 ** np.array([3, 0, -3, -6]), np.array([1.0, 0.5, 0.3, 0.2])
CHAIN_START = np.array([0.1, -0.05, 0.05, 0.05])
CHAIN_INERTIAS = 0.1 * CHAIN_MASSES * CHAIN_LENGTHS**2
CHAIN_TIMES = instants(0.25, 40)


def _chain_scene() -> Scene:
    links = (
        link(
            f"link {i}",
            {"mass": m, "center_of_mass": [0.0, 0.0, -down], "inertia": [inertia] * 3},
            1,
            (0.0, 0.0, -up),
        )
        for i, (up, down, m, inertia) in enumerate(
            np.transpose([[0.0, *CHAIN_LENGTHS[:-1]], CHAIN_LENGTHS, CHAIN_MASSES, CHAIN_INERTIAS]).tolist()
        )
    )
    scene = single_body("chain", {"mass": 1e3, "inertia": [1e3] * 3}, gravity=[0.0, 0.0, -GRAVITY])
    return with_arm(scene, *links, fixed=True)


@cache
def _chain_reference() -> Reference:
    count = len(CHAIN_MASSES)
    below = np.cumsum(CHAIN_MASSES[::-1])[::-1]
    coupling = np.outer(CHAIN_LENGTHS, CHAIN_LENGTHS) * below[np.maximum.outer(np.arange(count), np.arange(count))]

    def rates(_: float, y: Floats) -> Floats:
        angle, speed = y[:count], y[count:]
        apart = angle[:, None] - angle
        moment = -(coupling * np.sin(apart)) @ speed**2 - below * GRAVITY * CHAIN_LENGTHS * np.sin(angle)
        mass = coupling * np.cos(apart) + np.diag(CHAIN_INERTIAS)
        return np.concatenate([speed, np.linalg.solve(mass, moment)])

    start = np.concatenate([np.cumsum(CHAIN_START), np.zeros(count)])
    found, uncertainty = solve_twice(rates, start, CHAIN_TIMES)
    relative = [np.diff(part, axis=0, prepend=0.0).T for part in (found[:count], found[count:])]
    source = "Lagrange's equations, by SciPy, two tolerances"
    return Reference(dict(zip(("q", "q'"), relative, strict=True)), source, uncertainty)


CHAIN = Case(
    name="nine decades of mass",
    description="a chain of four pendulums, each a thousandth of the mass of the one above, 10 s: joints every 0.25 s",
    run=motion(_chain_scene, CHAIN_TIMES, ["q", "q'"], q=CHAIN_START),
    reference=_chain_reference,
    steps={4: 0.005, 3: 0.0025, 2: 0.00125, 1: 0.0001},
    interval=0.25,
    reason="small angles: larger ones are chaotic",
)

CASES = (UNDAMPED_JOINT, ROTOR_CASE, RESONANCE_CASE, STIFF_AND_UNDAMPED, CHAIN)
