"""Cases of added mass, damping, restoring and current: one body in water."""

import math
from functools import cache
from typing import Any

import numpy as np

from uvms_gym import Simulator, load_scene
from uvms_gym._rotations import about
from uvms_gym.studies.hard_cases.case import (
    Case,
    CaseRunner,
    Quantities,
    Reference,
    Scene,
    instants,
    motion,
    single_body,
)
from uvms_gym.studies.hard_cases.reference_solutions import force_free_reference
from uvms_gym.studies.numerics import Floats

# Added mass far below and far above the mass: a body pushed against quadratic damping, v = v_t tanh(t/T),
# x = v_t T ln cosh(t/T), T = (m + m_A) / (k v_t). Added mass as a lagged force is unstable here above m_A = m.
RATIOS = np.array([0.01, 0.1, 1.0, 10.0, 100.0, 1000.0])
PUSH = {"mass": 10.0, "drag": 20.0, "force": 20.0}
PUSH_TIMES = instants(1.0, 10)
# The same body without forces, rotating about all axes: impulse and energy are conserved.
ADDED = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
FREE_TWIST = np.array([0.5, -0.2, 0.1, 0.3, 0.5, -0.4])


def _ratio_scene(drag: float) -> Scene:
    damping = {"quadratic": [drag, 0.0, 0.0, 0.0, 0.0, 0.0]}
    mass = PUSH["mass"]
    body = {"mass": mass, "inertia": [1.0] * 3, "added_mass": list(mass * ADDED), "damping": damping}
    return single_body("mass ratio", body, 1000.0)


def _by_ratio(name: str, rows: Floats) -> Quantities:
    return {f"{name} at {ratio:g}": row for ratio, row in zip(RATIOS, rows, strict=True)}


def _run_ratio(runner: CaseRunner) -> Quantities:
    pushed, loose = (runner.simulator(_ratio_scene(drag), len(RATIOS)) for drag in (PUSH["drag"], 0.0))
    for s in (pushed, loose):
        s.scale_parameters(added_mass=RATIOS)
    loose.set_state(twist=FREE_TWIST)

    def observe_pushed(s: Simulator) -> Quantities:
        return _by_ratio("speed", s.twist[:, :1]) | _by_ratio("distance", s.position[:, :1])

    def observe_loose(s: Simulator) -> Quantities:
        return _by_ratio("energy", s.energy()["total"][:, None]) | _by_ratio("impulse", s.momentum())

    wrench = [PUSH["force"], 0.0, 0.0, 0.0, 0.0, 0.0]
    values = runner.sampled(pushed, PUSH_TIMES, observe_pushed, wrench=wrench)
    return values | runner.sampled(loose, PUSH_TIMES, observe_loose)


def _ratio_reference() -> Reference:
    mass, drag, force = PUSH.values()
    terminal, values, count = math.sqrt(force / drag), {}, len(PUSH_TIMES)
    for ratio in RATIOS:
        scale = mass * (1.0 + ratio) / (drag * terminal)
        values[f"speed at {ratio:g}"] = terminal * np.tanh(PUSH_TIMES / scale)[:, None]
        values[f"distance at {ratio:g}"] = terminal * scale * np.log(np.cosh(PUSH_TIMES / scale))[:, None]
        inertia = np.diag(np.array([mass] * 3 + [1.0] * 3) + ratio * mass * ADDED)
        values[f"energy at {ratio:g}"] = np.full((count, 1), 0.5 * FREE_TWIST @ inertia @ FREE_TWIST)
        values[f"impulse at {ratio:g}"] = np.tile(inertia @ FREE_TWIST, (count, 1))
    return Reference(values, "closed form; conservation laws")


MASS_RATIO = Case(
    name="added mass 0.01 to 1000 m",
    description="six ratios, 10 s: speed and distance of a body pushed against quadratic damping; impulse and energy "
    "of a free one",
    run=_run_ratio,
    reference=_ratio_reference,
    steps={4: 0.02, 3: 0.01, 2: 0.01, 1: 0.002},
    interval=1.0,
)


# Off-diagonal added mass: RexROV's published matrix, without damping and gravity: Kirchhoff's equations.
REXROV_TWIST = np.array([1.0, 0.3, -0.2, 0.1, 0.25, -0.3])
REXROV_TIMES = instants(1.0, 10)


