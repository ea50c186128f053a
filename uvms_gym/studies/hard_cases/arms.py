"""Cases of arms: extreme mass ratios, stiff damping and stiff servos, and time reversal."""

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
    converged,
    instants,
    link,
    motion,
    single_body,
    with_arm,
)
from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.paper.momentum import conservative_scene

# A link of a millionth of the vehicle's mass, on a steadily rotating vehicle: the centrifugal force makes it a
# pendulum, q'' = -mu r l / (I_c + mu l^2) Omega^2 sin q, mu the reduced mass of both. Its effect on the vehicle's
# rotation, mu r l / I = 2e-9, is neglected.
LIGHT = {"mass": 1e-6, "hinge": 0.03, "com": 0.03, "spin": 2.0, "start": 1.0}
LIGHT_TIMES = instants(0.5, 20)


def _light_scene() -> Scene:
    mass, hinge, com, _, start = LIGHT.values()
    across = mass * com * com / 3.0
    body = {"mass": mass, "center_of_mass": [com, 0.0, 0.0], "inertia": [0.01 * across, across, across]}
    vehicle = single_body("light link", {"mass": 1.0, "inertia": [0.4] * 3})
    return with_arm(vehicle, link("link", body, position=(hinge, 0.0, 0.0), home=start))


def _light_reference() -> Reference:
    from scipy.special import ellipj, ellipk

    mass, hinge, com, spin, start = LIGHT.values()
    k = math.sin(0.5 * start)
    reduced = mass / (1.0 + mass)
    rate = spin * math.sqrt(reduced * hinge * com / (mass * com * com / 3.0 + reduced * com * com))
    sn, cn, _, _ = ellipj(rate * LIGHT_TIMES + ellipk(k * k), k * k)
    q, qd = 2.0 * np.arcsin(k * sn), 2.0 * k * rate * cn
    values = {
        "q": q[:, None],
        "q'": qd[:, None],
        "attitude of vehicle": about(np.eye(3)[2], spin * LIGHT_TIMES),
    }
    return Reference(values, "Jacobi elliptic functions; 1e-7 from the rotation of the vehicle", 1e-7)


LIGHT_LINK = Case(
    name="link 1e-6 of the vehicle",
    description="a link of a millionth of the mass on a rotating vehicle, 10 s: joint and vehicle every 0.5 s",
    run=motion(
        _light_scene,
        LIGHT_TIMES,
        lambda s: {"q": s.q[0], "q'": s.qd[0], "attitude of vehicle": s.rotation[0]},
        twist=[0.0, 0.0, 0.0, 0.0, 0.0, LIGHT["spin"]],
    ),
    reference=_light_reference,
    steps={2: 0.01, 1: 0.001},
    interval=0.5,
)


# A light vehicle with a link of a thousand times its mass. The reference is the same pair exchanged: the heavy body
# as the vehicle and the light one as its link, so that the recursion runs the other way.
LIGHT_BODY = {"mass": 0.01, "inertia": [4e-5, 5e-5, 6e-5]}
HEAVY_BODY = {"mass": 10.0, "inertia": [0.3, 0.4, 0.5]}
LIGHT_ARM, HEAVY_ARM = np.array([0.06, 0.01, -0.02]), np.array([0.12, -0.05, 0.03])
HEAVY_TWIST, HEAVY_RATE = np.array([0.2, -0.1, 0.3, 0.5, 0.8, -0.4]), 0.7
HEAVY_TIMES = instants(0.5, 10)


def _hinged(runner: CaseRunner, parent: Scene, child: Scene, arm: Floats, child_arm: Floats, sign: float) -> Simulator:
    """Two bodies with a hinge at `arm` from the parent's centre of mass and at `child_arm` from the child's."""
    body = child | {"center_of_mass": (-child_arm).tolist()}
    hinged = link("link", body, position=arm.tolist(), axis=[0.0, 0.0, sign])
    return runner.simulator(with_arm(single_body("heavy link", parent), hinged))


