"""Cases of added mass, damping, restoring and current: one body in water."""

import math

import numpy as np

from uvms_gym import Simulator, load_scene
from uvms_gym._rotations import about
from uvms_gym.studies.hard_cases.case import Case, CaseRunner, Quantities, Reference, instants, motion_case
from uvms_gym.studies.hard_cases.reference_solutions import force_free_reference, inertia_of
from uvms_gym.studies.hard_cases.scenes import DENSITY, GRAVITY, Scene, single_body
from uvms_gym.studies.numerics import Floats


def _mass_ratio() -> Case:
    """Added mass far below and far above the mass: a body pushed against quadratic damping, and a free one.

    The first has v = v_t tanh(t/T) and x = v_t T ln cosh(t/T), T = (m + m_A) / (k v_t); added mass as a lagged force is
    unstable here above m_A = m. The second rotates about all axes: impulse and energy are conserved.
    """
    mass, drag, force, times = 10.0, 20.0, 20.0, instants(1.0, 10)
    ratios = np.array([0.01, 0.1, 1.0, 10.0, 100.0, 1000.0])
    added, twist = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]), np.array([0.5, -0.2, 0.1, 0.3, 0.5, -0.4])

    def by_ratio(name: str, rows: Floats) -> Quantities:
        return {f"{name} at {ratio:g}": row for ratio, row in zip(ratios, rows, strict=True)}

    def simulator(runner: CaseRunner, drag: float) -> Simulator:
        body = {"mass": mass, "inertia": [1.0] * 3, "added_mass": list(mass * added)}
        damping = {"quadratic": [drag, 0.0, 0.0, 0.0, 0.0, 0.0]}
        s = runner.simulator(single_body("mass ratio", body | {"damping": damping}, DENSITY), len(ratios))
        s.scale_parameters(added_mass=ratios)
        return s

    def observe_pushed(s: Simulator) -> Quantities:
        return by_ratio("speed", s.twist[:, :1]) | by_ratio("distance", s.position[:, :1])

    def observe_free(s: Simulator) -> Quantities:
        return by_ratio("energy", s.energy()["total"][:, None]) | by_ratio("impulse", s.momentum())

    def run(runner: CaseRunner) -> Quantities:
        pushed, free = (simulator(runner, k) for k in (drag, 0.0))
        free.set_state(twist=twist)
        values = runner.sampled(pushed, times, observe_pushed, wrench=[force, 0.0, 0.0, 0.0, 0.0, 0.0])
        return values | runner.sampled(free, times, observe_free)

    def reference() -> Reference:
        terminal, values = math.sqrt(force / drag), {}
        for ratio in ratios:
            scale = mass * (1.0 + ratio) / (drag * terminal)
            values[f"speed at {ratio:g}"] = terminal * np.tanh(times / scale)[:, None]
            values[f"distance at {ratio:g}"] = terminal * scale * np.log(np.cosh(times / scale))[:, None]
            inertia = np.diag(np.array([mass] * 3 + [1.0] * 3) + ratio * mass * added)
            values[f"energy at {ratio:g}"] = np.full((len(times), 1), 0.5 * twist @ inertia @ twist)
            values[f"impulse at {ratio:g}"] = np.tile(inertia @ twist, (len(times), 1))
        return Reference(values, "closed form; conservation laws")

    return Case(
        "added mass 0.01 to 1000 m",
        "six ratios, 10 s: speed and distance of a body pushed against quadratic damping; impulse and energy of a free "
        "one",
        run,
        reference,
        {4: 0.02, 3: 0.01, 2: 0.01, 1: 0.002},
        1.0,
    )


# Off-diagonal added mass: RexROV's published matrix, without damping and gravity: Kirchhoff's equations.
REXROV_TWIST = np.array([1.0, 0.3, -0.2, 0.1, 0.25, -0.3])


def _rexrov() -> Scene:
    scene = load_scene("rexrov")
    scene["vehicle"]["body"]["damping"] = {"linear": [0.0] * 6, "quadratic": [0.0] * 6}
    scene["water"]["gravity"] = [0.0] * 3
    return scene | {"provenance": {}, "name": "hard case off-diagonal"}


def _rexrov_reference(times: Floats) -> Reference:
    inertia = inertia_of(_rexrov()["vehicle"]["body"])
    found = force_free_reference(inertia, REXROV_TWIST, times)
    found.values["impulse"] = np.tile(inertia @ REXROV_TWIST, (len(times), 1))
    found.values["energy"] = np.full((len(times), 1), 0.5 * REXROV_TWIST @ inertia @ REXROV_TWIST)
    return found


OFF_DIAGONAL = motion_case(
    "off-diagonal added mass",
    "RexROV without damping, 10 s: pose and twist, impulse and energy every 1 s",
    _rexrov,
    instants(1.0, 10),
    _rexrov_reference,
    {4: 0.02, 3: 0.02, 2: 0.01, 1: 0.002},
    {"twist": REXROV_TWIST},
)