def _rexrov() -> Scene:
    scene = load_scene("rexrov")
    body = scene["vehicle"]["body"]
    body["damping"] = {"linear": [0.0] * 6, "quadratic": [0.0] * 6}
    scene["water"]["gravity"] = [0.0] * 3
    return scene | {"provenance": {}, "name": "hard case off-diagonal"}


@cache
def _rexrov_reference() -> Reference:
    body = _rexrov()["vehicle"]["body"]
    rigid = np.diag([body["mass"]] * 3 + [0.0] * 3)
    rigid[3:, 3:] = body["inertia"]
    inertia, count = rigid + np.array(body["added_mass"]), len(REXROV_TIMES)
    found = force_free_reference(inertia, REXROV_TWIST, REXROV_TIMES)
    found.values["impulse"] = np.tile(inertia @ REXROV_TWIST, (count, 1))
    found.values["energy"] = np.full((count, 1), 0.5 * REXROV_TWIST @ inertia @ REXROV_TWIST)
    return found


OFF_DIAGONAL = Case(
    name="off-diagonal added mass",
    description="RexROV without damping, 10 s: pose and twist, impulse and energy every 1 s",
    run=motion(_rexrov, REXROV_TIMES, ["position", "attitude", "twist", "impulse", "energy"], twist=REXROV_TWIST),
    reference=_rexrov_reference,
    steps={4: 0.02, 3: 0.02, 2: 0.01, 1: 0.002},
    interval=1.0,
)


# Munk instability: a body in motion along its slender axis turns broadside, at a rate known from linearisation.
MUNK = {"mass": 10.0, "added_x": 1.0, "added_y": 9.0, "inertia": 1.5}
MUNK_TIME, MUNK_START = 4.0, 1e-7


def _munk_rate() -> float:
    m, ax, ay, inertia = MUNK.values()
    return math.sqrt((ay - ax) * (m + ax) / ((m + ay) * inertia))


def _run_munk(runner: CaseRunner) -> Quantities:
    m, ax, ay, inertia = MUNK.values()
    added = [ax, ay, ay, 0.5, 0.5, 0.5]
    s = runner.simulator(single_body("munk", {"mass": m, "inertia": [inertia - 0.5] * 3, "added_mass": added}, 1000.0))
    # The growing mode: sway v and yaw rate r with (m + ay) v' = -(m + ax) r.
    yaw_rate = -_munk_rate() * (m + ay) / (m + ax) * MUNK_START
    s.set_state(twist=[1.0, MUNK_START, 0.0, 0.0, 0.0, yaw_rate])
    runner.advance(s, MUNK_TIME)
    grown = s.twist[0, [1, 5]] / np.array([MUNK_START, yaw_rate])
    return {"rate": np.log(np.where(grown > 0.0, grown, np.nan))[None] / MUNK_TIME}


MUNK_CASE = Case(
    name="Munk instability",
    description="growth rate of sway and of yaw over 4 s from 1e-7 of the speed",
    run=_run_munk,
    reference=lambda: Reference(
        {"rate": np.full((1, 2), _munk_rate())}, "closed form, linearised: 1e-8 from nonlinear terms"
    ),
    steps={2: 0.04, 1: 0.02},
    implicit_steps={2: 0.02},
    interval=MUNK_TIME,
)


# Quadratic damping at 50 m/s: deceleration; and against a force, through zero and up to terminal speed.
FAST = {"mass": 19.0, "drag": 18.18, "force": 20.0}
FAST_TIMES = instants(0.1, 50)