def _run_heavy(runner: CaseRunner) -> Quantities:
    s = _hinged(runner, LIGHT_BODY, HEAVY_BODY, LIGHT_ARM, -HEAVY_ARM, 1.0)
    s.set_state(twist=HEAVY_TWIST, qd=[HEAVY_RATE])

    def observe(s: Simulator) -> Quantities:
        light, heavy = s.body_poses()[0]
        return _pair(s, light, heavy[:3, :3], heavy[:3, 3] + heavy[:3, :3] @ HEAVY_ARM)

    return runner.sampled(s, HEAVY_TIMES, observe)


def _run_exchanged(runner: CaseRunner) -> Quantities:
    s = _hinged(runner, HEAVY_BODY, LIGHT_BODY, -HEAVY_ARM, LIGHT_ARM, -1.0)
    # All frames are parallel at q = 0; the heavy body's twist is the light one's, shifted, plus the joint's.
    omega = HEAVY_TWIST[3:] + np.array([0.0, 0.0, HEAVY_RATE])
    at_hinge = HEAVY_TWIST[:3] + np.cross(HEAVY_TWIST[3:], LIGHT_ARM)
    s.set_state(
        position=LIGHT_ARM + HEAVY_ARM,
        twist=np.concatenate([at_hinge + np.cross(omega, HEAVY_ARM), omega]),
        qd=[HEAVY_RATE],
    )

    def observe(s: Simulator) -> Quantities:
        heavy, light = s.body_poses()[0]
        light = light.copy()
        light[:3, 3] -= light[:3, :3] @ LIGHT_ARM
        return _pair(s, light, heavy[:3, :3], heavy[:3, 3])

    return runner.sampled(s, HEAVY_TIMES, observe)


def _pair(s: Simulator, light: Floats, heavy: Floats, heavy_position: Floats) -> Quantities:
    return {
        "light body": light[:3, :3],
        "position of light body": light[:3, 3],
        "heavy body": heavy,
        "position of heavy body": heavy_position,
        "q": s.q[0],
        "momentum": s.momentum()[0],
        "energy": s.energy()["total"],
    }


@cache
def _heavy_reference() -> Reference:
    found = converged(_run_exchanged, 0.001, "the heavy body as the vehicle")
    for law in ("momentum", "energy"):
        found.values[law] = np.tile(found.values[law][:1], (len(HEAVY_TIMES), 1))
    return found


HEAVY_LINK = Case(
    name="link 1000 times the vehicle",
    description="a heavy link and a light vehicle tumble, 5 s: poses, joint, momentum and energy every 0.5 s",
    run=_run_heavy,
    reference=_heavy_reference,
    steps={4: 0.02, 2: 0.01, 1: 0.002},
    interval=0.5,
)


# Stiff damping of a light link: I q'' = tau - d q' - k q'|q'|, at rates of a thousand per second.
STIFF = {"inertia": 5e-5, "linear": 0.05, "quadratic": 0.02, "torque": 0.03}
STIFF_TIMES = instants(0.1, 10)


def _run_stiff(runner: CaseRunner) -> Quantities:
    inertia, linear, quadratic, torque = STIFF.values()
    damping = {"linear": [0.0] * 5 + [linear], "quadratic": [0.0] * 5 + [quadratic]}
    body = {"mass": 0.01, "inertia": [0.4 * inertia] * 3, "damping": damping, "added_mass": [0.0] * 5 + [0.6 * inertia]}
    vehicle = single_body("stiff damping", {"mass": 1.0, "inertia": [1.0] * 3}, 1000.0)
    s = runner.simulator(with_arm(vehicle, link("link", body), fixed=True))
    return runner.sampled(s, STIFF_TIMES, ["q", "q'"], joint_torque=[torque])


def _stiff_reference() -> Reference:
    inertia, d, k, torque = STIFF.values()
    # v' = -(k / I) (v - a) (v - b)
    root = math.sqrt(d * d + 4.0 * k * torque)
    a, b = (root - d) / (2.0 * k), (-root - d) / (2.0 * k)
    c, left = a / b, np.exp(-k / inertia * (a - b) * STIFF_TIMES)
    v = (a - b * c * left) / (1.0 - c * left)
    q = a * STIFF_TIMES + inertia / k * np.log((1.0 - c * left) / (1.0 - c))
    return Reference({"q": q[:, None], "q'": v[:, None]}, "closed form (Riccati)")


