"""Checks of the arguments of `step` and `reset`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym._task.options import as_json

Actions = NDArray[np.float32]

#: Options of `reset`: parts of an episode's start that are drawn otherwise.
RESET_OPTIONS = (
    "position",
    "attitude",
    "twist",
    "q",
    "qd",
    "target_position",
    "target_attitude",
    "current",
    "disturbance",
)

_FLOAT32 = np.dtype(np.float32)


def refuse_masked(name: str, given: Any) -> None:
    """Refuse an array with masked entries, whose numbers mean nothing."""
    if type(given) is not np.ndarray and np.ma.is_masked(given):
        raise ValueError(f"{name} has masked entries: fill them, or leave them out")


def as_actions(given: ArrayLike, shape: tuple[int, ...]) -> Actions:
    """Actions as float32, clipped where float32 overflows; refuses other shapes and types.

    The native module refuses entries that are not finite.
    """
    if type(given) is np.ndarray and given.dtype is _FLOAT32 and given.shape == shape:
        return given
    refuse_masked("action", given)
    try:
        array = np.asarray(given)
    except ValueError:
        raise ValueError(f"action must be an array of shape {shape}, but its rows differ in length") from None
    if array.dtype.kind not in "fiu":
        raise ValueError(f"action must be an array of real numbers of shape {shape}, not of dtype {array.dtype}")
    if array.shape != shape:
        raise ValueError(f"action has shape {array.shape}, but must have {shape}")
    if array.dtype != np.float32:
        array = np.where(np.isfinite(array), np.clip(array, -1.0, 1.0), array)
    return array.astype(np.float32, copy=False)


def starts(options: Mapping[str, Any] | None, *extra: str) -> dict[str, Any]:
    """Reset options without those that are None; refuses unknown names."""
    if not isinstance(options, Mapping | None):
        raise TypeError(f"options must be a dict or None, not {type(options).__name__}")
    known = (*RESET_OPTIONS, *extra)
    for name in options or {}:
        if name not in known:
            raise ValueError(f"unknown reset option {name!r}; known: {', '.join(known)}")
    given = {name: value for name, value in (options or {}).items() if value is not None}
    if (one := given.get("disturbance")) is not None:
        # A list has one per instance.
        several = isinstance(one, list | tuple)
        given["disturbance"] = (
            [as_json("disturbance", each) for each in one] if several else as_json("disturbance", one)
        )
    return given