def fast_case(name: str, description: str, speed: float, **options: Any) -> Case:
    """Make the case of quadratic damping that brakes from a speed, and of a force that reverses the same speed."""
    m, k, force = FAST.values()

    def run(runner: CaseRunner) -> Quantities:
        body = {"mass": m - 5.5, "inertia": [0.3] * 3, "added_mass": [5.5, 0.0, 0.0, 0.0, 0.0, 0.0]}
        s = runner.simulator(single_body("fast damping", body | {"damping": {"quadratic": [k] + [0.0] * 5}}, 1000.0), 2)
        s.set_state(twist=np.outer([speed, -speed], np.eye(6)[0]))

        def observe(s: Simulator) -> Quantities:
            speeds, distances = s.twist[:, :1], s.position[:, :1]
            braked = {"speed, braked": speeds[0], "distance, braked": distances[0]}
            return braked | {"speed, through zero": speeds[1], "distance, through zero": distances[1]}

        return runner.sampled(s, FAST_TIMES, observe, wrench=np.outer([0.0, force], np.eye(6)[0]))

    def reference() -> Reference:
        t, terminal = FAST_TIMES, math.sqrt(force / k)
        rate = k * terminal / m
        stop = math.atan(speed / terminal) / rate
        before, after = np.minimum(t, stop), np.maximum(t - stop, 0.0)
        # tan and ln cos while the speed is negative, tanh and ln cosh after.
        angle = rate * (before - stop)
        through = np.where(t < stop, np.tan(angle), np.tanh(rate * after)) * terminal
        turning = -np.log(np.cos(angle) / math.cos(rate * stop)) + np.log(np.cosh(rate * after))
        values = {
            "speed, braked": speed / (1.0 + k * speed * t / m),
            "distance, braked": m / k * np.log1p(k * speed * t / m),
            "speed, through zero": through,
            "distance, through zero": m / k * turning,
        }
        return Reference({name: value[:, None] for name, value in values.items()}, "closed form")

    return Case(name, description, run, reference, interval=0.1, **options)


FAST_DAMPING = fast_case(
    "quadratic damping at 50 m/s",
    "5 s of deceleration from 50 m/s, and of reversal by a force: speed and distance every 0.1 s",
    50.0,
    steps={4: 0.002, 2: 0.001, 1: 0.0005},
    reason="the speed halves within 0.02 s at first",
)


# Linear damping over six decades: errors relative to the decayed quantity. The body is isotropic: its velocity in
# world axes and its angular velocity decay exponentially, while rotation couples them in body axes.
DECAY, DECAY_SPIN = 1.0, np.array([0.6, -0.8, 1.0])
DECAY_VELOCITY = np.array([1.0, 0.5, -0.5])
DECAY_TIMES = instants(1.0, 14)


DECAY_MASS, DECAY_INERTIA = 3.0, 2.0
DECAY_BODY = {
    "mass": DECAY_MASS,
    "inertia": [DECAY_INERTIA] * 3,
    "added_mass": [DECAY_MASS] * 3 + [0.0] * 3,
    "damping": {"linear": [DECAY * 2.0 * DECAY_MASS] * 3 + [DECAY * DECAY_INERTIA] * 3},
}


def _observe_decay(s: Simulator) -> Quantities:
    left = np.exp(-DECAY * s.time[0])
    velocity, rate = s.rotation[0] @ s.twist[0, :3] / left, s.twist[0, 3:] / left
    return {"velocity": velocity, "rate": rate, "position": s.position[0], "attitude": s.rotation[0]}


def _decay_reference() -> Reference:
    gone = (1.0 - np.exp(-DECAY * DECAY_TIMES)) / DECAY
    rate = float(np.linalg.norm(DECAY_SPIN))
    count = len(DECAY_TIMES)
    values = {
        "velocity": np.tile(DECAY_VELOCITY, (count, 1)),
        "rate": np.tile(DECAY_SPIN, (count, 1)),
        "position": gone[:, None] * DECAY_VELOCITY,
        "attitude": about(DECAY_SPIN / rate, rate * gone),
    }
    return Reference(values, "closed form")


DAMPED_DECAY = Case(
    name="damping over six decades",
    description="14 s of decay by linear damping, to 1e-6: relative error of velocity and rate, position and attitude",
    run=motion(
        single_body("decay", DECAY_BODY, 1000.0),
        DECAY_TIMES,
        _observe_decay,
        twist=[*DECAY_VELOCITY, *DECAY_SPIN],
    ),
    reference=_decay_reference,
    steps={4: 0.04, 3: 0.02, 2: 0.01, 1: 0.002},
    interval=1.0,
)


# Restoring pendulum at small angles: omega^2 = m g d / (I_o + I_A - (m d)^2 / (m + m_A)); free, not pinned.
PENDULUM = {"mass": 10.0, "depth": 0.05, "inertia": 0.3, "added": 8.0, "added_inertia": 0.2}
PENDULUM_START, GRAVITY = 1e-3, 9.81
# Ten periods, sampled often enough to follow the phase.
PENDULUM_TIMES = instants(0.5, 40)


def _pendulum_rate() -> float:
    m, d, inertia, added, added_inertia = PENDULUM.values()
    return math.sqrt(m * GRAVITY * d / (inertia + m * d * d + added_inertia - (m * d) ** 2 / (m + added)))


