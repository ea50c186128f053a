"""Table 1 and fig. 2: a free rigid body by the paper's integrators, and a fairer comparison about three axes."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from uvms_gym import Simulator, load_scene
from uvms_gym.studies.numerics import Floats, convergence_order

STEP = 0.1
STEPS = 5000
SPIN = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
#: Yaw as printed in Table 1, rad.
PRINTED = {"MK4": 3.528, "Fossen": 3.683, "Ref": 3.528}

GAMMAS_RK4 = (0.0, 1.0, 5.0, 10.0, 15.0, 20.0, 22.5, 25.0, 26.0, 26.5, 27.0, 27.2, 27.5, 28.0, 30.0)
GAMMAS_EULER = (0.0, 0.05, 0.1, 0.15, 0.2, 0.24, 0.3, 0.4, 0.5, 0.75, 1.0, 1.5, 2.0)


class Method(NamedTuple):
    """An integrator with its name in tables and plots."""

    name: str
    integrator: str
    gamma: float = 1.0


METHODS = (
    Method("MK4", "mk4"),
    Method("RK4 + normalise", "rk4-normalise"),
    Method("eq. 14 RK4, gamma 1", "quaternion-rk4", 1.0),
    Method("eq. 14 RK4, gamma 20", "quaternion-rk4", 20.0),
    Method("eq. 14 RK4, gamma 27.2", "quaternion-rk4", 27.2),
    Method("eq. 14 Euler, gamma 0.24", "quaternion-euler", 0.24),
    Method("eq. 14 Euler, gamma 1", "quaternion-euler", 1.0),
)
FIGURE_2 = METHODS[:3] + METHODS[4:6]

TUMBLING_INERTIA = (1.0, 2.0, 2.6)
TUMBLING_SPIN = (0.0, 0.0, 0.0, 0.7, 0.5, -0.6)
TUMBLING_TIME = 100.0
TUMBLING_STEPS = (0.2, 0.1, 0.05, 0.025)
TUMBLING_METHODS = (
    *METHODS[:2],
    Method("eq. 14 RK4, gamma 0", "quaternion-rk4", 0.0),
    Method("eq. 14 RK4, gamma 1", "quaternion-rk4", 1.0),
    Method("eq. 14 RK4, gamma 10", "quaternion-rk4", 10.0),
)


def exact_yaw(steps: ArrayLike) -> Any:
    """Yaw after `steps` tenths of a second at 1 rad/s, in [0, 2 pi): the time itself, modulo 2 pi."""
    return np.mod(np.asarray(steps, dtype=np.float64) / 10.0, 2.0 * math.pi)


def spun(method: Method) -> Simulator:
    """Body of Table 1 at its start."""
    simulator = Simulator("free-body", dt=STEP, integrator=method.integrator, gamma=method.gamma, error_estimate=False)
    simulator.set_state(twist=SPIN)
    return simulator


def yaw_of(simulator: Simulator) -> float:
    """Yaw in [0, 2 pi) of the matrix made from the attitude, which may not be quite orthonormal."""
    rotation = simulator.rotation[0]
    return math.atan2(rotation[1, 0], rotation[0, 0]) % (2.0 * math.pi)


def table_1() -> list[dict[str, Any]]:
    """Yaw by method at 499.9 s, the instant printed in the paper, and at 500 s."""
    reference = {"yaw_499_9": float(exact_yaw(STEPS - 1)), "yaw_500": float(exact_yaw(STEPS))}
    first = {"method": "reference, t mod 2 pi", **reference, "error_500": 0.0, "quaternion_length": 1.0}
    return [first, *({"method": method.name, **_final(method)} for method in METHODS)]


def gamma_sweep() -> dict[str, dict[str, Any]]:
    """Yaw by the gain of eq. 14, which is not printed in the paper, with either update."""
    result = {}
    for integrator, gammas, around in (
        ("quaternion-rk4", GAMMAS_RK4, (27.1, 27.3)),
        ("quaternion-euler", GAMMAS_EULER, (0.2, 0.3)),
    ):
        rows = [{"gamma": gamma, **_final(Method("", integrator, gamma))} for gamma in gammas]
        result[integrator] = {"rows": rows, "gamma_of_printed": gamma_of_printed(integrator, *around)}
    return result


def gamma_of_printed(integrator: str, low: float, high: float) -> float:
    """Gain of eq. 14 between two others that gives the printed yaw at 499.9 s, by bisection."""
    for _ in range(20):
        middle = 0.5 * (low + high)
        if _final(Method("", integrator, middle))["yaw_499_9"] < PRINTED["Fossen"]:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def figure_2() -> dict[str, Any]:
    """Yaw of the reference over time, in [0, 2 pi), and the methods' differences from it."""
    time = np.arange(STEPS + 1) * STEP
    reference = exact_yaw(np.arange(STEPS + 1))
    curves = {}
    for method in FIGURE_2:
        simulator = spun(method)
        yaw = np.zeros(STEPS + 1)
        for i in range(1, STEPS + 1):
            simulator.step()
            yaw[i] = yaw_of(simulator)
        curves[method.name] = _wrapped(yaw - reference)
    return {"time": time, "reference": reference, "difference": curves}


def tumbling() -> dict[str, Any]:
    """Attitude error after a tumble about all three axes, by method and step size.

    The reference is MK4 at an eighth of the finest step. Its uncertainty is the difference of RK4 + normalise there.
    """
    scene = load_scene("free-body")
    scene["provenance"] = {}
    scene["vehicle"]["body"]["inertia"] = list(TUMBLING_INERTIA)

    def attitude(method: Method, step: float) -> Floats:
        simulator = Simulator(scene, dt=step, integrator=method.integrator, gamma=method.gamma, error_estimate=False)
        simulator.set_state(twist=TUMBLING_SPIN)
        simulator.step(substeps=round(TUMBLING_TIME / step))
        quaternion: Floats = simulator.quaternion[0]
        # Unit length: the baseline methods are not charged with a scale error as well.
        return quaternion / np.linalg.norm(quaternion)

    finest = TUMBLING_STEPS[-1] / 8.0
    reference = attitude(TUMBLING_METHODS[0], finest)
    errors = {
        method.name: [_angle_between(attitude(method, step), reference) for step in TUMBLING_STEPS]
        for method in TUMBLING_METHODS
    }
    return {
        "inertia": TUMBLING_INERTIA,
        "angular_velocity": TUMBLING_SPIN[3:],
        "time": TUMBLING_TIME,
        "steps": TUMBLING_STEPS,
        "reference": {
            "method": "MK4",
            "step": finest,
            "uncertainty": _angle_between(attitude(TUMBLING_METHODS[1], finest), reference),
        },
        "errors": errors,
        "orders": {name: convergence_order(TUMBLING_STEPS, values) for name, values in errors.items()},
    }


def _final(method: Method) -> dict[str, float]:
    simulator = spun(method)
    simulator.step(substeps=STEPS - 1)
    before = yaw_of(simulator)
    simulator.step()
    after = yaw_of(simulator)
    return {
        "yaw_499_9": before,
        "yaw_500": after,
        "error_500": float(_wrapped(after - exact_yaw(STEPS))),
        "quaternion_length": float(np.linalg.norm(simulator.quaternion[0])),
    }


def _wrapped(angle: Any) -> Any:
    return np.mod(angle + math.pi, 2.0 * math.pi) - math.pi


def _angle_between(a: Floats, b: Floats) -> float:
    """Angle between two unit quaternions, accurate for small ones too."""
    return 4.0 * math.asin(min(1.0, 0.5 * min(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b)))))
