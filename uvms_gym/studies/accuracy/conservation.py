"""Drift of energy and total impulse of a freely swinging system in still water without dissipation."""

import copy
import math
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from uvms_gym import Simulator
from uvms_gym._core import vehicle_terms
from uvms_gym._scene import bodies, joints
from uvms_gym.studies.accuracy.driven_motion import PERIOD
from uvms_gym.studies.accuracy.work_precision import Setting
from uvms_gym.studies.numerics import Floats, median_and_worst
from uvms_gym.studies.progress import tracked

#: Root mean squares at the start: velocity, m/s; angular velocity and joint rates, rad/s; joint coordinates about home.
SPEED, SPIN, RATE, SPREAD = 0.2, 0.2, 0.3, 0.3
QUANTITIES = ("energy", "linear", "angular")


def conservative(scene: dict[str, Any]) -> dict[str, Any]:
    """Copy of a scene with all its inertia and added mass, without gravity, damping, terms, friction and servos."""
    stripped = copy.deepcopy(scene)
    stripped["provenance"] = {}
    stripped["water"]["gravity"] = [0.0, 0.0, 0.0]
    stripped["water"].pop("current", None)
    for term, _ in vehicle_terms():
        stripped["vehicle"].pop(term, None)
    for _, body in bodies(stripped):
        # Buoyancy given as a force would remain without gravity.
        for key in ("damping", "buoyancy"):
            body.pop(key, None)
    for joint in joints(stripped):
        for key in ("friction", "limits", "effort", "speed", "servo"):
            joint.pop(key, None)
    return stripped


def drifts(
    scene: dict[str, Any],
    chosen: Sequence[Setting],
    *,
    episodes: int,
    seconds: float,
    seed: int,
) -> list[dict[str, Any]]:
    """Maximum relative drifts by every setting: of energy, and of impulse over the sum of |momentum| at the start.

    Each is the maximum over the whole seconds of a run; median and worst of the ensemble. Impulse is left out where
    the vehicle is fixed: it is not conserved then.
    """
    still = conservative(scene)
    state = _start(still, episodes, seed)
    rows = []
    for setting in tracked(chosen, "drift"):
        with warnings.catch_warnings(), np.errstate(over="ignore", invalid="ignore"):
            warnings.simplefilter("ignore")
            simulator = Simulator(still, episodes, **setting.options())
            simulator.set_state(**state)
            maximum = _maximum(simulator, seconds)
        row: dict[str, Any] = setting._asdict()
        for name, values in maximum.items():
            row[name] = median_and_worst(np.where(np.isfinite(values), values, np.inf))
        rows.append(row)
    return rows


def _start(scene: dict[str, Any], episodes: int, seed: int) -> dict[str, Floats]:
    rng = np.random.default_rng(seed)
    simulator = Simulator(scene, episodes)
    moving = simulator.q.shape
    state = {"q": simulator.q + SPREAD * rng.normal(size=moving), "qd": RATE * rng.normal(size=moving)}
    state["current"] = np.zeros((episodes, 3))
    if not scene["vehicle"]["fixed"]:
        state["twist"] = np.repeat([SPEED, SPIN], 3) / math.sqrt(3.0) * rng.normal(size=(episodes, 6))
    return state


def _maximum(simulator: Simulator, seconds: float) -> dict[str, Floats]:
    energy, momentum = _energy(simulator), simulator.momentum()
    scale = simulator.momentum_terms()["total_scale"]
    maximum = {name: np.zeros(simulator.num_envs) for name in QUANTITIES}
    total = round(seconds / PERIOD)
    for begun in range(0, total, 10):
        simulator.step(substeps=round(min(10, total - begun) * PERIOD / simulator.dt))
        impulse = (simulator.momentum() - momentum).reshape(-1, 2, 3)
        off = np.linalg.norm(impulse, axis=-1) / scale
        now = {"energy": np.abs(_energy(simulator) / energy - 1.0), "linear": off[:, 0], "angular": off[:, 1]}
        # NaN propagates.
        maximum = {name: np.maximum(maximum[name], now[name]) for name in QUANTITIES}
    if simulator.scene["vehicle"]["fixed"]:
        return {"energy": maximum["energy"]}
    return maximum


def _energy(simulator: Simulator) -> Floats:
    terms = simulator.energy()
    return terms["kinetic_rigid"] + terms["kinetic_added"]
