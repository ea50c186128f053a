"""Small numerical helpers that several studies share."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def convergence_order(steps: Sequence[float], errors: Sequence[float]) -> float:
    """Order of convergence: slope of log error over log step, by least squares."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def hermite_cubic(start: tuple[Floats, Floats], end: tuple[Floats, Floats], length: float) -> Floats:
    """Coefficients (..., 4) of the cubics with given values and rates (...) at both ends of an interval."""
    (a, da), (b, db) = start, end
    quadratic = (3.0 * (b - a) / length - 2.0 * da - db) / length
    return np.stack([a, da, quadratic, (2.0 * (a - b) / length + da + db) / length**2], axis=-1)


def median_and_worst(values: Floats) -> dict[str, float]:
    """Median and maximum of an ensemble (N,)."""
    return {"median": float(np.median(values)), "worst": float(values.max())}


def rotation_distance(a: Floats, b: Floats) -> Floats:
    """Angles (...) between rotation matrices (..., 3, 3), rad, accurate for small ones."""
    # |A - B| = 2 sqrt(2) sin(angle / 2)
    chord = np.linalg.norm(a - b, axis=(-2, -1)) / math.sqrt(8.0)
    return np.asarray(2.0 * np.arcsin(np.minimum(chord, 1.0)))


def loglog_interpolation(x: ArrayLike, y: ArrayLike, at: float) -> float:
    """Value at `at` of the piecewise line through log y over log x (ascending), extended at its ends."""
    u, v = np.log(np.asarray(x, dtype=np.float64)), np.log(np.asarray(y, dtype=np.float64))
    k = int(np.clip(np.searchsorted(u, np.log(at)), 1, len(u) - 1))
    slope = (v[k] - v[k - 1]) / (u[k] - u[k - 1])
    return float(np.exp(v[k] + slope * (np.log(at) - u[k])))


def bodies(scene: dict[str, Any]) -> list[dict[str, Any]]:
    """All bodies of a scene as `load_scene` gives it: vehicle, arm base, links, payload."""
    arm = scene.get("arm") or {}
    found = [scene["vehicle"]["body"], arm.get("base"), *(link["body"] for link in arm.get("links", []))]
    return [body for body in [*found, (scene.get("payload") or {}).get("body")] if body]


def joints(scene: dict[str, Any]) -> list[dict[str, Any]]:
    """All joints of a scene as `load_scene` gives it, in the order of every joint array."""
    arm = scene.get("arm") or {}
    mount = [arm["mount"]["joint"]] if arm.get("mount", {}).get("joint") else []
    return mount + [link["joint"] for link in arm.get("links", [])]
