"""Cases of attitude: spins, flips and tumbles of a free body."""

import math
from functools import cache
from typing import Any

import numpy as np

from uvms_gym import Simulator
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
from uvms_gym.studies.hard_cases.reference_solutions import Top
from uvms_gym.studies.numerics import Floats

OBLIQUE = np.array([0.36, 0.48, 0.8])
STRAIGHT = np.array([0.4, -0.3, 0.2])


def _free(name: str, inertia: Floats) -> Scene:
    return single_body(name, {"mass": 1.0, "inertia": [float(x) for x in inertia]})


# Free spin as in Table 1 of the paper, about an oblique axis. The twist is constant: Munthe-Kaas methods are exact.
SPIN_TIMES = instants(50.0, 10)

FREE_SPIN = Case(
    name="free spin",
    description="500 s at 1 rad/s about an oblique axis: attitude every 50 s",
    run=motion(_free("free spin", np.ones(3)), SPIN_TIMES, ["attitude"], twist=[0.0, 0.0, 0.0, *OBLIQUE]),
    reference=lambda: Reference({"attitude": about(OBLIQUE, SPIN_TIMES)}, "closed form"),
    steps={1: 0.1},
    interval=50.0,
)


# Rotation about all three axes. The attitude of a free top has a closed form: see `reference_solutions.Top`.
TUMBLE = Top(np.array([1.0, 2.0, 2.6]), 20.0 * np.array([0.7, 0.5, -0.6]) / math.sqrt(1.1))


def top_case(name: str, description: str, scene: str, top: Top, times: Floats, **options: Any) -> Case:
    """Make the case of a free body; `options` are fields of `Case`."""
    run = motion(_free(scene, top.inertia), times, ["attitude", "rate"], twist=[0.0, 0.0, 0.0, *top.spin])

    @cache
    def reference() -> Reference:
        values = {"attitude": top.attitudes(times), "rate": top.rates(times)}
        return Reference(values, "Jacobi elliptic functions, and quadrature of the precession")

    return Case(name, description, run, reference, **options)


DZHANIBEKOV = top_case(
    "Dzhanibekov flip",
    "15 s about the middle axis at 2 rad/s, disturbed: several flips, attitude and rate every 0.5 s",
    "flip",
    Top(np.array([1.0, 2.0, 3.0]), np.array([0.3, 2.0, 0.2])),
    instants(0.5, 30),
    steps={4: 0.025, 3: 0.0125, 2: 0.01, 1: 0.0002},
    interval=0.5,
    reason="errors grow about a hundredfold near the separatrix, so low orders need small steps",
)

FAST_TUMBLE = top_case(
    "tumble at 20 rad/s",
    "5 s of tumbling about all three axes, 100 rad: attitude and rate every 0.5 s",
    "tumble",
    TUMBLE,
    instants(0.5, 10),
    steps={4: 0.002, 3: 0.0005, 2: 0.001, 1: 5e-6},
    implicit_steps={2: 0.001},
    interval=0.5,
    reason="the phase error h^p rate^(p+1) time needs small steps of low orders",
)


# Nearly one revolution, and more, within one step, as a screw motion, whose position has a closed form too.
TURN_STEP = 0.1
TURN_TIMES = instants(TURN_STEP, 10)
TURNS = np.array([0.5, 0.9, 0.999, 1.0 - 1e-9, 1.001, 1.5, 3.999])
SCREW = 1.5
TURN_TWISTS = np.hstack(
    [np.tile(SCREW * OBLIQUE, (len(TURNS), 1)), np.outer(2.0 * math.pi / TURN_STEP * TURNS, OBLIQUE)]
)


def _observe_turns(s: Simulator) -> Quantities:
    return {f"attitude at {turns:.4g} turns": r for turns, r in zip(TURNS, s.rotation)} | {"position": s.position}


def _screw_reference() -> Reference:
    attitudes = {
        f"attitude at {turns:.4g} turns": about(OBLIQUE, 2.0 * math.pi / TURN_STEP * turns * TURN_TIMES)
        for turns in TURNS
    }
    position = np.tile((SCREW * TURN_TIMES[:, None] * OBLIQUE)[:, None], (1, len(TURNS), 1))
    return Reference(attitudes | {"position": position}, "closed form")


LARGE_TURN = Case(
    name="turn near 2 pi in a step",
    description="0.5 to 4 revolutions within each of ten steps, with a screw motion: attitude and position after each",
    run=motion(_free("turn", np.ones(3)), TURN_TIMES, _observe_turns, len(TURNS), twist=TURN_TWISTS),
    reference=_screw_reference,
    steps={3: TURN_STEP, 2: 0.001, 1: 0.0001},
    interval=TURN_STEP,
    reason="orders 1 and 2 amplify any oscillation, so rounding errors across the axis grow at this rate",
)


# The same spin, nearly one revolution in 0.1 s, of a body in straight flight: in body axes its velocity rotates as
# fast. With substeps the attitude is accurate, and orders 3 and above are stable, but not this velocity.
WHIRL_RATE = 2.0 * math.pi / TURN_STEP * 0.999


