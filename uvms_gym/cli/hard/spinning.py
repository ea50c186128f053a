"""Cases of attitude: spins, flips and tumbles of a free body."""

import math
from functools import cache

import numpy as np

from uvms_gym.cli.hard.case import Case, Floats, Lab, Quantities, Scene, Truth, instants, single_body
from uvms_gym.cli.hard.truth import Top, turn

OBLIQUE = np.array([0.36, 0.48, 0.8])
STRAIGHT = np.array([0.4, -0.3, 0.2])


def _free(name: str, inertia: Floats) -> Scene:
    return single_body(name, {"mass": 1.0, "inertia": [float(x) for x in inertia]})


# Free spin: Table 1 of the paper, about an oblique axis. The twist is constant, so every Munthe-Kaas method is exact.
SPIN_TIMES = instants(50.0, 10)


def _run_spin(lab: Lab) -> Quantities:
    s = lab.simulator(_free("free spin", np.ones(3)))
    s.set_state(twist=np.concatenate([np.zeros(3), OBLIQUE]))
    return lab.sampled(s, 50.0, len(SPIN_TIMES), lambda: {"attitude": s.rotation[0]})


FREE_SPIN = Case(
    name="free spin",
    tests="500 s at 1 rad/s about an oblique axis: attitude every 50 s",
    run=_run_spin,
    truth=lambda: Truth({"attitude": turn(OBLIQUE, SPIN_TIMES)}, "closed form"),
    steps={1: 0.1},
    interval=50.0,
)


# Rotation about all three axes. The attitude of a free top has a closed form: see `truth.Top`.
FLIP = Top(np.array([1.0, 2.0, 3.0]), np.array([0.3, 2.0, 0.2]))
FLIP_TIMES = instants(0.5, 30)
TUMBLE = Top(np.array([1.0, 2.0, 2.6]), 20.0 * np.array([0.7, 0.5, -0.6]) / math.sqrt(1.1))
TUMBLE_TIMES = instants(0.5, 10)


def _run_top(lab: Lab, name: str, top: Top, count: int) -> Quantities:
    s = lab.simulator(_free(name, top.inertia))
    s.set_state(twist=np.concatenate([np.zeros(3), top.spin]))
    return lab.sampled(s, 0.5, count, lambda: {"attitude": s.rotation[0], "rate": s.twist[0, 3:]})


@cache
def _top_truth(which: str) -> Truth:
    top, times = (FLIP, FLIP_TIMES) if which == "flip" else (TUMBLE, TUMBLE_TIMES)
    values = {"attitude": top.attitudes(times), "rate": top.rates(times)}
    return Truth(values, "Jacobi elliptic functions, and a quadrature of the precession")


DZHANIBEKOV = Case(
    name="Dzhanibekov flip",
    tests="15 s about the middle axis at 2 rad/s, disturbed: several flips, attitude and rate every 0.5 s",
    run=lambda lab: _run_top(lab, "flip", FLIP, len(FLIP_TIMES)),
    truth=lambda: _top_truth("flip"),
    steps={4: 0.025, 3: 0.0125, 2: 0.01, 1: 0.0002},
    interval=0.5,
    reason="near the separatrix errors grow some hundredfold, so low orders need small steps",
)

FAST_TUMBLE = Case(
    name="tumble at 20 rad/s",
    tests="5 s of tumbling about all three axes, 100 rad: attitude and rate every 0.5 s",
    run=lambda lab: _run_top(lab, "tumble", TUMBLE, len(TUMBLE_TIMES)),
    truth=lambda: _top_truth("tumble"),
    steps={4: 0.002, 3: 0.0005, 2: 0.001, 1: 5e-6},
    interval=0.5,
    reason="the phase error h^p rate^(p+1) time needs small steps of low orders",
)


# Nearly a whole revolution, and more, within one step; a screw, so that the position has a closed form too.
TURN_STEP = 0.1
TURNS = np.array([0.5, 0.9, 0.999, 1.0 - 1e-9, 1.001, 1.5, 3.999])
SCREW = 1.5


def _run_turn(lab: Lab) -> Quantities:
    s = lab.simulator(_free("turn", np.ones(3)), len(TURNS))
    rates = 2.0 * math.pi / TURN_STEP * TURNS
    s.set_state(twist=np.concatenate([np.tile(SCREW * OBLIQUE, (len(TURNS), 1)), rates[:, None] * OBLIQUE], axis=1))

    def look() -> Quantities:
        return {f"attitude at {turns:.4g} turns": r for turns, r in zip(TURNS, s.rotation)} | {"position": s.position}

    return lab.sampled(s, TURN_STEP, 10, look)


def _turn_truth() -> Truth:
    times = instants(TURN_STEP, 10)
    attitudes = {
        f"attitude at {turns:.4g} turns": turn(OBLIQUE, 2.0 * math.pi / TURN_STEP * turns * times) for turns in TURNS
    }
    position = np.tile((SCREW * times[:, None] * OBLIQUE)[:, None], (1, len(TURNS), 1))
    return Truth(attitudes | {"position": position}, "closed form")


LARGE_TURN = Case(
    name="turn near 2 pi in a step",
    tests="0.5 to 4 revolutions within each of ten steps, with a screw motion: attitude and position after each",
    run=_run_turn,
    truth=_turn_truth,
    steps={3: TURN_STEP, 2: 0.001, 1: 0.0001},
    interval=TURN_STEP,
    reason="orders 1 and 2 amplify any oscillation, so that rounding across the axis grows at this rate",
)


