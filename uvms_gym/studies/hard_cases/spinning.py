"""Cases of attitude: spins, flips and tumbles of a free body."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from uvms_gym import Simulator
from uvms_gym._rotations import about
from uvms_gym.studies.hard_cases.case import Case, CaseRunner, Quantities, Reference, instants, motion, motion_case
from uvms_gym.studies.hard_cases.reference_solutions import Top
from uvms_gym.studies.hard_cases.scenes import Scene, single_body
from uvms_gym.studies.numerics import Floats

OBLIQUE = np.array([0.36, 0.48, 0.8])
STRAIGHT = np.array([0.4, -0.3, 0.2])


def _free(name: str, inertia: Sequence[float] = (1.0, 1.0, 1.0)) -> Scene:
    return single_body(name, {"mass": 1.0, "inertia": list(inertia)})


# Free spin as in Table 1 of the paper, about an oblique axis. The twist is constant: Munthe-Kaas methods are exact.
FREE_SPIN = motion_case(
    "free spin",
    "500 s at 1 rad/s about an oblique axis: attitude every 50 s",
    _free("free spin"),
    instants(50.0, 10),
    lambda times: {"attitude": about(OBLIQUE, times)},
    {1: 0.1},
    {"twist": [0.0, 0.0, 0.0, *OBLIQUE]},
)


def top_case(
    name: str,
    description: str,
    inertia: Sequence[float],
    spin: Sequence[float] | Floats,
    times: Floats,
    steps: Mapping[int, float],
    **options: Any,
) -> Case:
    """Make the case of a free body with a closed form of its attitude; `options` are fields of `Case`."""
    top = Top(np.array(inertia), np.array(spin))

    def reference(times: Floats) -> Reference:
        values = {"attitude": top.attitudes(times), "rate": top.rates(times)}
        return Reference(values, "Jacobi elliptic functions, and quadrature of the precession")

    start = {"twist": [0.0, 0.0, 0.0, *spin]}
    return motion_case(name, description, _free(name, inertia), times, reference, steps, start, **options)


DZHANIBEKOV = top_case(
    "Dzhanibekov flip",
    "15 s about the middle axis at 2 rad/s, disturbed: several flips, attitude and rate every 0.5 s",
    (1.0, 2.0, 3.0),
    (0.3, 2.0, 0.2),
    instants(0.5, 30),
    {4: 0.025, 3: 0.0125, 2: 0.01, 1: 0.0002},
    reason="errors grow about a hundredfold near the separatrix, so low orders need small steps",
)

TUMBLE_INERTIA = (1.0, 2.0, 2.6)


def tumble_spin(rate: float) -> Floats:
    """Angular velocity (3,) of a rotation about all three axes, rad/s."""
    return rate * np.array([0.7, 0.5, -0.6]) / math.sqrt(1.1)


FAST_TUMBLE = top_case(
    "tumble at 20 rad/s",
    "5 s of tumbling about all three axes, 100 rad: attitude and rate every 0.5 s",
    TUMBLE_INERTIA,
    tumble_spin(20.0),
    instants(0.5, 10),
    {4: 0.002, 3: 0.0005, 2: 0.001, 1: 5e-6},
    implicit_steps={2: 0.001},
    reason="the phase error h^p rate^(p+1) time needs small steps of low orders",
)


# Nearly one revolution, and more, within one step, as a screw motion, whose position has a closed form too.
TURN_TIMES = instants(0.1, 10)
TURNS = np.array([0.5, 0.9, 0.999, 1.0 - 1e-9, 1.001, 1.5, 3.999])
#: Angular velocity of one revolution in a step, rad/s.
TURN_RATE = 2.0 * math.pi / 0.1
SCREW = 1.5


def _turns(attitudes: Any, position: Floats) -> Quantities:
    named = {f"attitude at {turns:.4g} turns": rotation for turns, rotation in zip(TURNS, attitudes, strict=True)}
    return named | {"position": position}


def _screw(times: Floats) -> Quantities:
    position = np.tile((SCREW * times[:, None] * OBLIQUE)[:, None], (1, len(TURNS), 1))
    return _turns([about(OBLIQUE, TURN_RATE * turns * times) for turns in TURNS], position)


LARGE_TURN = motion_case(
    "turn near 2 pi in a step",
    "0.5 to 4 revolutions within each of ten steps, with a screw motion: attitude and position after each",
    _free("turn"),
    TURN_TIMES,
    _screw,
    {3: 0.1, 2: 0.001, 1: 0.0001},
    {"twist": np.hstack([np.tile(SCREW * OBLIQUE, (len(TURNS), 1)), np.outer(TURN_RATE * TURNS, OBLIQUE)])},
    lambda s: _turns(s.rotation, s.position),
    len(TURNS),
    reason="orders 1 and 2 amplify any oscillation, so rounding errors across the axis grow at this rate",
)


# The same spin, nearly one revolution in 0.1 s, of a body in straight flight: in body axes its velocity rotates as
# fast. With substeps the attitude is accurate, and orders 3 and above are stable, but not this velocity.
WHIRL_RATE = TURN_RATE * 0.999

WHIRL = motion_case(
    "straight flight at 63 rad/s",
    "a body in straight flight that spins by 2 pi in 0.1 s, 1 s: position, velocity and attitude",
    _free("whirl"),
    TURN_TIMES,
    lambda times: {
        "position": times[:, None] * STRAIGHT,
        "velocity": np.tile(STRAIGHT, (len(times), 1)),
        "attitude": about(OBLIQUE, WHIRL_RATE * times),
    },
    {4: 0.0005, 3: 0.00025, 2: 0.0001, 1: 1e-5},
    {"twist": np.concatenate([STRAIGHT, WHIRL_RATE * OBLIQUE])},
    reason="the phase error h^p rate^(p+1) time needs small steps of low orders",
)


def _pitch() -> Case:
    """Pitch through 90 degrees, the singularity of Euler angles: a torque against damping turns a drifting ball."""
    damping, rate = 0.5, 1.0
    scene = _free("pitch")
    scene["vehicle"]["body"]["damping"] = {"linear": [0.0, 0.0, 0.0] + [damping] * 3}
    # Level, rotating about y through 90 degrees; and at 90 degrees, rotating about z.
    starts = about(np.eye(3)[2], 0.7) @ np.stack([np.eye(3), about(np.eye(3)[1], math.pi / 2)])
    axes, zeros = np.eye(3)[[1, 2]], np.zeros((2, 3))

    def named(attitudes: Any, position: Floats) -> Quantities:
        return {"through 90 degrees": attitudes[0], "from 90 degrees": attitudes[1], "position": position}

    def reference(times: Floats) -> Quantities:
        angle = rate * (times - (1.0 - np.exp(-damping * times)) / damping)
        position = np.tile((times[:, None] * STRAIGHT)[:, None], (1, 2, 1))
        return named([start @ about(axis, angle) for start, axis in zip(starts, axes, strict=True)], position)

    return motion_case(
        "pitch at 90 degrees",
        "a drifting ball rotated through, and from, a pitch of 90 degrees, 20 s: attitudes, position every 1 s",
        scene,
        instants(1.0, 20),
        reference,
        {4: 0.04, 3: 0.02, 2: 0.01, 1: 0.004},
        {"rotation": starts, "twist": np.concatenate([STRAIGHT @ starts, zeros], axis=1)},
        lambda s: named(s.rotation, s.position),
        2,
        {"wrench": np.concatenate([zeros, damping * rate * axes], axis=1)},
    )


# Rounding of a million products of rotations. This law relies on the kernel's Newton iteration R (3 I - R^T R) / 2
# towards the nearest rotation after each step.
DRIFT_STEPS, DRIFT_SAMPLES = 1_000_000, 10


def _run_orthonormal(runner: CaseRunner) -> Quantities:
    def observe(s: Simulator) -> Quantities:
        return {"R'R": np.array([1.0 + np.abs(s.rotation[0].T @ s.rotation[0] - np.eye(3)).max()])}

    times = instants(runner.step * DRIFT_STEPS / DRIFT_SAMPLES, DRIFT_SAMPLES)
    start = {"twist": [0.0, 0.0, 0.0, *(0.1 * tumble_spin(20.0))]}
    return motion(_free("orthonormal", TUMBLE_INERTIA), times, observe, start)(runner)


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

CASES = (FREE_SPIN, DZHANIBEKOV, FAST_TUMBLE, LARGE_TURN, WHIRL, _pitch(), ORTHONORMAL)
