"""Cases of rotors and swinging arms without a closed form, whose small errors add up within seconds."""

from collections.abc import Mapping
from functools import cache
from typing import Any

from uvms_gym.studies.hard_cases.accumulation import INTERVAL, TURNS, Vector, by_order, every_interval
from uvms_gym.studies.hard_cases.case import Case, converged, motion
from uvms_gym.studies.hard_cases.scenes import GRAVITY, Scene, link, single_body, with_arm

ORIGIN = (0.0, 0.0, 0.0)


def _link(
    name: str, axis: int, mass: float, com: Vector, inertia: Vector, place: Vector = ORIGIN, **joint: Any
) -> Scene:
    return link(name, {"mass": mass, "center_of_mass": list(com), "inertia": list(inertia)}, axis, place, **joint)


def _chain(
    name: str,
    about: str,
    links: list[Scene],
    start: Mapping[str, Any],
    steps: Vector,
    fine: float,
    vehicle: Scene | None = None,
    gravity: float = 0.0,
    **more: Any,
) -> Case:
    """Motion of links for 5 s against a fine run; the vehicle is fixed unless its body is given."""
    description, times = every_interval(about, 5.0, f"joints{'' if vehicle is None else ' and vehicle'}")
    scene = single_body(name, vehicle or {"mass": 1.0, "inertia": [1.0] * 3}, gravity=gravity)
    observed = ["q", "q'"] + ([] if vehicle is None else ["attitude", "rate"])
    run = motion(with_arm(scene, *links, fixed=vehicle is None), times, observed, start)
    return Case(name, description, run, cache(lambda: converged(run, fine)), by_order(steps), INTERVAL, **more)


_LIGHT = {"mass": 0.5, "inertia": [0.004, 0.005, 0.006]}
_PLAIN = (0.001, 0.001, 0.001)
_SPIN = [0.0, 0.0, 0.0, 0.3, -0.2, 0.1]

CASES = (
    _chain(
        "unbalanced rotor",
        "a rotor off balance at 40 rad/s on a light vehicle",
        [_link("rotor", 2, 0.1, (0.02, 0.0, 0.01), (2e-4, 2e-4, 4e-4))],
        {"twist": _SPIN, "qd": [40.0]},
        (0.005, 0.0025, 0.0025),
        2.5e-4,
        _LIGHT,
        **TURNS,
    ),
    _chain(
        "crossed rotors",
        "two rotors at right angles, 30 and 20 rad/s, on a light vehicle",
        [
            _link("first", 2, 0.1, ORIGIN, (4e-4, 4e-4, 6e-4)),
            _link("second", 0, 0.1, (0.0, 0.0, 0.01), (5e-4, 3e-4, 3e-4)),
        ],
        {"twist": _SPIN, "qd": [30.0, 20.0]},
        (0.001, 0.00025, 0.0005),
        2.5e-4,
        _LIGHT,
        **TURNS,
    ),
    _chain(
        "double pendulum",
        "two links from 1.2 and 0.8 rad under gravity",
        [
            _link("upper", 1, 1.0, (0.0, 0.0, -0.15), (0.01, 0.01, 0.01)),
            _link("lower", 1, 0.7, (0.0, 0.0, -0.15), (0.008, 0.008, 0.008), (0.0, 0.0, -0.3)),
        ],
        {"q": [1.2, 0.8]},
        (0.0025, 0.001, 0.001),
        5e-4,
        gravity=GRAVITY,
    ),
    _chain(
        "slider flung out",
        "a turntable at 2 rad/s flings out a slider, e-fold by e-fold",
        [
            _link("table", 2, 5.0, ORIGIN, (0.5, 0.5, 0.8)),
            _link("slider", 0, 0.2, ORIGIN, _PLAIN, kind="prismatic"),
        ],
        {"q": [0.0, 0.001], "qd": [2.0, 0.0]},
        (0.025, 0.01, 0.01),
        1e-3,
    ),
    _chain(
        "top in gimbals",
        "a top at 50 rad/s in two gimbals under gravity",
        [
            _link("outer", 2, 0.1, ORIGIN, _PLAIN),
            _link("inner", 1, 0.1, ORIGIN, _PLAIN),
            _link("top", 2, 0.5, (0.0, 0.0, 0.1), (0.003, 0.003, 0.004)),
        ],
        {"q": [0.0, 0.6, 0.0], "qd": [0.0, 0.0, 50.0]},
        (0.0025, 0.001, 0.001),
        5e-4,
        gravity=GRAVITY,
        **TURNS,
    ),
    _chain(
        "whip on a light vehicle",
        "two links swing without damping on a light vehicle",
        [
            _link("upper", 1, 0.3, (0.15, 0.0, 0.0), (0.001, 0.003, 0.003), (0.1, 0.0, 0.0)),
            _link("lower", 2, 0.2, (0.1, 0.0, 0.0), (0.0005, 0.001, 0.001), (0.3, 0.0, 0.0)),
        ],
        {"q": [0.3, 0.9], "qd": [2.0, -3.0], "twist": _SPIN},
        (0.01, 0.005, 0.005),
        1e-3,
        {"mass": 1.0, "inertia": [0.02, 0.03, 0.03]},
    ),
)
