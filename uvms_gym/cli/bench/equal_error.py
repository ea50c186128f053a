"""At equal error: the step at which an integrator of MuJoCo errs as much as MK4 does at its own step.

Both programs are set against a fine reference of their own: the same motion of the same bodies, each in its own water.
Where an error is too small to be reached by steps that can be run, the line through the finest ones is extended.
"""

from typing import Any

import numpy as np

from uvms_gym import Simulator
from uvms_gym.cli.bench.chain import Floats
from uvms_gym.cli.bench.physics import DT, THRUST
from uvms_gym.cli.bench.timing import Tick
from uvms_gym.cli.common import fail

#: Motions and their length, s: vehicle set adrift, thrusts held, the arm's servos holding it at its home.
MOTIONS, TIME = 8, 1.0
#: Greatest speeds at the start, m/s and rad/s.
SPEED, SPIN = 0.5, 0.5
#: Steps that are tried, s, and those of the references.
LADDERS = {
    "RK4": (0.01, 0.005, 0.0025, 0.00125),
    "Euler": (1e-3, 1e-4, 1e-5),
    "implicitfast": (1e-3, 1e-4, 1e-5),
}
#: Fewer for those who are in a hurry.
QUICK_LADDERS = {"RK4": (0.01, 0.005), "Euler": (1e-3, 2.5e-4), "implicitfast": (1e-3, 2.5e-4)}
OURS, THEIRS = DT / 32, 1e-4
#: Steps of one rollout: all states of one are kept.
CHUNK = 1000


def study(scene: dict[str, Any], seed: int, quick: bool, tick: Tick) -> dict[str, Any]:
    """Find those steps.

    Returns
    -------
    dict
        `ours`: median error of the vehicle's position, m, of MK4 at `DT` by dtype; `theirs` by integrator: `steps`,
        `errors`, `order` of the finest two, and by dtype the equal `step`, s, and whether it is `extrapolated`;
        `doubt`: what half the step changes of either reference, m.
    """
    ladders = QUICK_LADDERS if quick else LADDERS
    states, thrust, home = _motions(scene, seed)
    # Single precision would start at a rounded state otherwise.
    truth = _by_us(scene, states, thrust, home, OURS)
    tick()
    ours = {dtype: _error(_by_us(scene, states, thrust, home, DT, dtype), truth) for dtype in ("float64", "float32")}
    doubt = {"ours": _error(_by_us(scene, states, thrust, home, 2.0 * OURS), truth)}
    theirs: dict[str, Any] = {}
    reference = _by_mujoco(scene, states, thrust, home, "RK4", THEIRS)
    doubt["theirs"] = _error(_by_mujoco(scene, states, thrust, home, "RK4", 2.0 * THEIRS), reference)
    tick()
    for integrator, steps in ladders.items():
        errors = []
        for step in steps:
            errors.append(_error(_by_mujoco(scene, states, thrust, home, integrator, step), reference))
            tick()
        theirs[integrator] = {
            "steps": steps,
            "errors": errors,
            "order": float(np.log(errors[-2] / errors[-1]) / np.log(steps[-2] / steps[-1])),
            "equal": {dtype: equal_step(steps, errors, error) for dtype, error in ours.items()},
        }
    return {"ours": ours, "theirs": theirs, "doubt": doubt, "motions": MOTIONS, "time": TIME}


def ticks(quick: bool) -> int:
    """How often `study` ticks."""
    return 2 + sum(len(steps) for steps in (QUICK_LADDERS if quick else LADDERS).values())


def equal_step(steps: tuple[float, ...], errors: list[float], error: float) -> dict[str, Any]:
    """Step at which a method errs by `error`: on its line of log error over log step, extended at its ends.

    Steps come in falling order. An error that is not finite, or that does not fall, tells nothing.
    """
    sound = [(h, e) for h, e in zip(steps, errors, strict=True) if np.isfinite(e) and e > 0.0]
    if len(sound) < 2:
        raise fail("MuJoCo's motion left the finite numbers at all steps but one, so there is no equal error")
    log_h, log_e = np.log(np.array(sound[::-1])).T
    k = int(np.clip(np.searchsorted(log_e, np.log(error)), 1, len(log_e) - 1))
    slope = (log_e[k] - log_e[k - 1]) / (log_h[k] - log_h[k - 1])
    step = float(np.exp(log_h[k] + (np.log(error) - log_e[k]) / slope))
    return {"step": step, "extrapolated": not sound[-1][0] <= step <= sound[0][0]}


def _motions(scene: dict[str, Any], seed: int) -> tuple[list[dict[str, Floats]], Floats, Floats]:
    """Starts, held thrusts (N, m) and joint targets (n,)."""
    rng = np.random.default_rng(seed)
    simulator = Simulator(scene)
    home = simulator.q[0]
    low, high = simulator.thruster_limits.T
    states = [
        {
            "position": np.zeros(3),
            "rotation": np.eye(3),
            "twist": np.concatenate([rng.uniform(-SPEED, SPEED, 3), rng.uniform(-SPIN, SPIN, 3)]),
            "q": home,
            "qd": np.zeros_like(home),
        }
        for _ in range(MOTIONS)
    ]
    return states, THRUST * rng.uniform(low, high, (MOTIONS, len(low))), home


def _by_us(
    scene: dict[str, Any],
    states: list[dict[str, Floats]],
    thrust: Floats,
    home: Floats,
    step: float,
    dtype: str = "float64",
) -> Floats:
    """(N, 3) where the vehicles end by MK4."""
    simulator = Simulator(scene, MOTIONS, dt=step, dtype=dtype)
    simulator.set_state(**{name: np.array([state[name] for state in states]) for name in states[0]})
    inputs = {"thrust": thrust} if thrust.size else {}
    if home.size:
        inputs["joint_target"] = np.tile(home, (MOTIONS, 1))
    simulator.step(**inputs, substeps=round(TIME / step))
    return simulator.position


def _by_mujoco(
    scene: dict[str, Any],
    states: list[dict[str, Floats]],
    thrust: Floats,
    home: Floats,
    integrator: str,
    step: float,
) -> Floats:
    """(N, 3) where the vehicles end by MuJoCo."""
    from uvms_gym.cli.bench import mujoco_peer

    total = round(TIME / step)
    steps = min(total, CHUNK)
    model = mujoco_peer.build(scene, integrator, step)
    rolling = mujoco_peer.Rolling(model, scene, n=MOTIONS, steps=steps, measured=False)
    for row, state in zip(rolling.start, states, strict=True):
        rolling.put(row, state)
    rolling.command(thrust, home)
    for _ in range(total // steps):
        rolling.step()
        rolling.start[:] = rolling.states[:, -1]
    return rolling.start[:, 1:4].copy()


def _error(found: Floats, truth: Floats) -> float:
    return float(np.median(np.linalg.norm(found - truth, axis=1)))