def _whirl_reference() -> Reference:
    values = {
        "position": TURN_TIMES[:, None] * STRAIGHT,
        "velocity": np.tile(STRAIGHT, (len(TURN_TIMES), 1)),
        "attitude": about(OBLIQUE, WHIRL_RATE * TURN_TIMES),
    }
    return Reference(values, "closed form")


WHIRL = Case(
    name="straight flight at 63 rad/s",
    description="a body in straight flight that spins by 2 pi in 0.1 s, 1 s: position, velocity and attitude",
    run=motion(
        _free("whirl", np.ones(3)),
        TURN_TIMES,
        ["position", "velocity", "attitude"],
        twist=np.concatenate([STRAIGHT, WHIRL_RATE * OBLIQUE]),
    ),
    reference=_whirl_reference,
    steps={4: 0.0005, 3: 0.00025, 2: 0.0001, 1: 1e-5},
    interval=TURN_STEP,
    reason="the phase error h^p rate^(p+1) time needs small steps of low orders",
)


# Pitch through 90 degrees, the singularity of Euler angles: a torque against linear damping turns a drifting ball.
PITCH_DRAG, PITCH_RATE = 0.5, 1.0
PITCH_TIMES = instants(1.0, 20)
# Level, rotating about y through 90 degrees; and at 90 degrees, rotating about z.
PITCH_STARTS = about(np.eye(3)[2], 0.7) @ np.stack([np.eye(3), about(np.eye(3)[1], math.pi / 2)])
PITCH_AXES = np.eye(3)[[1, 2]]


def _run_pitch(runner: CaseRunner) -> Quantities:
    scene = _free("pitch", np.ones(3))
    scene["vehicle"]["body"]["damping"] = {"linear": [0.0, 0.0, 0.0] + [PITCH_DRAG] * 3}
    s = runner.simulator(scene, 2)
    drift = np.concatenate([STRAIGHT @ PITCH_STARTS, np.zeros((2, 3))], axis=1)
    s.set_state(rotation=PITCH_STARTS, twist=drift)
    torque = np.concatenate([np.zeros((2, 3)), PITCH_DRAG * PITCH_RATE * PITCH_AXES], axis=1)

    def observe(s: Simulator) -> Quantities:
        return {"through 90 degrees": s.rotation[0], "from 90 degrees": s.rotation[1], "position": s.position}

    return runner.sampled(s, PITCH_TIMES, observe, wrench=torque)


def _pitch_reference() -> Reference:
    angle = PITCH_RATE * (PITCH_TIMES - (1.0 - np.exp(-PITCH_DRAG * PITCH_TIMES)) / PITCH_DRAG)
    through, stand = (start @ about(axis, angle) for start, axis in zip(PITCH_STARTS, PITCH_AXES, strict=True))
    position = np.tile((PITCH_TIMES[:, None] * STRAIGHT)[:, None], (1, 2, 1))
    return Reference({"through 90 degrees": through, "from 90 degrees": stand, "position": position}, "closed form")


PITCH = Case(
    name="pitch at 90 degrees",
    description="a drifting ball rotated through, and from, a pitch of 90 degrees, 20 s: attitudes, position every 1 s",
    run=_run_pitch,
    reference=_pitch_reference,
    steps={4: 0.04, 3: 0.02, 2: 0.01, 1: 0.004},
    interval=1.0,
)


# Rounding of a million products of rotations. This law relies on the kernel's Newton iteration R (3 I - R^T R) / 2
# towards the nearest rotation after each step.
DRIFT_STEPS, DRIFT_SAMPLES = 1_000_000, 10


def _run_orthonormal(runner: CaseRunner) -> Quantities:
    def observe(s: Simulator) -> Quantities:
        return {"R'R": np.array([1.0 + np.abs(s.rotation[0].T @ s.rotation[0] - np.eye(3)).max()])}

    times = instants(runner.step * DRIFT_STEPS / DRIFT_SAMPLES, DRIFT_SAMPLES)
    scene, twist = _free("orthonormal", TUMBLE.inertia), [0.0, 0.0, 0.0, *(0.1 * TUMBLE.spin)]
    return motion(scene, times, observe, twist=twist)(runner)


ORTHONORMAL = Case(
    name="R'R over 1e6 steps",
    description="maximum entry of |R'R - I| over a million steps of tumbling, with the kernel's Newton projection",
    run=_run_orthonormal,
    reference=lambda: Reference({"R'R": np.ones((DRIFT_SAMPLES, 1))}, "definition"),
    steps={2: 0.01, 1: 0.0002},
    interval=0.01,
    bounds={"float64": 1e-12, "float32": 1e-5},
    reason="the bounds are given; order 1 adds energy to a tumble, by a factor e in 1e6 steps of 0.0005 s",
    coarser=False,
    judges_warnings=False,
)

CASES = (FREE_SPIN, DZHANIBEKOV, FAST_TUMBLE, LARGE_TURN, WHIRL, PITCH, ORTHONORMAL)
