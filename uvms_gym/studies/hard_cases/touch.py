"""Cases of contact: spheres on a body that bounce, graze, jam, rest and slide."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from uvms_gym.studies.hard_cases.case import Case, Quantities, converged, instants, motion, motion_case
from uvms_gym.studies.hard_cases.scenes import GRAVITY, Scene, neutral, single_body
from uvms_gym.studies.numerics import Floats

_RADIUS = 0.1
#: Steps of a contact of 100 rad/s.
_STEPS = {1: 0.00025}


def _law(stiffness: float, dissipation: float, friction: float = 0.0) -> Scene:
    return {"stiffness": stiffness, "dissipation": dissipation, "ramp": 0.002, "friction": friction, "slip_speed": 0.02}


def _touching(
    scene: Scene, law: Scene, shapes: Sequence[Scene], centers: Sequence[Sequence[float]] = ((0, 0, 0),)
) -> Scene:
    """The scene with spheres on its body and shapes in the world."""
    spheres: list[Scene] = [
        {"name": f"sphere {k}", "on": "vehicle", "position": [float(x) for x in center], "radius": _RADIUS}
        for k, center in enumerate(centers)
    ]
    return scene | {"contact": law | {"spheres": spheres, "shapes": list(shapes)}}


def _plane(name: str, position: Sequence[float] = (0.0, 0.0, 0.0), rpy: Sequence[float] = (0.0, 0.0, 0.0)) -> Scene:
    return {"name": name, "kind": "plane", "frame": {"position": list(position), "rpy": list(rpy)}}


def _converged_case(
    name: str, description: str, scene: Scene, times: Floats, start: dict[str, Any], steps: dict[int, float] = _STEPS
) -> Case:
    run = motion(scene, times, ["position", "velocity", "rate"], start)
    return Case(name, description, run, cache(lambda: converged(run, 1e-5)), steps, float(times[0]))


def _resting_depth(load: float, law: Scene) -> float:
    return load / float(law["stiffness"]) + 0.5 * float(law["ramp"])


def _rest() -> Case:
    """A body that rests on a floor without friction and drifts along it: k (x - e/2) = m g."""
    law, velocity = _law(20000.0, 2.0), np.array([0.2, 0.1, 0.0])
    ball = single_body("ball at rest", {"mass": 5.0, "inertia": [0.02] * 3}, gravity=GRAVITY)
    scene = _touching(ball, law, [_plane("floor")])
    start = np.array([0.0, 0.0, _RADIUS - _resting_depth(5.0 * GRAVITY, law)])

    def reference(times: Floats) -> Quantities:
        return {"position": start + np.outer(times, velocity), "velocity": np.tile(velocity, (len(times), 1))}

    return motion_case(
        "body that rests on a floor",
        "5 kg on a contact of 63 rad/s, 1000 s, with a drift along the floor: place and velocity",
        scene,
        instants(100.0, 10),
        reference,
        {1: 0.01},
        {"position": start, "twist": [*velocity, 0.0, 0.0, 0.0]},
    )


def _far() -> Case:
    """The bounce far from the origin, where single precision rounds places to 0.1 mm."""
    law = _law(5000.0, 2.0)
    floor = [1000.0, -2000.0, -500.0]
    ball = single_body("far ball", {"mass": 0.5, "inertia": [0.002] * 3}, gravity=GRAVITY)
    scene = _touching(ball, law, [_plane("floor", floor)])
    start = {"position": [floor[0], floor[1], floor[2] + _RADIUS + 0.005], "twist": [0.1, 0.0, -0.2, 0.0, 0.0, 0.0]}
    run = motion(scene, instants(0.1, 3), ["velocity"], start)
    return Case(
        "bounce far from the origin",
        "0.5 kg hits a floor 2.3 km away: velocity",
        run,
        cache(lambda: converged(run, 2e-5)),
        _STEPS,
        0.1,
        bounds={"float32": 0.05},
        reason="a coordinate of 2 km has 0.1 mm in float32, a tenth of the penetration",
    )


CASES = (
    _converged_case(
        "ball on a stiff floor",
        "1 kg falls from 5 cm on a contact of 316 rad/s in air, and bounces: place, velocity and spin",
        _touching(
            single_body("stiff ball", {"mass": 1.0, "inertia": [0.004] * 3}, gravity=GRAVITY),
            _law(1e5, 0.3, 0.3),
            [_plane("floor")],
        ),
        instants(0.1, 5),
        {"position": [0.0, 0.0, _RADIUS + 0.05], "twist": [0.2, 0.1, 0.0, 0.0, 3.0, 0.0]},
        {1: 5e-5},
    ),
    _converged_case(
        "ball that grazes an edge",
        "2 kg passes the edge of a box at 1 m/s with 0.3 mm of overlap: place, velocity and spin",
        _touching(
            single_body("grazing ball", {"mass": 2.0, "inertia": [0.008] * 3}),
            _law(20000.0, 1.0, 0.4),
            [{"name": "box", "kind": "box", "size": [0.2, 0.4, 0.2]}],
        ),
        instants(0.1, 6),
        {"position": [-0.3, 0.0, 0.1 + _RADIUS - 0.0003], "twist": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]},
    ),
    _converged_case(
        "body that wedges itself",
        "a neutral body of two spheres driven into a groove of 30 degrees: place, velocity and spin",
        _touching(
            single_body("wedge", neutral(8.0, 0.2), density=1000.0, gravity=GRAVITY),
            _law(10000.0, 2.0, 0.4),
            [_plane("left", rpy=(0.0, 1.309, 0.0)), _plane("right", rpy=(0.0, -1.309, 0.0))],
            ((-0.05, -0.2, 0.0), (0.05, 0.2, 0.05)),
        ),
        instants(0.1, 8),
        {"position": [0.01, 0.0, 0.45], "twist": [0.0, 0.0, -0.3, 0.1, 0.0, 0.2]},
    ),
    _far(),
    _rest(),
)
