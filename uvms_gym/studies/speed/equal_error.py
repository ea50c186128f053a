"""Steps at equal error: the step of a MuJoCo integrator with the error of MK4 at its own step.

Each program has its own fine reference: the same motion of the same bodies, by its own water model. Errors too small
for practical steps are reached on the line through the finest steps.
"""

from typing import Any

import numpy as np

from uvms_gym import Simulator
from uvms_gym.studies.numerics import Floats, loglog_interpolation
from uvms_gym.studies.progress import tracked
from uvms_gym.studies.speed.physics import DT, THRUST

#: Initial twists (N, 6), constant thrusts (N, m) and joint targets (n,).
Motions = tuple[Floats, Floats, Floats]

#: Motions and their duration, s: vehicle with a random initial twist, constant thrusts, arm at home by its servos.
MOTIONS, TIME = 8, 1.0
#: Maximum speeds at the start, m/s and rad/s.
SPEED, SPIN = 0.5, 0.5
#: Steps of each integrator, s, and of the references.
LADDERS = {"RK4": (0.01, 0.005, 0.0025, 0.00125), "Euler": (1e-3, 1e-4, 1e-5), "implicitfast": (1e-3, 1e-4, 1e-5)}
#: Steps of a quick study, s.
QUICK_LADDERS = {"RK4": (0.01, 0.005), "Euler": (1e-3, 2.5e-4), "implicitfast": (1e-3, 2.5e-4)}
OURS, THEIRS = DT / 32, 1e-4
#: Steps of one rollout, whose states are all in memory.
CHUNK = 1000


def study(scene: dict[str, Any], seed: int, quick: bool) -> dict[str, Any]:
    """Find the steps at equal error.

    Returns
    -------
    dict
        `ours`: median error of the vehicle's position, m, of MK4 at `DT` by dtype; `theirs` by integrator: `steps`,
        `errors`, `order` of the finest two, and by dtype the equal `step`, s, and whether it is `extrapolated`;
        `uncertainty`: change of either reference with twice its step, m.
    """
    ladders = QUICK_LADDERS if quick else LADDERS
    motions = _motions(scene, seed)
    fine = _by_us(scene, motions, OURS)
    ours = {dtype: _error(_by_us(scene, motions, DT, dtype), fine) for dtype in ("float64", "float32")}
    uncertainty = {"ours": _error(_by_us(scene, motions, 2.0 * OURS), fine)}
    theirs: dict[str, Any] = {}
    reference = _by_mujoco(scene, motions, "RK4", THEIRS)
    uncertainty["theirs"] = _error(_by_mujoco(scene, motions, "RK4", 2.0 * THEIRS), reference)
    for integrator, steps in ladders.items():
        title = f"MuJoCo {integrator}"
        errors = [_error(_by_mujoco(scene, motions, integrator, step), reference) for step in tracked(steps, title)]
        theirs[integrator] = {
            "steps": steps,
            "errors": errors,
            "order": float(np.log(errors[-2] / errors[-1]) / np.log(steps[-2] / steps[-1])),
            "equal": {dtype: equal_step(steps, errors, error) for dtype, error in ours.items()},
        }
    return {"ours": ours, "theirs": theirs, "uncertainty": uncertainty, "motions": MOTIONS, "time": TIME}


def equal_step(steps: tuple[float, ...], errors: list[float], error: float) -> dict[str, Any]:
    """Step of a method with a given error, by its line of log step over log error; steps are in descending order."""
    valid = [(h, e) for h, e in zip(steps, errors, strict=True) if np.isfinite(e) and e > 0.0]
    if len(valid) < 2:
        raise ValueError("no equal error: MuJoCo's motion is not finite at all steps but one")
    h, e = np.transpose(valid[::-1])
    step = loglog_interpolation(e, h, error)
    return {"step": step, "extrapolated": not h[0] <= step <= h[-1]}


def _motions(scene: dict[str, Any], seed: int) -> Motions:
    rng = np.random.default_rng(seed)
    simulator = Simulator(scene)
    low, high = simulator.thruster_limits.T
    twists = rng.uniform(-1.0, 1.0, (MOTIONS, 6)) * np.repeat([SPEED, SPIN], 3)
    return twists, THRUST * rng.uniform(low, high, (MOTIONS, len(low))), simulator.q[0]


def _by_us(scene: dict[str, Any], motions: Motions, step: float, dtype: str = "float64") -> Floats:
    """Final positions (N, 3) of the vehicles by MK4."""
    twists, thrust, home = motions
    simulator = Simulator(scene, MOTIONS, dt=step, dtype=dtype)
    simulator.set_state(twist=twists)
    inputs = {"thrust": thrust} if thrust.size else {}
    if home.size:
        inputs["joint_target"] = np.tile(home, (MOTIONS, 1))
    simulator.step(**inputs, substeps=round(TIME / step))
    return simulator.position


def _by_mujoco(scene: dict[str, Any], motions: Motions, integrator: str, step: float) -> Floats:
    """Final positions (N, 3) of the vehicles by MuJoCo."""
    from uvms_gym.studies.speed import mujoco_model

    twists, thrust, home = motions
    total = round(TIME / step)
    steps = min(total, CHUNK)
    rolling = mujoco_model.Rolling(scene, integrator, n=MOTIONS, steps=steps, step=step)
    rolling.begin(twists, home)
    rolling.command(thrust, home)
    for _ in range(total // steps):
        rolling.step()
        rolling.start[:] = rolling.states[:, -1]
    return rolling.start[:, 1:4].copy()


def _error(found: Floats, reference: Floats) -> float:
    return float(np.median(np.linalg.norm(found - reference, axis=1)))
