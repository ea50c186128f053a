"""Cases that look harmless step by step: spins, swings and rotors whose small errors add up within seconds."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np

from uvms_gym.studies.hard_cases.case import (
    Case,
    CaseRunner,
    Quantities,
    Reference,
    Scene,
    instants,
    link,
    motion,
    single_body,
    with_arm,
)
from uvms_gym.studies.hard_cases.reference_solutions import Top, force_free_reference, precession, solve_twice
from uvms_gym.studies.hard_cases.secular import GRAVITY
from uvms_gym.studies.hard_cases.spinning import top_case
from uvms_gym.studies.numerics import Floats

INTERVAL = 0.5
Steps = Mapping[int, float]
#: Options of cases whose rounding in float32 adds up, and of those whose warnings set an angle of many turns against
#: a radian.
ROUNDING: dict[str, Any] = {
    "bounds": {"float32": 2e-2},
    "reason": "in float32 the rounding of up to 40 000 steps adds up",
}
TURNS: dict[str, Any] = {"judges_warnings": False, "reason": "warnings set an angle of many turns against a radian"}


def make_case(
    name: str,
    description: str,
    run: Callable[[CaseRunner], Quantities],
    reference: Callable[[], Reference],
    steps: Steps,
    reason: str = "",
    **more: Any,
) -> Case:
    """Make a case that steps of any divisor of `INTERVAL` run."""
    return Case(name, description, run, reference, steps, INTERVAL, reason=reason, **more)


# Free bodies with two equal moments, transverse and axial.


def _symmetric(
    name: str,
    about: str,
    moments: tuple[float, float],
    spin: tuple[float, ...],
    seconds: float,
    steps: Steps,
    **more: Any,
) -> Case:
    (transverse, axial), times = moments, instants(INTERVAL, round(seconds / INTERVAL))
    scene = single_body(name, {"mass": 1.0, "inertia": [transverse, transverse, axial]})
    run = motion(scene, times, ["attitude", "rate"], twist=[0.0, 0.0, 0.0, *spin])

    def reference() -> Reference:
        return Reference(precession(transverse, axial, np.array(spin), times), "closed form")

    return make_case(name, f"{about}, {seconds:g} s: attitude and rate every 0.5 s", run, reference, steps, **more)


SYMMETRIC = (
    _symmetric(
        "needle",
        "moments 1e-8 of each other, 10 rad/s",
        (1.0, 1e-8),
        (0.2, -0.3, 10.0),
        10.0,
        {4: 0.0025, 3: 0.001, 2: 0.00025},
    ),
    _symmetric(
        "rod",
        "moments 0.01 of each other, 12 rad/s",
        (0.5, 0.005),
        (0.3, 0.1, 12.0),
        10.0,
        {4: 0.002, 3: 0.001, 2: 0.00025},
    ),
    _symmetric(
        "disc", "a disc in a wobble at 10 rad/s", (1.0, 1.98), (0.5, 0.2, 10.0), 10.0, {4: 0.005, 3: 0.0025, 2: 0.002}
    ),
    _symmetric(
        "near ball",
        "moments 1 % apart, 25 rad/s",
        (1.0, 1.01),
        (15.0, -9.0, 18.0),
        20.0,
        {4: 0.01, 3: 0.025, 2: 0.01},
        **ROUNDING,
    ),
)


# Free bodies with three moments.


def _tumble(
    name: str,
    about: str,
    inertia: tuple[float, ...],
    spin: tuple[float, ...],
    seconds: float,
    steps: Steps,
    **more: Any,
) -> Case:
    about = f"{about}, {seconds:g} s: attitude and rate every 0.5 s"
    top, times = Top(np.array(inertia), np.array(spin)), instants(INTERVAL, round(seconds / INTERVAL))
    return top_case(name, about, name, top, times, steps=steps, interval=INTERVAL, **more)


TUMBLES = (
    _tumble(
        "plate",
        "a plate tumbles at 6 rad/s",
        (1.0, 1.5, 2.49),
        (2.0, -4.0, 4.0),
        20.0,
        {4: 0.005, 3: 0.001, 2: 0.001},
        **ROUNDING,
    ),
    _tumble(
        "slow tumble", "moments 5 % apart, 0.5 rad/s", (1.0, 1.05, 1.1), (0.3, 0.3, -0.3), 60.0, {4: 0.02, 2: 0.02}
    ),
    _tumble(
        "brick",
        "moments 0.1 % apart, 15 rad/s",
        (1.0, 1.001, 1.002),
        (9.0, 8.0, -9.0),
        20.0,
        {4: 0.025, 3: 0.05, 2: 0.05},
    ),
    _tumble("near the middle axis", "5 rad/s, disturbed", (1.0, 1.4, 1.9), (0.05, 5.0, 0.05), 5.0, {4: 0.02, 2: 0.005}),
)


# Bodies in ideal water: Kirchhoff's equations.


def _ideal(
    name: str, about: str, body: Scene, twist: tuple[float, ...], seconds: float, steps: Steps, **more: Any
) -> Case:
    times = instants(INTERVAL, round(seconds / INTERVAL))
    run = motion(single_body(name, body, 1000.0), times, ["position", "attitude", "twist"], twist=twist)

    @cache
    def reference() -> Reference:
        rigid = np.diag([body["mass"]] * 3 + list(body["inertia"]))
        added = np.array(body["added_mass"])
        inertia = rigid + (np.diag(added) if added.ndim == 1 else added)
        return force_free_reference(inertia, np.array(twist), times)

    about = f"{about}, {seconds:g} s: pose and twist every 0.5 s"
    return make_case(name, about, run, reference, steps, **more)


_OFF_CENTRE = np.diag([2.0, 8.0, 8.0, 0.1, 0.8, 0.8])
_OFF_CENTRE[1, 5] = _OFF_CENTRE[5, 1] = 1.0
_OFF_CENTRE[2, 4] = _OFF_CENTRE[4, 2] = -1.0
_SLENDER = {"mass": 5.0, "inertia": [0.1, 0.6, 0.6], "added_mass": [0.5, 5.0, 5.0, 0.0, 0.4, 0.4]}
_FLAT = {"mass": 2.0, "inertia": [0.1, 0.1, 0.2], "added_mass": [0.5, 0.5, 9.0, 0.3, 0.3, 0.0]}

IDEAL = (
    _ideal(
        "slender body",
        "rolls at 8 rad/s askew to its way",
        _SLENDER,
        (1.0, 0.1, 0.0, 8.0, 0.2, 0),
        10.0,
        {4: 0.0025, 3: 0.0005, 2: 0.0005},
        **ROUNDING,
    ),
    _ideal(
        "flat body",
        "glides and spins at 6 rad/s",
        _FLAT,
        (0.8, 0.0, 0.1, 0.2, 0.0, 6.0),
        10.0,
        {4: 0.005, 3: 0.002, 2: 0.001},
    ),
    _ideal(
        "added mass off centre",
        "a body turns at 3 rad/s about a point beside it",
        {"mass": 5.0, "inertia": [0.3, 0.6, 0.7], "added_mass": _OFF_CENTRE.tolist()},
        (0.6, 0.2, -0.1, 1.0, 0.5, 3.0),
        10.0,
        {4: 0.01, 3: 0.005, 2: 0.0025},
    ),
)


# Pendulums: a link on a fixed vehicle, I q'' = -m g l sin q - d q'.
PENDULUM = {"mass": 2.0, "com": 0.3, "inertia": 0.05}


def _pendulum(
    name: str, about: str, start: tuple[float, float], drag: float, seconds: float, steps: Steps, **more: Any
) -> Case:
    times = instants(INTERVAL, round(seconds / INTERVAL))
    mass, com, central = PENDULUM.values()

    body = {"mass": mass, "center_of_mass": [0.0, 0.0, -com], "inertia": [central] * 3}
    scene = single_body(name, {"mass": 1.0, "inertia": [1.0] * 3}, gravity=[0.0, 0.0, -GRAVITY])
    scene = with_arm(scene, link("link", body, 1, friction={"viscous": drag}), fixed=True)
    run = motion(scene, times, ["q", "q'"], q=[start[0]], qd=[start[1]])

    @cache
    def reference() -> Reference:
        inertia = central + mass * com * com

        def rates(_: float, y: Floats) -> list[float]:
            return [y[1], -(mass * GRAVITY * com * np.sin(y[0]) + drag * y[1]) / inertia]

        (q, qd), uncertainty = solve_twice(rates, start, times)
        values = {"q": q[:, None], "q'": qd[:, None]}
        return Reference(values, "equation of the pendulum, by SciPy, two tolerances", uncertainty)

    return make_case(name, f"{about}, {seconds:g} s: joint every 0.5 s", run, reference, steps, **more)


PENDULUMS = (
    _pendulum(
        "wide swing",
        "a pendulum from 2.8 rad, undamped",
        (2.8, 0.0),
        0.0,
        20.0,
        {4: 0.0025, 3: 0.0005, 2: 0.0005},
        **ROUNDING,
    ),
    _pendulum(
        "capsized pendulum",
        "let go at 0.01 rad from the top",
        (3.1316, 0.0),
        0.02,
        5.0,
        {4: 0.01, 3: 0.0025, 2: 0.0025},
    ),
    _pendulum(
        "over the top", "a pendulum that turns over", (0.0, 13.0), 0.0, 10.0, {4: 0.005, 3: 0.001, 2: 0.0025}, **TURNS
    ),
    _pendulum(
        "fast pendulum wheel",
        "a pendulum at 60 rad/s",
        (0.0, 60.0),
        0.0,
        10.0,
        {4: 0.005, 3: 0.0025, 2: 0.005},
        **TURNS,
    ),
    _pendulum(
        "long swing", "a pendulum from 1 rad, little damped", (1.0, 0.0), 0.005, 30.0, {4: 0.005, 3: 0.001, 2: 0.0005}
    ),
)


CASES = (*SYMMETRIC, *TUMBLES, *IDEAL, *PENDULUMS)