STIFF_DAMPING = Case(
    name="stiff damping of a light link",
    description="a fixed vehicle's light link, pushed against damping of rate 1000/s, 1 s: joint every 0.1 s",
    run=_run_stiff,
    reference=_stiff_reference,
    steps={1: 0.0005},
    interval=0.1,
    implicit_steps={2: 0.01},
    reason="explicit methods need steps below the time constant of 1 ms; a linearly implicit one does not",
)


# Joint gains a hundred times too high: the Reach Alpha 5 on its vehicle, moved by its servos to new targets.
GAIN = 100.0
# As far as the torque limits allow, and far enough for float32: a joint near 3 rad stops where its increment h q'
# falls below half a unit in the last place, 1.2e-7 rad.
SERVO_STEP = np.array([0.05, -0.016, 0.05, 0.05])
SERVO_TIMES = instants(0.2, 5)


def _run_servo(runner: CaseRunner) -> Quantities:
    scene = load_scene("bluerov2-heavy-alpha5")
    for loaded in scene["arm"]["links"]:
        for gain in ("kp", "kd"):
            loaded["joint"]["servo"][gain] *= GAIN
    s = runner.simulator(scene | {"name": "hard case stiff servos", "provenance": {}})
    start, target = s.q[0], s.q[0] + SERVO_STEP

    def observe(s: Simulator) -> Quantities:
        end = s.end_effector_pose()[0]
        return {"travel of joints": s.q[0] - start, "attitude": s.rotation[0], "end effector": end[:3, 3]}

    return runner.sampled(s, SERVO_TIMES, observe, joint_target=target)


STIFF_SERVO = Case(
    name="PD gains 100 times too high",
    description="BlueROV2 + Alpha 5, servo gains a hundredfold, joints to new targets, 1 s: joints, end effector",
    run=_run_servo,
    reference=cache(lambda: converged(_run_servo, 5e-5)),
    steps={1: 0.00025},
    interval=0.2,
    implicit_steps={2: 0.01, 3: 0.0025},
    reason="explicit methods need steps below the time constant of 0.2 ms; a linearly implicit one does not",
)


# Motion without damping returns to its start after all velocities are reversed.
BACK_TWIST = np.array([0.2, -0.1, 0.1, 0.1, -0.15, 0.2])
BACK_RATES = np.array([0.2, -0.3, 0.3, 0.4, 0.3])
BACK_TIME = 2.0


@cache
def _ideal_arm() -> dict[str, Any]:
    scene = conservative_scene(wet=True)
    scene["water"]["gravity"] = [0.0, 0.0, -9.81]
    return scene | {"name": "hard case reversal"}


def _run_back(runner: CaseRunner) -> Quantities:
    s = runner.simulator(_ideal_arm())
    s.set_state(twist=BACK_TWIST, qd=BACK_RATES)
    runner.advance(s, BACK_TIME)
    s.set_state(twist=-s.twist, qd=-s.qd)
    runner.advance(s, BACK_TIME)
    return _back(s, -s.twist, -s.qd)


def _back(s: Simulator, twist: Floats, qd: Floats) -> Quantities:
    # Positions relative to a metre.
    return {"position": 1.0 + s.position, "attitude": s.rotation, "twist": twist, "q": s.q, "q'": qd}


def _back_reference() -> Reference:
    return Reference(_back(Simulator(_ideal_arm()), BACK_TWIST[None], BACK_RATES[None]), "the state at the start")


REVERSAL = Case(
    name="reversal of time",
    description="PETASUS-PUM without damping and friction, 2 s forth and 2 s back under restoring loads: whole state",
    run=_run_back,
    reference=_back_reference,
    steps={4: 0.02, 3: 0.01, 2: 0.02, 1: 0.002},
    interval=BACK_TIME,
)

CASES = (LIGHT_LINK, HEAVY_LINK, STIFF_DAMPING, STIFF_SERVO, REVERSAL)