def _munk() -> Case:
    """Munk instability: a body in motion along its slender axis turns broadside, at a rate known from linearisation."""
    m, ax, ay, inertia, time, start = 10.0, 1.0, 9.0, 1.5, 4.0, 1e-7
    rate = math.sqrt((ay - ax) * (m + ax) / ((m + ay) * inertia))
    body = {"mass": m, "inertia": [inertia - 0.5] * 3, "added_mass": [ax, ay, ay, 0.5, 0.5, 0.5]}

    def run(runner: CaseRunner) -> Quantities:
        s = runner.simulator(single_body("munk", body, DENSITY))
        # The growing mode: sway v and yaw rate r with (m + ay) v' = -(m + ax) r.
        yaw_rate = -rate * (m + ay) / (m + ax) * start
        s.set_state(twist=[1.0, start, 0.0, 0.0, 0.0, yaw_rate])
        runner.advance(s, time)
        grown = s.twist[0, [1, 5]] / np.array([start, yaw_rate])
        return {"rate": np.log(np.where(grown > 0.0, grown, np.nan))[None] / time}

    reference = Reference({"rate": np.full((1, 2), rate)}, "closed form, linearised: 1e-8 from nonlinear terms")
    description = "growth rate of sway and of yaw over 4 s from 1e-7 of the speed"
    steps = {2: 0.04, 1: 0.02}
    return Case("Munk instability", description, run, lambda: reference, steps, time, implicit_steps={2: 0.02})


def fast_case(name: str, speed: float, steps: dict[int, float], reason: str) -> Case:
    """Make the case of quadratic damping that brakes from a speed, and of a force that reverses the same speed."""
    m, k, force = 19.0, 18.18, 20.0
    body = {"mass": m - 5.5, "inertia": [0.3] * 3, "added_mass": [5.5, 0.0, 0.0, 0.0, 0.0, 0.0]}
    names = ("speed, braked", "distance, braked", "speed, through zero", "distance, through zero")

    def observe(s: Simulator) -> Quantities:
        numbers = (part[i, :1] for i in range(2) for part in (s.twist, s.position))
        return dict(zip(names, numbers, strict=True))

    def reference(t: Floats) -> Quantities:
        terminal = math.sqrt(force / k)
        rate = k * terminal / m
        stop = math.atan(speed / terminal) / rate
        before, after = np.minimum(t, stop), np.maximum(t - stop, 0.0)
        # tan and ln cos while the speed is negative, tanh and ln cosh after.
        angle = rate * (before - stop)
        through = np.where(t < stop, np.tan(angle), np.tanh(rate * after)) * terminal
        turning = -np.log(np.cos(angle) / math.cos(rate * stop)) + np.log(np.cosh(rate * after))
        braked = speed / (1.0 + k * speed * t / m), m / k * np.log1p(k * speed * t / m)
        values = (*braked, through, m / k * turning)
        return {name: value[:, None] for name, value in zip(names, values, strict=True)}

    return motion_case(
        name,
        f"5 s of deceleration from {speed:g} m/s, and of reversal by a force: speed and distance every 0.1 s",
        single_body("fast damping", body | {"damping": {"quadratic": [k] + [0.0] * 5}}, DENSITY),
        instants(0.1, 50),
        reference,
        steps,
        {"twist": np.outer([speed, -speed], np.eye(6)[0])},
        observe,
        2,
        {"wrench": np.outer([0.0, force], np.eye(6)[0])},
        reason=reason,
    )


FAST_DAMPING = fast_case(
    "quadratic damping at 50 m/s",
    50.0,
    {4: 0.002, 2: 0.001, 1: 0.0005},
    "the speed halves within 0.02 s at first",
)


def _decay() -> Case:
    """Linear damping over six decades: errors relative to the decayed quantity.

    The body is isotropic: its velocity in world axes and its angular velocity decay exponentially, while rotation
    couples them in body axes.
    """
    decay, mass, inertia = 1.0, 3.0, 2.0
    velocity, spin = np.array([1.0, 0.5, -0.5]), np.array([0.6, -0.8, 1.0])
    body = {
        "mass": mass,
        "inertia": [inertia] * 3,
        "added_mass": [mass] * 3 + [0.0] * 3,
        "damping": {"linear": [decay * 2.0 * mass] * 3 + [decay * inertia] * 3},
    }

    def observe(s: Simulator) -> Quantities:
        left = np.exp(-decay * s.time[0])
        velocity, rate = s.rotation[0] @ s.twist[0, :3] / left, s.twist[0, 3:] / left
        return {"velocity": velocity, "rate": rate, "position": s.position[0], "attitude": s.rotation[0]}

    def reference(times: Floats) -> Quantities:
        gone = (1.0 - np.exp(-decay * times)) / decay
        rate = float(np.linalg.norm(spin))
        constant = {name: np.tile(value, (len(times), 1)) for name, value in (("velocity", velocity), ("rate", spin))}
        return constant | {"position": gone[:, None] * velocity, "attitude": about(spin / rate, rate * gone)}

    return motion_case(
        "damping over six decades",
        "14 s of decay by linear damping, to 1e-6: relative error of velocity and rate, position and attitude",
        single_body("decay", body, DENSITY),
        instants(1.0, 14),
        reference,
        {4: 0.04, 3: 0.02, 2: 0.01, 1: 0.002},
        {"twist": [*velocity, *spin]},
        observe,
    )


