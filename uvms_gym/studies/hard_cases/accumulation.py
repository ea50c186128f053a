"""Cases that look harmless step by step: spins, swings and rotors whose small errors add up within seconds."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from uvms_gym.studies.hard_cases.case import Case, Quantities, Reference, instants, motion_case
from uvms_gym.studies.hard_cases.reference_solutions import force_free_reference, inertia_of, precession, solve_twice
from uvms_gym.studies.hard_cases.scenes import DENSITY, GRAVITY, Scene, link, single_body, with_arm
from uvms_gym.studies.hard_cases.spinning import top_case
from uvms_gym.studies.numerics import Floats

INTERVAL = 0.5
Vector = tuple[float, ...]
#: Options of cases whose rounding in float32 adds up, and of those whose warnings set an angle of many turns against
#: a radian.
ROUNDING: dict[str, Any] = {
    "bounds": {"float32": 2e-2},
    "reason": "in float32 the rounding of up to 40 000 steps adds up",
}
TURNS: dict[str, Any] = {"judges_warnings": False, "reason": "warnings set an angle of many turns against a radian"}


def by_order(steps: Vector) -> dict[int, float]:
    """Recommended steps of methods of orders 4, 3 and 2, by order."""
    return dict(zip((4, 3, 2), steps, strict=True))


def every_interval(about: str, seconds: float, observed: str) -> tuple[str, Floats]:
    """Description and instants of a motion of some seconds that is observed every `INTERVAL`."""
    return f"{about}, {seconds:g} s: {observed} every 0.5 s", instants(INTERVAL, round(seconds / INTERVAL))


def _case(
    name: str,
    about: str,
    observed: str,
    scene: Scene,
    seconds: float,
    reference: Callable[[Floats], Reference | Quantities],
    steps: Vector,
    start: Mapping[str, Any],
    **more: Any,
) -> Case:
    description, times = every_interval(about, seconds, observed)
    return motion_case(name, description, scene, times, reference, by_order(steps), start, **more)


def _symmetric(
    name: str, about: str, moments: tuple[float, float], spin: Vector, seconds: float, steps: Vector, **more: Any
) -> Case:
    """Free body with two equal moments, transverse and axial."""
    transverse, axial = moments
    scene = single_body(name, {"mass": 1.0, "inertia": [transverse, transverse, axial]})

    def reference(times: Floats) -> Quantities:
        return precession(transverse, axial, np.array(spin), times)

    start = {"twist": [0.0, 0.0, 0.0, *spin]}
    return _case(name, about, "attitude and rate", scene, seconds, reference, steps, start, **more)


SYMMETRIC = (
    _symmetric(
        "needle", "moments 1e-8 of each other, 10 rad/s", (1.0, 1e-8), (0.2, -0.3, 10.0), 10.0, (0.0025, 0.001, 0.00025)
    ),
    _symmetric(
        "rod", "moments 0.01 of each other, 12 rad/s", (0.5, 0.005), (0.3, 0.1, 12.0), 10.0, (0.002, 0.001, 0.00025)
    ),
    _symmetric("disc", "a disc in a wobble at 10 rad/s", (1.0, 1.98), (0.5, 0.2, 10.0), 10.0, (0.005, 0.0025, 0.002)),
    _symmetric(
        "near ball",
        "moments 1 % apart, 25 rad/s",
        (1.0, 1.01),
        (15.0, -9.0, 18.0),
        20.0,
        (0.01, 0.025, 0.01),
        **ROUNDING,
    ),
)


def _tumble(name: str, about: str, inertia: Vector, spin: Vector, seconds: float, steps: Vector, **more: Any) -> Case:
    """Free body with three moments."""
    description, times = every_interval(about, seconds, "attitude and rate")
    return top_case(name, description, inertia, spin, times, by_order(steps), **more)


TUMBLES = (
    _tumble(
        "plate",
        "a plate tumbles at 6 rad/s",
        (1.0, 1.5, 2.49),
        (2.0, -4.0, 4.0),
        20.0,
        (0.005, 0.001, 0.001),
        **ROUNDING,
    ),
    _tumble(
        "slow tumble", "moments 5 % apart, 0.5 rad/s", (1.0, 1.05, 1.1), (0.3, 0.3, -0.3), 60.0, (0.02, 0.02, 0.02)
    ),
    _tumble("brick", "moments 0.1 % apart, 15 rad/s", (1.0, 1.001, 1.002), (9.0, 8.0, -9.0), 20.0, (0.025, 0.05, 0.05)),
    _tumble(
        "near the middle axis", "5 rad/s, disturbed", (1.0, 1.4, 1.9), (0.05, 5.0, 0.05), 5.0, (0.02, 0.005, 0.005)
    ),
)


def _ideal(name: str, about: str, body: Scene, twist: Vector, steps: Vector, **more: Any) -> Case:
    """Body in ideal water for 10 s: Kirchhoff's equations."""
    scene = single_body(name, body, DENSITY)

    def reference(times: Floats) -> Reference:
        return force_free_reference(inertia_of(body), np.array(twist), times)

    return _case(name, about, "pose and twist", scene, 10.0, reference, steps, {"twist": twist}, **more)


