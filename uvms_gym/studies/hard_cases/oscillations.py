"""Cases of oscillations: undamped and driven joints, over many periods or revolutions; errors add up."""

import math

import numpy as np

from uvms_gym.studies.hard_cases.case import Case, CaseRunner, Quantities, Reference, instants, motion, motion_case
from uvms_gym.studies.hard_cases.reference_solutions import pendulum, solve_twice
from uvms_gym.studies.hard_cases.scenes import DENSITY, GRAVITY, Scene, link, neutral, single_body, with_arm
from uvms_gym.studies.numerics import Floats


def _hinged(name: str, mass: float, inertia: float, com: float, fixed: bool) -> Scene:
    """Make the scene of a vehicle of 2 kg with a neutral link on a joint about y at its origin."""
    scene = single_body(name, neutral(2.0, 0.02), DENSITY, GRAVITY)
    body = neutral(mass, inertia) | {"center_of_mass": [0.0, 0.0, -com]}
    return with_arm(scene, link("link", body, 1), fixed=fixed)


def _undamped_joint() -> Case:
    """An undamped pendulum of 22 rad/s: a neutral link on the centre of mass of a vehicle, free or fixed.

    Weight and buoyancy make a couple. The vehicle does not rotate, and both together stay: q'' = -m g l / I sin q with
    I = I_c + mu l^2, mu the reduced mass of both, or m with a fixed vehicle.
    """
    vehicle, mass, com, rate = 2.0, 0.5, 0.012, 22.0
    starts, times = np.array([0.1, 2.5]), instants(0.25, 40)

    def run(runner: CaseRunner) -> Quantities:
        values: Quantities = {}
        for which, reduced in (("held", mass), ("free", mass * vehicle / (mass + vehicle))):
            inertia = mass * GRAVITY * com / rate**2 - reduced * com * com
            scene = _hinged("undamped joint", mass, inertia, com, which == "held")
            found = motion(
                scene,
                times,
                lambda s: {"q": s.q, "q'": s.qd, "position": s.position},
                {"q": starts[:, None]},
                len(starts),
            )(runner)
            for i, start in enumerate(starts):
                values |= {f"{name}, {which}, {start:g} rad": found[name][:, i] for name in ("q", "q'")}
        # Of the free one, relative to 0.1 m.
        return values | {"position, free": 0.1 + found["position"]}

    def reference() -> Reference:
        values: Quantities = {}
        positions = np.zeros((len(times), len(starts), 3))
        part = mass / (mass + vehicle) * com
        for i, start in enumerate(starts):
            q, qd = pendulum(start, rate, times)
            for which in ("held", "free"):
                values |= {f"q, {which}, {start:g} rad": q[:, None], f"q', {which}, {start:g} rad": qd[:, None]}
            positions[:, i, 0] = part * (np.sin(q) - math.sin(start))
            positions[:, i, 2] = part * (np.cos(q) - math.cos(start))
        return Reference(values | {"position, free": 0.1 + positions}, "Jacobi elliptic functions")

    return Case(
        "undamped joint of 22 rad/s",
        "a pendulum joint on a fixed and on a free vehicle, amplitudes 0.1 and 2.5 rad, 10 s: joint, position",
        run,
        reference,
        {4: 0.0005, 2: 0.000125, 1: 1e-5},
        0.25,
        implicit_steps={2: 0.0001},
        bounds={"float32": 2e-2},
        reason="220 rad of phase: the relative error of the period, (h rate)^p, and in float32 rounding, count 220 "
        "times",
    )


def _rotor() -> Case:
    """A rotor off balance on a fixed vehicle, under gravity.

    q'^2 = W^2 - 2 w^2 (1 - cos q), so q/2 = am(W t/2, (2 w/W)^2).
    """
    mass, com, rate, speed = 0.5, 0.012, 22.0, 300.0

    def reference(times: Floats) -> Reference:
        from scipy.special import ellipj

        _, _, dn, amplitude = ellipj(0.5 * speed * times, (2.0 * rate / speed) ** 2)
        return Reference({"q": 2.0 * amplitude[:, None], "q'": speed * dn[:, None]}, "Jacobi elliptic functions")

    return motion_case(
        "rotor at 300 rad/s",
        "a rotor off balance on a fixed vehicle, under gravity, 20 s: 955 revolutions, joint every 0.5 s",
        _hinged("rotor", mass, mass * GRAVITY * com / rate**2 - mass * com * com, com, True),
        instants(0.5, 40),
        reference,
        {4: 0.0005, 3: 0.0002, 2: 0.0001, 1: 2e-5},
        {"qd": [speed]},
        bounds={"float32": 2e-2},
        judges_warnings=False,
        reason="6000 rad: the relative error of the speed counts 300 times a second, and so does its rounding in "
        "float32; warnings set the angle against a radian",
    )


