"""Cases of sudden events: end stops, dead-bands, payloads."""

import math
from functools import cache

import numpy as np

from uvms_gym import Simulator, load_scene
from uvms_gym._scene import joints
from uvms_gym.studies.hard_cases.case import (
    MK4,
    Case,
    CaseRunner,
    NonFinite,
    Quantities,
    Reference,
    converged,
    instants,
    motion,
)
from uvms_gym.studies.hard_cases.reference_solutions import inertia_of
from uvms_gym.studies.hard_cases.scenes import Scene, link, single_body, with_arm
from uvms_gym.studies.numerics import Floats


def _end_stop() -> Case:
    """A link hits a compliant end stop at speed and leaves it again: I q'' = -(k + c q') p for p > 0.

    During contact p^2/2 = -(I/c) [(v - v0) - (k/c) ln((k + c v)/(k + c v0))], which gives the final speed v1 and, by a
    quadrature over the speed, the duration of contact.
    """
    inertia, k, c, v0, limit, start = 0.2, 40.0, 4.0, 5.0, 0.5, 0.0137
    stop = {"lower": -10.0, "upper": limit, "stiffness": k, "damping": c}
    stopped = link("link", {"mass": 0.5, "inertia": [inertia] * 3}, limits=stop, home=start)
    scene = with_arm(single_body("end stop", {"mass": 1.0, "inertia": [1.0] * 3}), stopped, fixed=True)
    times = instants(0.1, 6)
    # Without the instants in contact.
    clear = (times < 0.09) | (times > 0.4)

    def run(runner: CaseRunner) -> Quantities:
        values = motion(scene, times, ["q", "q'"], {"qd": [v0]})(runner)
        return {"q": values["q"][clear], "speed after": values["q'"][-1:]}

    def half_depth_squared(v: Floats) -> Floats:
        # log1p is accurate where v is near v0.
        return -(inertia / c) * ((v - v0) - (k / c) * np.log1p(c * (v - v0) / (k + c * v0)))

    def reference() -> Reference:
        from scipy.integrate import fixed_quad
        from scipy.optimize import brentq

        v1 = float(brentq(half_depth_squared, -k / c * (1.0 - 1e-12), 0.0, xtol=1e-15))

        # dt = -I dv / (p (k + c v)); v = (v0 + v1)/2 + (v0 - v1)/2 cos(a) removes the roots of p at both ends.
        def rate(a: Floats) -> Floats:
            v = 0.5 * (v0 + v1) + 0.5 * (v0 - v1) * np.cos(a)
            p = np.sqrt(2.0 * half_depth_squared(v))
            return inertia * 0.5 * (v0 - v1) * np.sin(a) / (p * (k + c * v))

        duration, hit, t = fixed_quad(rate, 0.0, math.pi, n=64)[0], (limit - start) / v0, times[clear]
        q = np.where(t < hit, start + v0 * t, limit + v1 * (t - hit - duration))
        values = {"q": q[:, None], "speed after": np.array([[v1]])}
        return Reference(values, "closed form, and quadrature of the contact")

    return Case(
        "joint limit hit at speed",
        "a link at 5 rad/s into a compliant stop and out: speed after, and the joint coordinate",
        run,
        reference,
        {2: 0.002, 1: 0.0005},
        0.1,
        smoothness=2,
        reason="the stop's torque has a kink within a step, which reduces any method to order 2",
    )


