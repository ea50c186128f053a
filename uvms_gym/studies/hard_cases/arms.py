"""Cases of arms: extreme mass ratios, stiff damping and stiff servos, and time reversal."""

import math
from functools import cache
from typing import Any

import numpy as np

from uvms_gym import Simulator, load_scene
from uvms_gym._rotations import about
from uvms_gym.studies.hard_cases.case import Case, CaseRunner, Quantities, Reference, converged, instants, motion_case
from uvms_gym.studies.hard_cases.reference_solutions import pendulum
from uvms_gym.studies.hard_cases.scenes import DENSITY, GRAVITY, Scene, link, single_body, with_arm
from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.paper.momentum import conservative_scene


def _light_link() -> Case:
    """A link of a millionth of the vehicle's mass, on a steadily rotating vehicle.

    The centrifugal force makes it a pendulum, q'' = -mu r l / (I_c + mu l^2) Omega^2 sin q, mu the reduced mass of
    both. Its effect on the vehicle's rotation, mu r l / I = 2e-9, is neglected.
    """
    mass, hinge, com, spin, start = 1e-6, 0.03, 0.03, 2.0, 1.0
    across, reduced = mass * com * com / 3.0, mass / (1.0 + mass)
    body = {"mass": mass, "center_of_mass": [com, 0.0, 0.0], "inertia": [0.01 * across, across, across]}
    vehicle = single_body("light link", {"mass": 1.0, "inertia": [0.4] * 3})

    def reference(times: Floats) -> Reference:
        rate = spin * math.sqrt(reduced * hinge * com / (mass * com * com / 3.0 + reduced * com * com))
        q, qd = pendulum(start, rate, times)
        values = {"q": q[:, None], "q'": qd[:, None], "attitude of vehicle": about(np.eye(3)[2], spin * times)}
        return Reference(values, "Jacobi elliptic functions; 1e-7 from the rotation of the vehicle", 1e-7)

    return motion_case(
        "link 1e-6 of the vehicle",
        "a link of a millionth of the mass on a rotating vehicle, 10 s: joint and vehicle every 0.5 s",
        with_arm(vehicle, link("link", body, position=(hinge, 0.0, 0.0), home=start)),
        instants(0.5, 20),
        reference,
        {2: 0.01, 1: 0.001},
        {"twist": [0.0, 0.0, 0.0, 0.0, 0.0, spin]},
        lambda s: {"q": s.q[0], "q'": s.qd[0], "attitude of vehicle": s.rotation[0]},
    )


def _heavy_link() -> Case:
    """A light vehicle with a link of a thousand times its mass.

    The reference is the same pair exchanged: the heavy body as the vehicle and the light one as its link, so that the
    recursion runs the other way.
    """
    light_body = {"mass": 0.01, "inertia": [4e-5, 5e-5, 6e-5]}
    heavy_body = {"mass": 10.0, "inertia": [0.3, 0.4, 0.5]}
    # From the light body's centre of mass to the hinge, and from there to the heavy body's.
    light_arm, heavy_arm = np.array([0.06, 0.01, -0.02]), np.array([0.12, -0.05, 0.03])
    twist, joint_rate, times = np.array([0.2, -0.1, 0.3, 0.5, 0.8, -0.4]), 0.7, instants(0.5, 10)

    def hinged(
        runner: CaseRunner, parent: Scene, child: Scene, arm: Floats, child_arm: Floats, sign: float
    ) -> Simulator:
        """Two bodies with a hinge at `arm` from the parent's centre of mass and at `child_arm` from the child's."""
        body = child | {"center_of_mass": (-child_arm).tolist()}
        hinge = link("link", body, position=arm.tolist(), axis=[0.0, 0.0, sign])
        return runner.simulator(with_arm(single_body("heavy link", parent), hinge))

    def pair(s: Simulator, poses: Any, light_offset: Floats, heavy_offset: Floats) -> Quantities:
        """Quantities from poses (4, 4) of the light and the heavy body, whose centres of mass are at offsets."""
        light, heavy = poses
        return {
            "light body": light[:3, :3],
            "position of light body": light[:3, 3] + light[:3, :3] @ light_offset,
            "heavy body": heavy[:3, :3],
            "position of heavy body": heavy[:3, 3] + heavy[:3, :3] @ heavy_offset,
            "q": s.q[0],
            "momentum": s.momentum()[0],
            "energy": s.energy()["total"],
        }

    def run(runner: CaseRunner) -> Quantities:
        s = hinged(runner, light_body, heavy_body, light_arm, -heavy_arm, 1.0)
        s.set_state(twist=twist, qd=[joint_rate])
        return runner.sampled(s, times, lambda s: pair(s, s.body_poses()[0], np.zeros(3), heavy_arm))

    def run_exchanged(runner: CaseRunner) -> Quantities:
        s = hinged(runner, heavy_body, light_body, -heavy_arm, light_arm, -1.0)
        # All frames are parallel at q = 0; the heavy body's twist is the light one's, shifted, plus the joint's.
        omega = twist[3:] + np.array([0.0, 0.0, joint_rate])
        at_hinge = twist[:3] + np.cross(twist[3:], light_arm)
        heavy_twist = np.concatenate([at_hinge + np.cross(omega, heavy_arm), omega])
        s.set_state(position=light_arm + heavy_arm, twist=heavy_twist, qd=[joint_rate])
        return runner.sampled(s, times, lambda s: pair(s, s.body_poses()[0][::-1], -light_arm, np.zeros(3)))

    @cache
    def reference() -> Reference:
        found = converged(run_exchanged, 0.001, "the heavy body as the vehicle")
        for law in ("momentum", "energy"):
            found.values[law] = np.tile(found.values[law][:1], (len(times), 1))
        return found

    return Case(
        "link 1000 times the vehicle",
        "a heavy link and a light vehicle tumble, 5 s: poses, joint, momentum and energy every 0.5 s",
        run,
        reference,
        {4: 0.02, 2: 0.01, 1: 0.002},
        0.5,
    )