def _pendulum() -> Case:
    """Restoring pendulum at small angles: omega^2 = m g d / (I_o + I_A - (m d)^2 / (m + m_A)); free, not pinned."""
    m, d, inertia, added, added_inertia, start = 10.0, 0.05, 0.3, 8.0, 0.2, 1e-3
    # Ten periods, sampled often enough to follow the phase.
    times = instants(0.5, 40)
    rate = math.sqrt(m * GRAVITY * d / (inertia + m * d * d + added_inertia - (m * d) ** 2 / (m + added)))
    body = {
        "mass": m,
        "inertia": [inertia] * 3,
        "center_of_mass": [0.0, 0.0, -d],
        "volume": m / DENSITY,
        "added_mass": [4.0, added, added, *[added_inertia] * 3],
    }

    def run(runner: CaseRunner) -> Quantities:
        s = runner.simulator(single_body("pendulum", body, DENSITY, GRAVITY))
        s.set_state(rotation=about(np.eye(3)[0], start))
        phase, sizes = 0.0, []
        for _ in times:
            runner.advance(s, times[0])
            angle, speed = math.atan2(s.rotation[0, 2, 1], s.rotation[0, 2, 2]), float(s.twist[0, 3]) / rate
            phase += (math.atan2(-speed, angle) - phase + math.pi) % (2.0 * math.pi) - math.pi
            sizes.append(math.hypot(angle, speed))
        return {"time per rad": np.array([[times[-1] / phase]]), "amplitude": np.array(sizes)[:, None]}

    values = {"time per rad": np.array([[1.0 / rate]]), "amplitude": np.full((len(times), 1), start)}
    return Case(
        "restoring pendulum",
        "period and amplitude of roll over 20 s, about ten periods; neutral, centre of mass below buoyancy",
        run,
        lambda: Reference(values, "closed form for small angles: 6e-8 from the angle of 1e-3 rad"),
        {4: 0.01, 3: 0.005, 2: 0.01, 1: 0.0002},
        0.5,
    )


def _drift(name: str, description: str, acceleration: Floats) -> Case:
    """Make the case of a spinning ball in a current.

    Its velocity relative to the water decays exponentially in world axes, whatever its rotation. Buoyancy and added
    mass follow accelerating water: a body lighter than the displaced water moves ahead of it,
    (m + m_A) w' = -d w + (rho vol - m) (a_c - g).
    """
    m, added, drag, displaced = 10.0, 5.0, 3.0, 10.5
    spin, current = np.array([0.6, -0.8, 1.0]), np.array([0.5, -0.3, 0.2])
    body = {
        "mass": m,
        "inertia": [1.0] * 3,
        "volume": displaced / DENSITY,
        "added_mass": [added] * 3 + [0.0] * 3,
        "damping": {"linear": [drag] * 3 + [0.0] * 3},
    }
    scene = single_body("ball in a current", body, DENSITY, GRAVITY)
    start = {"twist": [0.0, 0.0, 0.0, *spin], "current": current, "current_acceleration": acceleration}

    def reference(times: Floats) -> Quantities:
        rate, t = drag / (m + added), times[:, None]
        slip = (displaced - m) / drag * (acceleration + np.array([0.0, 0.0, GRAVITY]))
        gone = (1.0 - np.exp(-rate * t)) / rate
        position = current * t + 0.5 * acceleration * t * t + slip * t - (current + slip) * gone
        velocity = current + acceleration * t + slip - (current + slip) * np.exp(-rate * t)
        size = float(np.linalg.norm(spin))
        return {"position": position, "velocity": velocity, "attitude": about(spin / size, size * times)}

    return motion_case(name, description, scene, instants(1.0, 20), reference, {4: 0.04, 2: 0.02, 1: 0.005}, start)


DRIFT = _drift(
    "drift with a current",
    "a spinning ball in a steady current, 20 s: position, velocity and attitude every 1 s",
    np.zeros(3),
)
DRIFT_ACCELERATING = _drift(
    "drift, water accelerating",
    "the same in accelerating water, buoyant: position, velocity and attitude every 1 s",
    np.array([0.02, 0.05, -0.03]),
)

CASES = (_mass_ratio(), OFF_DIAGONAL, _munk(), FAST_DAMPING, _decay(), _pendulum(), DRIFT, DRIFT_ACCELERATING)