_OFF_CENTRE = np.diag([2.0, 8.0, 8.0, 0.1, 0.8, 0.8])
_OFF_CENTRE[1, 5] = _OFF_CENTRE[5, 1] = 1.0
_OFF_CENTRE[2, 4] = _OFF_CENTRE[4, 2] = -1.0

IDEAL = (
    _ideal(
        "slender body",
        "rolls at 8 rad/s askew to its way",
        {"mass": 5.0, "inertia": [0.1, 0.6, 0.6], "added_mass": [0.5, 5.0, 5.0, 0.0, 0.4, 0.4]},
        (1.0, 0.1, 0.0, 8.0, 0.2, 0),
        (0.0025, 0.0005, 0.0005),
        **ROUNDING,
    ),
    _ideal(
        "flat body",
        "glides and spins at 6 rad/s",
        {"mass": 2.0, "inertia": [0.1, 0.1, 0.2], "added_mass": [0.5, 0.5, 9.0, 0.3, 0.3, 0.0]},
        (0.8, 0.0, 0.1, 0.2, 0.0, 6.0),
        (0.005, 0.002, 0.001),
    ),
    _ideal(
        "added mass off centre",
        "a body turns at 3 rad/s about a point beside it",
        {"mass": 5.0, "inertia": [0.3, 0.6, 0.7], "added_mass": _OFF_CENTRE.tolist()},
        (0.6, 0.2, -0.1, 1.0, 0.5, 3.0),
        (0.01, 0.005, 0.0025),
    ),
)


def _pendulum(
    name: str, about: str, start: tuple[float, float], drag: float, seconds: float, steps: Vector, **more: Any
) -> Case:
    """Pendulum: a link on a fixed vehicle, I q'' = -m g l sin q - d q'."""
    mass, com, central = 2.0, 0.3, 0.05
    body = {"mass": mass, "center_of_mass": [0.0, 0.0, -com], "inertia": [central] * 3}
    scene = single_body(name, {"mass": 1.0, "inertia": [1.0] * 3}, gravity=GRAVITY)
    scene = with_arm(scene, link("link", body, 1, friction={"viscous": drag}), fixed=True)
    inertia = central + mass * com * com

    def rates(_: float, y: Floats) -> list[float]:
        return [y[1], -(mass * GRAVITY * com * np.sin(y[0]) + drag * y[1]) / inertia]

    def reference(times: Floats) -> Reference:
        (q, qd), uncertainty = solve_twice(rates, start, times)
        values = {"q": q[:, None], "q'": qd[:, None]}
        return Reference(values, "equation of the pendulum, by SciPy, two tolerances", uncertainty)

    return _case(name, about, "joint", scene, seconds, reference, steps, {"q": [start[0]], "qd": [start[1]]}, **more)


PENDULUMS = (
    _pendulum(
        "wide swing", "a pendulum from 2.8 rad, undamped", (2.8, 0.0), 0.0, 20.0, (0.0025, 0.0005, 0.0005), **ROUNDING
    ),
    _pendulum("capsized pendulum", "let go at 0.01 rad from the top", (3.1316, 0.0), 0.02, 5.0, (0.01, 0.0025, 0.0025)),
    _pendulum("over the top", "a pendulum that turns over", (0.0, 13.0), 0.0, 10.0, (0.005, 0.001, 0.0025), **TURNS),
    _pendulum("fast pendulum wheel", "a pendulum at 60 rad/s", (0.0, 60.0), 0.0, 10.0, (0.005, 0.0025, 0.005), **TURNS),
    _pendulum("long swing", "a pendulum from 1 rad, little damped", (1.0, 0.0), 0.005, 30.0, (0.005, 0.001, 0.0005)),
)


CASES = (*SYMMETRIC, *TUMBLES, *IDEAL, *PENDULUMS)