def _resonance() -> Case:
    """A link on a spring of 4 pi rad/s between it and a free vehicle, driven at its natural frequency.

    The rest position jumps from side to side every half period. In each, q turns about the rest position by half a
    revolution: 2 k a after k of them.
    """
    vehicle, mass, rate, push = 2.0, 0.5, 4.0 * math.pi, 0.01
    quarter, halves = 0.125, 160
    spring = {"kp": mass * vehicle / (mass + vehicle) * rate**2, "kd": 0.0}
    slider = link("link", {"mass": mass, "inertia": [0.01] * 3}, 0, kind="prismatic", servo=spring)
    scene = with_arm(single_body("resonance", {"mass": vehicle, "inertia": [0.1] * 3}), slider)

    def run(runner: CaseRunner) -> Quantities:
        s = runner.simulator(scene)
        rows = []
        for k in range(2 * halves):
            runner.advance(s, quarter, joint_target=[push if k % 4 < 2 else -push])
            rows.append((s.q[0], s.qd[0], s.position[0]))
        return dict(zip(("q", "q'", "position"), map(np.array, zip(*rows, strict=True)), strict=True))

    def reference() -> Reference:
        q, qd = np.zeros((2, 2 * halves))
        for k in range(halves):
            rest, start = (push, -2.0 * k * push) if k % 2 == 0 else (-push, 2.0 * k * push)
            q[2 * k : 2 * k + 2] = rest, 2.0 * rest - start
            qd[2 * k] = rate * (rest - start)
        position = np.outer(q, np.array([-mass / (mass + vehicle), 0.0, 0.0]))
        return Reference({"q": q[:, None], "q'": qd[:, None], "position": position}, "closed form")

    return Case(
        "resonance",
        "a sliding link on a spring, driven at its natural frequency for 80 periods: joint, vehicle's position",
        run,
        reference,
        {4: 0.00125, 3: 0.001, 2: 0.00025, 1: 5e-5},
        quarter,
        bounds={"float32": 5e-3},
        reason="500 rad of phase: the relative error of the period, (h rate)^p, and in float32 rounding, count 500 "
        "times",
    )


def _stiff_and_undamped() -> Case:
    """A stiff mode beside an undamped one, on a fixed vehicle: at right angles neither acts on the other.

    A link slides on a spring of 5 rad/s, and across it a second link against damping of rate 1000/s.
    """
    rate, start, fast, slow, target = 5.0, 0.3, 1000.0, 2.0, 0.2
    first, second = 2.0, 0.5
    sliders = (
        ("x", first, {"kp": (first + second) * rate**2, "kd": 0.0}),
        ("y", second, {"kp": second * fast * slow, "kd": second * (fast + slow)}),
    )
    links = (
        link(name, {"mass": mass, "inertia": [0.01] * 3}, k, kind="prismatic", servo=spring)
        for k, (name, mass, spring) in enumerate(sliders)
    )
    vehicle = single_body("stiff and undamped", {"mass": 1.0, "inertia": [1.0] * 3})

    def reference(t: Floats) -> Quantities:
        slowly, fastly = np.exp(-slow * t), np.exp(-fast * t)
        damped = target * (1.0 - (fast * slowly - slow * fastly) / (fast - slow))
        damped_rate = target * fast * slow * (slowly - fastly) / (fast - slow)
        return {
            "q": np.stack([start * np.cos(rate * t), damped], axis=1),
            "q'": np.stack([-start * rate * np.sin(rate * t), damped_rate], axis=1),
        }

    return motion_case(
        "stiff beside undamped",
        "sliding links: one undamped at 5 rad/s, one across it against damping of 1000/s, 20 s: joints",
        with_arm(vehicle, *links, fixed=True),
        instants(0.5, 40),
        reference,
        {2: 0.0005, 1: 2e-5},
        {"q": [start, 0.0]},
        inputs={"joint_target": [0.0, target]},
        implicit_steps={2: 0.00125},
        reason="explicit methods need steps below the time constant of 1 ms; the oscillation limits linearly implicit "
        "ones",
    )


def _chain() -> Case:
    """Nine decades of mass: a chain of four pendulums, each a thousandth of the one above.

    Lagrange's equations in the angles from the vertical, with the mass centre of each link at the next hinge.
    """
    masses, lengths = 10.0 ** np.array([3, 0, -3, -6]), np.array([1.0, 0.5, 0.3, 0.2])
    start, inertias, count = np.array([0.1, -0.05, 0.05, 0.05]), 0.1 * masses * lengths**2, len(masses)
    columns = np.transpose([[0.0, *lengths[:-1]], lengths, masses, inertias]).tolist()
    links = (
        link(
            f"link {i}",
            {"mass": m, "center_of_mass": [0.0, 0.0, -down], "inertia": [inertia] * 3},
            1,
            (0.0, 0.0, -up),
        )
        for i, (up, down, m, inertia) in enumerate(columns)
    )
    vehicle = single_body("chain", {"mass": 1e3, "inertia": [1e3] * 3}, gravity=GRAVITY)
    below = np.cumsum(masses[::-1])[::-1]
    coupling = np.outer(lengths, lengths) * below[np.maximum.outer(np.arange(count), np.arange(count))]

    def rates(_: float, y: Floats) -> Floats:
        angle, speed = y[:count], y[count:]
        difference = angle[:, None] - angle
        moment = -(coupling * np.sin(difference)) @ speed**2 - below * GRAVITY * lengths * np.sin(angle)
        mass = coupling * np.cos(difference) + np.diag(inertias)
        return np.concatenate([speed, np.linalg.solve(mass, moment)])

    def reference(times: Floats) -> Reference:
        found, uncertainty = solve_twice(rates, np.concatenate([np.cumsum(start), np.zeros(count)]), times)
        q, qd = (np.diff(part, axis=0, prepend=0.0).T for part in (found[:count], found[count:]))
        return Reference({"q": q, "q'": qd}, "Lagrange's equations, by SciPy, two tolerances", uncertainty)

    return motion_case(
        "nine decades of mass",
        "a chain of four pendulums, each a thousandth of the mass of the one above, 10 s: joints every 0.25 s",
        with_arm(vehicle, *links, fixed=True),
        instants(0.25, 40),
        reference,
        {4: 0.005, 3: 0.0025, 2: 0.00125, 1: 0.0001},
        {"q": start},
        reason="small angles: larger ones are chaotic",
    )


CASES = (_undamped_joint(), _rotor(), _resonance(), _stiff_and_undamped(), _chain())
