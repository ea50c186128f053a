"""Small numerical helpers that several studies share."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym._rotations import distances

Floats = NDArray[np.float64]


def convergence_order(steps: Sequence[float], errors: Sequence[float]) -> float:
    """Order of convergence: slope of log error over log step, by least squares."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def median_and_worst(values: Floats) -> dict[str, float]:
    """Median and maximum of an ensemble (N,)."""
    return {"median": float(np.median(values)), "worst": float(values.max())}


def state_errors(run: Any, truth: Any) -> dict[str, Floats]:
    """Errors (...) of a run by quantity, m and rad; infinite where a number is not finite.

    Both have `position` (..., 3), `rotation` (..., 3, 3), `q` (..., n) and `end_effector` (..., 3).
    """
    # A diverging run may overflow.
    with np.errstate(over="ignore", invalid="ignore"):
        errors = {
            "position": np.linalg.norm(run.position - truth.position, axis=-1),
            "attitude": distances(run.rotation, truth.rotation),
            "joints": np.abs(run.q - truth.q).max(axis=-1, initial=0.0),
            "end_effector": np.linalg.norm(run.end_effector - truth.end_effector, axis=-1),
        }
    return {name: np.where(np.isfinite(error), error, np.inf) for name, error in errors.items()}


def loglog_interpolation(x: ArrayLike, y: ArrayLike, at: float) -> float:
    """Value at `at` of the piecewise line through log y over log x (ascending), extended at its ends."""
    u, v = np.log(np.asarray(x, dtype=np.float64)), np.log(np.asarray(y, dtype=np.float64))
    k = int(np.clip(np.searchsorted(u, np.log(at)), 1, len(u) - 1))
    slope = (v[k] - v[k - 1]) / (u[k] - u[k - 1])
    return float(np.exp(v[k] + slope * (np.log(at) - u[k])))