def _run_pendulum(runner: CaseRunner) -> Quantities:
    m, d, inertia, added, added_inertia = PENDULUM.values()
    body = {
        "mass": m,
        "inertia": [inertia] * 3,
        "center_of_mass": [0.0, 0.0, -d],
        "volume": m / 1000.0,
        "added_mass": [4.0, added, added, *[added_inertia] * 3],
    }
    s = runner.simulator(single_body("pendulum", body, 1000.0, gravity=[0.0, 0.0, -GRAVITY]))
    s.set_state(rotation=about(np.eye(3)[0], PENDULUM_START))
    rate, phase, sizes = _pendulum_rate(), 0.0, []
    for _ in PENDULUM_TIMES:
        runner.advance(s, PENDULUM_TIMES[0])
        angle, speed = math.atan2(s.rotation[0, 2, 1], s.rotation[0, 2, 2]), float(s.twist[0, 3]) / rate
        phase += (math.atan2(-speed, angle) - phase + math.pi) % (2.0 * math.pi) - math.pi
        sizes.append(math.hypot(angle, speed))
    return {"time per rad": np.array([[PENDULUM_TIMES[-1] / phase]]), "amplitude": np.array(sizes)[:, None]}


def _pendulum_reference() -> Reference:
    rate = _pendulum_rate()
    values = {"time per rad": np.array([[1.0 / rate]]), "amplitude": np.full((len(PENDULUM_TIMES), 1), PENDULUM_START)}
    return Reference(values, "closed form for small angles: 6e-8 from the angle of 1e-3 rad")


PENDULUM_CASE = Case(
    name="restoring pendulum",
    description="period and amplitude of roll over 20 s, about ten periods; neutral, centre of mass below buoyancy",
    run=_run_pendulum,
    reference=_pendulum_reference,
    steps={4: 0.01, 3: 0.005, 2: 0.01, 1: 0.0002},
    interval=0.5,
)


# A spinning ball in a current: its velocity relative to the water decays exponentially in world axes, whatever its
# rotation. Buoyancy and added mass follow accelerating water: a body lighter than the displaced water moves ahead of
# it, (m + m_A) w' = -d w + (rho vol - m) (a_c - g).
BALL = {"mass": 10.0, "added": 5.0, "drag": 3.0, "displaced": 10.5}
BALL_SPIN = np.array([0.6, -0.8, 1.0])
CURRENT = np.array([0.5, -0.3, 0.2])
BALL_TIMES = instants(1.0, 20)


def _drift(name: str, description: str, acceleration: Floats) -> Case:
    m, added, drag, displaced = BALL.values()
    body = {
        "mass": m,
        "inertia": [1.0] * 3,
        "volume": displaced / 1000.0,
        "added_mass": [added] * 3 + [0.0] * 3,
        "damping": {"linear": [drag] * 3 + [0.0] * 3},
    }
    scene = single_body("ball in a current", body, 1000.0, gravity=[0.0, 0.0, -GRAVITY])
    state: dict[str, Any] = {
        "twist": [0.0, 0.0, 0.0, *BALL_SPIN],
        "current": CURRENT,
        "current_acceleration": acceleration,
    }

    def reference() -> Reference:
        rate, t = drag / (m + added), BALL_TIMES[:, None]
        slip = (displaced - m) / drag * (acceleration + np.array([0.0, 0.0, GRAVITY]))
        gone = (1.0 - np.exp(-rate * t)) / rate
        position = CURRENT * t + 0.5 * acceleration * t * t + slip * t - (CURRENT + slip) * gone
        velocity = CURRENT + acceleration * t + slip - (CURRENT + slip) * np.exp(-rate * t)
        size = float(np.linalg.norm(BALL_SPIN))
        attitude = about(BALL_SPIN / size, size * BALL_TIMES)
        return Reference({"position": position, "velocity": velocity, "attitude": attitude}, "closed form")

    run = motion(scene, BALL_TIMES, ["position", "velocity", "attitude"], **state)
    return Case(name, description, run, reference, {4: 0.04, 2: 0.02, 1: 0.005}, 1.0)


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

CASES = (MASS_RATIO, OFF_DIAGONAL, MUNK_CASE, FAST_DAMPING, DAMPED_DECAY, PENDULUM_CASE, DRIFT, DRIFT_ACCELERATING)
