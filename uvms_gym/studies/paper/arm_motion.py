"""Figs. 5, 6 and 7: motion of the vehicle as joint 2 of its arm moves 45 degrees and back."""

import math
from typing import Any

import numpy as np

from uvms_gym import Simulator, load_scene
from uvms_gym._rotations import rpy_of
from uvms_gym.logs.interpolation import hermite
from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.progress import tracked

STEP = 0.01
TIME = 50.0
TRAVEL = math.radians(45.0)
JOINT = 1
#: Settling time of a loop before the arm moves, s.
SETTLING = 200.0
#: Steps between samples.
STRIDE = 10
CASES = ("uncontrolled", "PD-controlled", "vehicle held")


def target(home: Floats, time: float) -> tuple[Floats, Floats]:
    """Joint targets and their rates: joint 2 follows q_0 + 45 deg (1 - cos(2 pi t / 50)) / 2, the others rest."""
    q, qd = home.copy(), np.zeros_like(home)
    angle = 2.0 * math.pi / TIME
    q[JOINT] += 0.5 * TRAVEL * (1.0 - math.cos(angle * time))
    qd[JOINT] = 0.5 * TRAVEL * angle * math.sin(angle * time)
    return q, qd


def follow(case: str) -> dict[str, Any]:
    """Run a case from the equilibrium of its own loop; an uncontrolled vehicle starts at the world's origin.

    The joint servos are PD, as in the paper, so the joints sag under the arm's weight in water. A start at q_0 itself
    would superpose that sag, and the swing of the vehicle from it, on the scenario.
    """
    scene = load_scene("petasus-pum")
    scene["vehicle"]["fixed"] = case == "vehicle held"
    simulator = Simulator(scene, dt=STEP, error_estimate=False)
    home = simulator.q[0]
    loop: dict[str, Any] = {"pose_target": (np.zeros(3), np.eye(3))} if case == "PD-controlled" else {}
    simulator.step(joint_target=home, substeps=round(SETTLING / STEP), **loop)
    simulator.set_state(twist=np.zeros(6), qd=np.zeros_like(home), time=0.0)
    if case == "uncontrolled":
        simulator.set_state(position=np.zeros(3))
    samples = [_sample(simulator)]
    for i in tracked(range(round(TIME / STEP)), f"arm motion, {case}"):
        coefficients = hermite(target(home, i * STEP), target(home, (i + 1) * STEP), STEP)
        simulator.step(joint_target=coefficients[None], **loop)
        if (i + 1) % STRIDE == 0:
            samples.append(_sample(simulator))
    columns = {name: np.array([sample[name] for sample in samples]) for name in samples[0]}
    columns["joint_2_target"] = np.array([target(home, time)[0][JOINT] for time in columns["time"]])
    return columns


def arm_motion() -> dict[str, Any]:
    """Run all cases.

    Numbers are relative to each case's start; for the end effector they are relative to the fixed vehicle's.
    """
    cases = {case: follow(case) for case in CASES}
    ideal = cases["vehicle held"]["end_effector"]
    return {"cases": cases, "numbers": {case: _numbers(columns, ideal) for case, columns in cases.items()}}


def _sample(simulator: Simulator) -> dict[str, Any]:
    return {
        "time": float(simulator.time[0]),
        "position": simulator.position[0],
        "rpy": rpy_of(simulator.rotation)[0],
        "end_effector": simulator.end_effector_pose()[0, :3, 3],
        "q": simulator.q[0],
    }


def _numbers(columns: dict[str, Floats], ideal: Floats) -> dict[str, float]:
    missed = columns["end_effector"] - ideal
    vectors = {"position": columns["position"], "angle": columns["rpy"], "end_effector": missed}
    result = {}
    for name, vector in vectors.items():
        size = np.linalg.norm(vector, axis=1)
        result[f"{name}_max"] = float(size.max())
        result[f"{name}_rms"] = math.sqrt(float((size**2).mean()))
        result[f"{name}_final"] = float(size[-1])
    lag = columns["q"][:, JOINT] - columns["joint_2_target"]
    start = float(np.linalg.norm(columns["rpy"], axis=1)[0])
    return result | {"angle_start": start, "joint_2_error_max": float(np.abs(lag).max())}