# The same nearly whole revolution in a tenth of a second, by a body that flies straight on: in body axes its velocity
# turns as fast. Cutting steps keeps the attitude, and stability of order 3 and above, but not this.
WHIRL_RATE = 2.0 * math.pi / TURN_STEP * 0.999
WHIRL_TIMES = instants(TURN_STEP, 10)


def _run_whirl(lab: Lab) -> Quantities:
    s = lab.simulator(_free("whirl", np.ones(3)))
    s.set_state(twist=np.concatenate([STRAIGHT, WHIRL_RATE * OBLIQUE]))

    def look() -> Quantities:
        velocity = s.rotation[0] @ s.twist[0, :3]
        return {"position": s.position[0], "velocity": velocity, "attitude": s.rotation[0]}

    return lab.sampled(s, TURN_STEP, len(WHIRL_TIMES), look)


def _whirl_truth() -> Truth:
    values = {
        "position": WHIRL_TIMES[:, None] * STRAIGHT,
        "velocity": np.tile(STRAIGHT, (len(WHIRL_TIMES), 1)),
        "attitude": turn(OBLIQUE, WHIRL_RATE * WHIRL_TIMES),
    }
    return Truth(values, "closed form")


WHIRL = Case(
    name="straight flight at 63 rad/s",
    tests="a body that spins at 2 pi in 0.1 s and flies straight on, 1 s: position, velocity and attitude",
    run=_run_whirl,
    truth=_whirl_truth,
    steps={4: 0.0005, 3: 0.00025, 2: 0.0001, 1: 1e-5},
    interval=TURN_STEP,
    reason="the phase error h^p rate^(p+1) time needs small steps of low orders",
)


# Pitch through 90 degrees: a torque against linear drag turns a drifting ball. Where Euler angles are singular.
PITCH_DRAG, PITCH_RATE = 0.5, 1.0
PITCH_TIMES = instants(1.0, 20)
# From level about y, through 90 degrees; and standing at 90 degrees, about z.
PITCH_STARTS = np.concatenate([turn(np.eye(3)[2], 0.7), turn(np.eye(3)[2], 0.7) @ turn(np.eye(3)[1], math.pi / 2)])
PITCH_AXES = np.eye(3)[[1, 2]]


def _run_pitch(lab: Lab) -> Quantities:
    scene = _free("pitch", np.ones(3))
    scene["vehicle"]["body"]["damping"] = {"linear": [0.0, 0.0, 0.0] + [PITCH_DRAG] * 3}
    s = lab.simulator(scene, 2)
    drift = np.concatenate([STRAIGHT @ PITCH_STARTS, np.zeros((2, 3))], axis=1)
    s.set_state(rotation=PITCH_STARTS, twist=drift)
    torque = np.concatenate([np.zeros((2, 3)), PITCH_DRAG * PITCH_RATE * PITCH_AXES], axis=1)

    def look() -> Quantities:
        return {"through 90 degrees": s.rotation[0], "from 90 degrees": s.rotation[1], "position": s.position}

    return lab.sampled(s, 1.0, len(PITCH_TIMES), look, wrench=torque)


def _pitch_truth() -> Truth:
    angle = PITCH_RATE * (PITCH_TIMES - (1.0 - np.exp(-PITCH_DRAG * PITCH_TIMES)) / PITCH_DRAG)
    through, stand = (start @ turn(axis, angle) for start, axis in zip(PITCH_STARTS, PITCH_AXES, strict=True))
    position = np.tile((PITCH_TIMES[:, None] * STRAIGHT)[:, None], (1, 2, 1))
    return Truth({"through 90 degrees": through, "from 90 degrees": stand, "position": position}, "closed form")


PITCH = Case(
    name="pitch at 90 degrees",
    tests="a drifting ball turned through, and from, a pitch of 90 degrees for 20 s: attitudes and position every 1 s",
    run=_run_pitch,
    truth=_pitch_truth,
    steps={4: 0.04, 3: 0.02, 2: 0.01, 1: 0.004},
    interval=1.0,
)


# Rounding of a million products of rotations. After each step the kernel applies one Newton iteration
# R (3 I - R^T R) / 2 towards the nearest rotation, which this law relies on.
DRIFT_STEPS, DRIFT_LOOKS = 1_000_000, 10


def _run_orthonormal(lab: Lab) -> Quantities:
    s = lab.simulator(_free("orthonormal", TUMBLE.inertia))
    s.set_state(twist=np.concatenate([np.zeros(3), 0.1 * TUMBLE.spin]))
    part = lab.step * DRIFT_STEPS / DRIFT_LOOKS
    return lab.sampled(s, part, DRIFT_LOOKS, lambda: {"R'R": _gram(s.rotation[0])})


def _gram(r: Floats) -> Floats:
    return np.array([1.0 + np.abs(r.T @ r - np.eye(3)).max()])


ORTHONORMAL = Case(
    name="R'R over 1e6 steps",
    tests="greatest entry of |R'R - I| over a million steps of tumbling, with the kernel's Newton projection",
    run=_run_orthonormal,
    truth=lambda: Truth({"R'R": np.ones((DRIFT_LOOKS, 1))}, "definition"),
    steps={2: 0.01, 1: 0.0002},
    interval=0.01,
    bars={"float64": 1e-12, "float32": 1e-5},
    reason="the bars are given; order 1 feeds energy to a tumble, by a factor e in 1e6 steps of 0.0005 s",
    coarser=False,
)

CASES = (FREE_SPIN, DZHANIBEKOV, FAST_TUMBLE, LARGE_TURN, WHIRL, PITCH, ORTHONORMAL)
