"""Added mass as a lagged force beside exact added mass: a plate, pushed from rest, that meets a wall.

Programs whose engine has rigid bodies only apply added mass as a force `-M_A a` with a filtered finite difference
`a <- (1 - alpha) a + alpha (v - last v) / h` of the last steps. A step multiplies `a` by
`1 - alpha (1 + M_A / m)`: at any step it diverges where `M_A / m` exceeds `2 / alpha - 1`.
"""

import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from uvms_gym import Simulator, StepWarning
from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.progress import tracked

#: Mass of the plate, kg, its push, N, and the distance from the wall, m.
MASS, PUSH, DISTANCE = 1.0, 2.0, 0.1
#: Added mass along the push by mass.
RATIOS = (1.0, 3.0, 5.0, 6.0, 8.0, 9.0, 10.0, 12.0)
#: Steps and duration of the runs, interval of samples, and step of the reference, s.
STEPS, TIME, SAMPLE, FINE = (0.01, 0.005, 0.002, 0.001), 3.0, 0.01, 5e-5
#: Weight of the last acceleration in WasserMan, and in uuv_simulator and the integrator of this package.
SUITE, NATIVE_FILTER = 0.2, 0.3
NATIVE = "lagged-added-mass"
#: A run has diverged if it is this many times as fast as the converged motion.
DIVERGED = 10.0


def bound(alpha: float) -> float:
    """Ratio of added mass to mass beyond which a lagged force diverges, whatever the step."""
    return 2.0 / alpha - 1.0


def plate(added_mass: float, wall: bool = True) -> dict[str, Any]:
    """Neutrally buoyant plate with an added mass along x, kg, before a wall that it touches with a pad."""
    body = {
        "mass": MASS,
        "inertia": [0.02] * 3,
        "volume": MASS / 1000.0,
        "added_mass": [added_mass, 0.0, 0.0, 0.0, 0.0, 0.0],
        "damping": {"linear": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], "quadratic": [20.0, 0.0, 0.0, 0.0, 0.0, 0.0]},
    }
    contact = {
        "stiffness": 5000.0,
        "dissipation": 10.0,
        "ramp": 0.001,
        "spheres": [{"name": "pad", "on": "vehicle", "position": [0.0, 0.0, 0.0], "radius": 0.01}],
        "shapes": [
            {
                "name": "wall",
                "kind": "plane",
                "frame": {"position": [0.01 + DISTANCE, 0, 0], "rpy": [0, -math.pi / 2, 0]},
            }
        ],
    }
    water = {"density": 1000.0, "gravity": [0.0, 0.0, -9.81]}
    scene = {"name": "plate", "water": water, "vehicle": {"name": "plate", "body": body}}
    return scene | ({"contact": contact} if wall else {})


def exact(ratios: Sequence[float], step: float, wall: bool = True, integrator: str = "mk4") -> Floats:
    """Positions and speeds (2, times, ratios) of plates by an integrator of this package."""
    simulator = _simulator(plate(MASS, wall), len(ratios), step, integrator)
    simulator.scale_parameters(added_mass=np.array(ratios))
    return _motion(simulator, lambda: simulator.step(wrench=[PUSH, 0, 0, 0, 0, 0], substeps=_count(step)))


def lagged(ratios: Sequence[float], step: float, alpha: float, wall: bool = True) -> Floats:
    """Positions and speeds (2, times, ratios) of rigid plates under added mass as a lagged force.

    The bodies follow semi-implicit Euler steps, as in engines of games.
    """
    simulator = _simulator(plate(0.0, wall), len(ratios), step, "semi-implicit-euler")
    wrench, added = np.zeros((len(ratios), 6)), MASS * np.array(ratios)
    filtered: Floats = np.zeros(len(ratios))
    last: Floats | None = None

    def advance() -> None:
        nonlocal filtered, last
        for _ in range(_count(step)):
            speed = simulator.twist[:, 0]
            if last is not None:
                filtered = (1.0 - alpha) * filtered + alpha * (speed - last) / step
            last = speed
            # The simulator refuses forces that are not finite, of plates that have diverged.
            wrench[:, 0] = np.nan_to_num(PUSH - added * filtered, nan=1e12, posinf=1e12, neginf=-1e12)
            simulator.step(wrench=wrench)

    return _motion(simulator, advance)


def _count(step: float) -> int:
    return max(1, round(SAMPLE / step))


def _simulator(scene: dict[str, Any], n: int, step: float, integrator: str) -> Simulator:
    return Simulator(scene, n, dt=step, integrator=integrator, threads=1, error_estimate=False)


def _motion(simulator: Simulator, advance: Callable[[], None]) -> Floats:
    rows = []
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", StepWarning)
        for _ in range(round(TIME / SAMPLE)):
            advance()
            rows.append((simulator.position[:, 0], simulator.twist[:, 0]))
    return np.stack(rows, axis=1)


def study(ratios: Sequence[float] = RATIOS, steps: Sequence[float] = STEPS, fine: float = FINE) -> dict[str, Any]:
    """Maximum deviations of positions from the converged motion, m, with a wall and without; infinite where diverged.

    Returns
    -------
    dict
        `ratios`, `steps`, `bounds` by method, `uncertainty` of the reference, m, and in `errors` by "wall" and "open
        water" and by method a table (steps, ratios); `time`, s, and `positions`, m, before the wall at the step `shown`
        by method, (times, ratios).
    """
    suite = f"lagged force, alpha {SUITE:g}"
    methods: dict[str, Callable[[float, bool], Floats]] = {
        suite: lambda step, wall: lagged(ratios, step, SUITE, wall),
        NATIVE: lambda step, wall: exact(ratios, step, wall, NATIVE),
        "semi-implicit-euler": lambda step, wall: exact(ratios, step, wall, "semi-implicit-euler"),
        "mk4": lambda step, wall: exact(ratios, step, wall),
    }
    found: dict[str, Any] = {
        "ratios": list(ratios),
        "steps": list(steps),
        "bounds": {suite: bound(SUITE), NATIVE: bound(NATIVE_FILTER)},
        "errors": {},
        "uncertainty": {},
    }
    for place, wall in (("wall", True), ("open water", False)):
        reference = exact(ratios, fine, wall)
        found["uncertainty"][place] = float(deviation(exact(ratios, 2.0 * fine, wall), reference).max())
        found["errors"][place] = {
            name: [deviation(run(step, wall), reference).tolist() for step in steps]
            for name, run in tracked(methods.items(), f"added mass, {place}")
        }
    shown = steps[min(1, len(steps) - 1)]
    found |= {"shown": shown, "time": (SAMPLE * np.arange(1, round(TIME / SAMPLE) + 1)).tolist()}
    found["positions"] = {name: run(shown, True)[0] for name, run in methods.items()}
    return found


def deviation(found: Floats, reference: Floats) -> Floats:
    """Maximum distance (ratios,) of motions (2, times, ratios) from a reference, m; infinite where `DIVERGED`."""
    with np.errstate(invalid="ignore"):
        off = np.abs(found - reference)[0].max(axis=0)
        slow = np.abs(found[1]).max(axis=0) < DIVERGED * np.abs(reference[1]).max(axis=0)
    return np.where(slow, off, np.inf)