def _stiff_damping() -> Case:
    """Stiff damping of a light link: I q'' = tau - d q' - k q'|q'|, at rates of a thousand per second."""
    inertia, d, k, torque = 5e-5, 0.05, 0.02, 0.03
    damping = {"linear": [0.0] * 5 + [d], "quadratic": [0.0] * 5 + [k]}
    body = {"mass": 0.01, "inertia": [0.4 * inertia] * 3, "damping": damping, "added_mass": [0.0] * 5 + [0.6 * inertia]}
    vehicle = single_body("stiff damping", {"mass": 1.0, "inertia": [1.0] * 3}, DENSITY)

    def reference(times: Floats) -> Reference:
        # v' = -(k / I) (v - a) (v - b)
        root = math.sqrt(d * d + 4.0 * k * torque)
        a, b = (root - d) / (2.0 * k), (-root - d) / (2.0 * k)
        c, left = a / b, np.exp(-k / inertia * (a - b) * times)
        v = (a - b * c * left) / (1.0 - c * left)
        q = a * times + inertia / k * np.log((1.0 - c * left) / (1.0 - c))
        return Reference({"q": q[:, None], "q'": v[:, None]}, "closed form (Riccati)")

    return motion_case(
        "stiff damping of a light link",
        "a fixed vehicle's light link, pushed against damping of rate 1000/s, 1 s: joint every 0.1 s",
        with_arm(vehicle, link("link", body), fixed=True),
        instants(0.1, 10),
        reference,
        {1: 0.0005},
        {},
        inputs={"joint_torque": [torque]},
        implicit_steps={2: 0.01},
        reason="explicit methods need steps below the time constant of 1 ms; a linearly implicit one does not",
    )


def _stiff_servo() -> Case:
    """Joint gains a hundred times too high: the Reach Alpha 5 on its vehicle, moved by its servos to new targets."""
    # As far as the torque limits allow, and far enough for float32: a joint near 3 rad stops where its increment h q'
    # falls below half a unit in the last place, 1.2e-7 rad.
    travel = np.array([0.05, -0.016, 0.05, 0.05])

    def run(runner: CaseRunner) -> Quantities:
        scene = load_scene("bluerov2-heavy-alpha5")
        for loaded in scene["arm"]["links"]:
            for gain in ("kp", "kd"):
                loaded["joint"]["servo"][gain] *= 100.0
        s = runner.simulator(scene | {"name": "hard case stiff servos", "provenance": {}})
        start = s.q[0]

        def observe(s: Simulator) -> Quantities:
            end = s.end_effector_pose()[0]
            return {"travel of joints": s.q[0] - start, "attitude": s.rotation[0], "end effector": end[:3, 3]}

        return runner.sampled(s, instants(0.2, 5), observe, joint_target=start + travel)

    return Case(
        "PD gains 100 times too high",
        "BlueROV2 + Alpha 5, servo gains a hundredfold, joints to new targets, 1 s: joints, end effector",
        run,
        cache(lambda: converged(run, 5e-5)),
        {1: 0.00025},
        0.2,
        {2: 0.01, 3: 0.0025},
        reason="explicit methods need steps below the time constant of 0.2 ms; a linearly implicit one does not",
    )


def _reversal() -> Case:
    """Motion without damping returns to its start after all velocities are reversed."""
    twist, rates, time = np.array([0.2, -0.1, 0.1, 0.1, -0.15, 0.2]), np.array([0.2, -0.3, 0.3, 0.4, 0.3]), 2.0

    @cache
    def scene() -> Scene:
        scene = conservative_scene(wet=True)
        scene["water"]["gravity"] = [0.0, 0.0, -GRAVITY]
        return scene | {"name": "hard case reversal"}

    def state(s: Simulator, twist: Floats, qd: Floats) -> Quantities:
        # Positions relative to a metre.
        return {"position": 1.0 + s.position, "attitude": s.rotation, "twist": twist, "q": s.q, "q'": qd}

    def run(runner: CaseRunner) -> Quantities:
        s = runner.simulator(scene())
        s.set_state(twist=twist, qd=rates)
        runner.advance(s, time)
        s.set_state(twist=-s.twist, qd=-s.qd)
        runner.advance(s, time)
        return state(s, -s.twist, -s.qd)

    return Case(
        "reversal of time",
        "PETASUS-PUM without damping and friction, 2 s forth and 2 s back under restoring loads: whole state",
        run,
        lambda: Reference(state(Simulator(scene()), twist[None], rates[None]), "the state at the start"),
        {4: 0.02, 3: 0.01, 2: 0.02, 1: 0.002},
        time,
    )


CASES = (_light_link(), _heavy_link(), _stiff_damping(), _stiff_servo(), _reversal())
