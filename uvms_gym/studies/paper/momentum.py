"""Momentum conservation of the paper's 11-DoF system, and the order of its drift in the step."""

from typing import Any

import numpy as np

from uvms_gym import Simulator, load_scene
from uvms_gym._scene import bodies
from uvms_gym.logs.interpolation import hermite
from uvms_gym.studies.numerics import Floats, convergence_order
from uvms_gym.studies.progress import tracked

TIME = 100.0
STEPS = (0.04, 0.02, 0.01, 0.005)
#: Bound on the relative drift at the paper's step of 0.01 s.
BAR = 1e-8
# Joint targets are cubics over intervals of this length, s: the drive is the same at all step sizes.
INTERVAL = 0.2
AMPLITUDE, FREQUENCY = 0.85, 0.5
CENTRE = np.array([0.0, 0.5, 0.8, 0.4, 0.0])
PHASE = np.array([0.0, np.pi, 0.0, np.pi, 0.0])
BANDWIDTH = 0.5
TWIST = (0.1, -0.05, 0.05, 0.02, -0.03, 0.04)


def conservative_scene(wet: bool) -> dict[str, Any]:
    """PETASUS-PUM without gravity, damping, joint friction and limits; without water too unless `wet`.

    Joints get soft servos of about equal bandwidth: stiff ones would make coarse steps unstable, and torques between
    bodies change no momentum.
    """
    scene: dict[str, Any] = load_scene("petasus-pum")
    scene["provenance"] = {}
    scene["water"]["gravity"] = [0.0, 0.0, 0.0]
    links = scene["arm"]["links"]
    for _, body in bodies(scene):
        body["damping"] = {"linear": [0.0] * 6, "quadratic": [0.0] * 6}
        if not wet:
            body["added_mass"] = [0.0] * 6
    if not wet:
        scene["water"]["density"] = 0.0
    for link in links:
        for key in ("friction", "limits", "effort", "speed"):
            link["joint"].pop(key, None)
    simulator = Simulator(scene, error_estimate=False)
    simulator.set_state(q=CENTRE)
    mass = simulator.mass_matrix()[0]
    # Geometric mean of the joint-space inertia with all other joints fixed and with all others free.
    inertias = np.sqrt(np.diag(mass) / np.diag(np.linalg.inv(mass)))[6:]
    for link, inertia in zip(links, inertias, strict=True):
        link["joint"]["servo"] = {"kp": BANDWIDTH**2 * float(inertia), "kd": 2.0 * BANDWIDTH * float(inertia)}
    return scene


def target(time: float) -> tuple[Floats, Floats]:
    """Joint targets and their rates: sines with peaks of 0.42 rad/s, which the soft servos overshoot."""
    angle = FREQUENCY * time + PHASE
    return CENTRE + AMPLITUDE * np.sin(angle), AMPLITUDE * FREQUENCY * np.cos(angle)


def drift(scene: dict[str, Any], step: float, time: float = TIME) -> dict[str, Any]:
    """Drift of momentum in one run, relative to the sum over bodies of |momentum| at the start."""
    simulator = Simulator(scene, dt=step, error_estimate=False)
    q, qd = target(0.0)
    simulator.set_state(twist=TWIST, q=q, qd=qd)
    start = simulator.momentum()[0]
    scale = simulator.momentum_terms()["total_scale"][0]
    times, drifts, rates = [0.0], [np.zeros(2)], [simulator.qd[0]]
    for i in tracked(range(round(time / INTERVAL)), "momentum"):
        coefficients = hermite(target(i * INTERVAL), target((i + 1) * INTERVAL), INTERVAL)
        simulator.step(joint_target=coefficients[None], substeps=round(INTERVAL / step))
        difference = simulator.momentum()[0] - start
        times.append((i + 1) * INTERVAL)
        drifts.append(np.linalg.norm(difference.reshape(2, 3), axis=1) / scale)
        rates.append(simulator.qd[0])
    all_rates, all_drifts = np.array(rates), np.array(drifts)
    return {
        "step": step,
        "initial_momentum": start,
        "scale": scale,
        "linear": float(all_drifts[:, 0].max()),
        "angular": float(all_drifts[:, 1].max()),
        "joint_rate_rms": np.sqrt((all_rates**2).mean(axis=0)),
        "joint_rate_max": np.abs(all_rates).max(axis=0),
        "time": np.array(times),
        "drift": all_drifts,
    }


def momentum() -> dict[str, Any]:
    """Drifts and their orders at all steps of both systems: without water, and the total impulse in still water."""
    result = {}
    for name, wet in (("without water", False), ("total impulse in still water", True)):
        scene = conservative_scene(wet)
        runs = [drift(scene, step) for step in STEPS]
        orders = {kind: convergence_order(STEPS, [run[kind] for run in runs]) for kind in ("linear", "angular")}
        result[name] = {"runs": runs, "orders": orders}
    return result