def _chatter_cases() -> tuple[Case, Case]:
    """Chatter of a dead-band: BlueROV2 Heavy, 2 N buoyant, under a sampled PD with commands around the edge.

    The command jumps at control instants only; the reference has the same control period. The second case has the
    commands of a fine run: all that integration does.
    """
    low, high = -2.4, 2.7  # T200: PWM 1470 to 1530
    period, count = 0.1, 200

    def run(runner: CaseRunner, commands: Floats | None = None) -> tuple[Quantities, Floats]:
        """Motion and commands (k, 8), N, under the sampled PD, or under given commands."""
        scene = load_scene("bluerov2-heavy")
        s = runner.simulator(scene | {"name": "hard case dead-band", "provenance": {}})
        kp, kd = (np.array(scene["vehicle"]["servo"][gain]) for gain in ("kp", "kd"))
        s.set_state(position=[0.3, -0.2, 0.1])
        rows = []
        for k in range(count):
            if commands is None:
                rotation = s.rotation[0]
                skew = rotation - rotation.T
                tilt = 0.5 * np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
                wanted = s.allocate(-kp * np.concatenate([rotation.T @ s.position[0], tilt]) - kd * s.twist[0])[0]
                command = np.where((wanted < low) | (wanted > high), wanted, 0.0)
            else:
                command = commands[k]
            runner.advance(s, period, thrust=command)
            rows.append((s.position[0], s.rotation[0], s.twist[0], command))
        position, attitude, twist, given = (np.array(part) for part in zip(*rows, strict=True))
        return {"position": position, "attitude": attitude, "twist": twist}, given

    def run_counted(runner: CaseRunner) -> Quantities:
        values, commands = run(runner)
        switches = np.abs(np.diff((commands != 0.0).astype(np.float64), axis=0)).sum()
        return values | {"switchings": np.array([[switches]])}

    @cache
    def recorded() -> Floats:
        return run(CaseRunner(MK4, "float64", 0.002))[1]

    def run_recorded(runner: CaseRunner) -> Quantities:
        return run(runner, recorded())[0]

    steps = {4: 0.005, 3: 0.01, 2: 0.01, 1: 0.005}
    chatter = Case(
        "thruster dead-band chatter",
        "BlueROV2 Heavy under a sampled PD with a dead-band, 20 s: pose, twist and number of switchings",
        run_counted,
        cache(lambda: converged(run_counted, 0.002, "with the same control period")),
        steps,
        period,
        coarsest=0.025,
        reason="a decision outside of the simulator: beyond 0.025 s a command near the edge of its dead-band may "
        "switch one control period earlier, and the motion is another from there on, as in chaos; the next case has "
        "recorded commands",
    )
    return chatter, Case(
        "commands that chatter",
        "the same 20 s under the recorded commands, up to 19 switchings a second: pose and twist",
        run_recorded,
        cache(lambda: converged(run_recorded, 0.002, "under the same commands")),
        steps,
        period,
    )


CHATTER, SWITCHING = _chatter_cases()


# A payload grasped and released by PETASUS-PUM in motion. Grasping is an inelastic impulse: with A_p the payload's
# rigid and added inertia and V_p its twist, (M + J^T A_p J) nu+ = M nu- + J^T A_p V_p.
PAYLOAD = {"mass": 2.0, "inertia": [0.01] * 3, "added_mass": [1.0] * 3 + [0.004] * 3}
PAYLOAD_TWIST = np.array([0.3, -0.1, 0.05, 0.05, -0.1, 0.1])
PAYLOAD_TARGET = np.array([0.3, 0.5, 0.8, 0.5, 0.2])
PAYLOAD_PART = 1.0


def _payload_scene(held: bool) -> Scene:
    scene = load_scene("petasus-pum")
    for joint in joints(scene):
        # Kinks of torque limits and end stops would hide the jumps of this case.
        for key in ("limits", "effort"):
            joint.pop(key)
        # Servos that are at work for the whole second.
        servo = joint["servo"]
        servo["kp"], servo["kd"] = 0.01 * servo["kp"], 0.1 * servo["kd"]
    if held:
        scene["payload"] = {"body": PAYLOAD | {"volume": 0.001}}
    return scene | {"name": "hard case payload", "provenance": {}}


def _copy_state(source: Simulator, to: Simulator, velocity: Floats) -> None:
    if not np.isfinite(velocity).all():
        raise NonFinite
    to.set_state(position=source.position, rotation=source.rotation, q=source.q, twist=velocity[:6], qd=velocity[6:])


