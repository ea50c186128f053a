"""Curves of an episode's errors, in videos and on the page."""

import math
from typing import Any, NamedTuple

import gymnasium


class Curve(NamedTuple):
    """A charted entry of `info`: title, unit, factor to the unit, and colour `#rrggbb`."""

    entry: str
    title: str
    unit: str
    scale: float
    colour: str


#: Errors of all tasks, in readable units.
CURVES = (
    Curve("position_error", "position", "cm", 100.0, "#78eba0"),
    Curve("end_effector_position_error", "end effector", "cm", 100.0, "#ff78d7"),
    Curve("attitude_error", "attitude", "°", 180.0 / math.pi, "#ffcd5a"),
)


def error_curves(env: gymnasium.Env[Any, Any]) -> tuple[Curve, ...]:
    """Curves of a task's errors: one for each quantity that differs from the others."""
    inner: Any = env.unwrapped
    # In tracking all errors are the end effector's; without an arm it is the vehicle.
    tracks, bare = inner.task == "ee-track", "arm" not in inner.snapshot().scene
    same = "position_error" if tracks else "end_effector_position_error" if bare else None
    return tuple(curve for curve in CURVES if curve.entry != same)