def grasp_velocity(mass: Floats, joined: Floats, velocity: Floats) -> Floats:
    """Velocities [V; q'] after grasping a payload at rest, with the mass matrix `joined` of both."""
    return np.asarray(np.linalg.solve(joined, mass @ velocity), dtype=np.float64)


def _run_payload(runner: CaseRunner) -> Quantities:
    free, holding = (runner.simulator(_payload_scene(held)) for held in (False, True))
    free.set_state(twist=PAYLOAD_TWIST)
    payload = inertia_of(PAYLOAD)
    values: Quantities = {}

    def advance(s: Simulator, when: str) -> None:
        runner.advance(s, PAYLOAD_PART, joint_target=PAYLOAD_TARGET)
        values[f"end effector {when}"] = s.end_effector_pose()[:, :3, 3]
        values[f"attitude {when}"] = s.rotation
        values[f"twist {when}"] = s.twist
        values[f"q' {when}"] = s.qd

    advance(free, "before")
    before = np.concatenate([free.twist[0], free.qd[0]])
    matrix, jacobian = free.mass_matrix()[0], free.jacobian()[0]
    joined = matrix + jacobian.T @ payload @ jacobian
    after = grasp_velocity(matrix, joined, before)
    impulse, energy = free.momentum()[0], 0.5 * before @ matrix @ before
    _copy_state(free, holding, after)
    # Laws: the inertia of both together, conserved impulse, no gain of energy.
    held = holding.mass_matrix()[0]
    values["inertia held"] = np.array([[1.0 + np.linalg.norm(held - joined) / np.linalg.norm(joined)]])
    gained = holding.momentum()[0] - impulse
    values["impulse kept"] = 1.0 + np.abs([gained]) / np.repeat(np.linalg.norm(impulse.reshape(2, 3), axis=1), 3)
    lost = energy - 0.5 * after @ held @ after
    values["energy gain at grasp"] = np.array([[1.0 + max(0.0, -lost / energy)]])
    advance(holding, "holding")

    velocity = np.concatenate([holding.twist[0], holding.qd[0]])
    _copy_state(holding, free, velocity)
    # The payload leaves with its own momentum and energy, by the twist of the end effector.
    carried = free.jacobian()[0] @ velocity
    whole, rest = (0.5 * velocity @ s.mass_matrix()[0] @ velocity for s in (holding, free))
    values["energy at release"] = np.array([[(rest + 0.5 * carried @ payload @ carried) / whole]])
    end = free.end_effector_pose()[0]
    force, moment = end[:3, :3] @ (payload @ carried)[:3], end[:3, :3] @ (payload @ carried)[3:]
    taken = np.concatenate([force, moment + np.cross(end[:3, 3], force)])
    difference = free.momentum()[0] + taken - holding.momentum()[0]
    scale = np.linalg.norm(holding.momentum()[0].reshape(2, 3), axis=1)
    values["impulse at release"] = 1.0 + np.abs([difference]) / np.repeat(scale, 3)
    advance(free, "after release")
    return values


@cache
def _payload_reference() -> Reference:
    found = converged(_run_payload, 0.0025, "conservation laws at grasp and release")
    for law in ("inertia held", "impulse kept", "energy gain at grasp", "energy at release", "impulse at release"):
        found.values[law] = np.ones_like(found.values[law])
    return found


PAYLOAD_CASE = Case(
    name="payload grasped and released",
    description="PETASUS-PUM in motion grasps 2 kg at rest and releases it 1 s later: motion, impulse, energy",
    run=_run_payload,
    reference=_payload_reference,
    steps={4: 0.01, 3: 0.01, 1: 0.002},
    interval=PAYLOAD_PART,
)

CASES = (_end_stop(), CHATTER, SWITCHING, PAYLOAD_CASE)
