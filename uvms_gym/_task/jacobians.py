"""Derivatives of a control period without the physics."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym._core import Task

Floats = NDArray[np.float64]
#: Change of an entry of an observation, by which base controllers are differentiated.
CHANGE = 1e-3


def base_actions(task: Task, observations: NDArray[np.float32]) -> NDArray[np.float32]:
    """Actions (k, a) of the controller that residual actions correct, on observations (k, d)."""
    if task.base is None:
        raise ValueError("actions are no corrections to a controller")
    return task.base.act(observations, np.empty((len(observations), 0)))[0]


def base_vjp(task: Task, observations: NDArray[np.float32], cotangents: Floats) -> Floats:
    """Products (k, d) of cotangents (k, a) with its derivatives by observations (k, d), by central differences."""
    (k, d), changes = observations.shape, CHANGE * np.eye(observations.shape[1], dtype=np.float32)[:, None]
    up, down = (base_actions(task, (observations + by).reshape(-1, d)) for by in (changes, -changes))
    difference = (up - down).reshape(d, k, -1) / (2.0 * CHANGE)
    return np.einsum("dka,ka->kd", difference, cotangents)  # type: ignore[no-any-return]


def period_jacobians(
    task: Task, actions: NDArray[np.float32], base: NDArray[np.float32] | None
) -> dict[str, dict[str, Floats]]:
    """Jacobians of the coming control period, by output and input: see `TaskVectorEnv.jacobians`.

    `base` (N, a) are the actions of the base controller of residual actions.
    """
    n, (s, w, c, d, a, f) = task.num_envs, task.gradient_widths
    arguments, keywords = task.__getnewargs_ex__()
    after = Task(*arguments, **{**keywords, "autoreset": "disabled", "max_episode_steps": None})
    after.__setstate__(task.__getstate__())
    flags, info = np.empty((2, n), np.bool_), np.empty((len(task.metric_names), n))
    after.step(actions, (np.empty((n, d), np.float32), np.empty(n), flags[0], flags[1], info))
    (_, before), (states, memories) = task.frames(), after.frames()

    def spread(outputs: int, *frames: NDArray[np.float32] | None) -> list[Any]:
        """Rows of frames, one for each unit cotangent, and these cotangents."""
        rows = [None if frame is None else np.repeat(frame, outputs, axis=0) for frame in frames]
        return [*rows, np.tile(np.eye(outputs), (n, 1))]

    rows, given, corrected, units = spread(f + c, before, actions, base)
    act = task.act_vjp(rows, given, units, corrected).reshape(n, f + c, 2 * a + c)
    ends, rows, starts, units = spread(d + 1 + w + c, states[:, : s + 6], memories, before)
    fresh = (rows[:, -1] < 0.5).tolist() if task.late else [True] * len(units)
    evaluate = task.evaluate_vjp(ends, rows, starts, fresh, units).reshape(n, d + 1 + w + c, -1)

    def by_inputs(part: Floats) -> dict[str, Floats]:
        """Columns of action, base and memory."""
        found = {"action": part[..., :a], "memory": part[..., 2 * a :]}
        return found if base is None else {**found, "base": part[..., a : 2 * a]}

    result = {"force": by_inputs(act[:, :f])}
    parts = np.split(evaluate, np.cumsum([d, 1, w]), axis=1)
    for name, part in zip(("observation", "reward", "measurement", "memory"), parts, strict=True):
        by_state, by_measurement, by_memory = np.split(part, [s, s + w], axis=2)
        result[name] = {"state": by_state, "measurement": by_measurement, **by_inputs(by_memory @ act[:, f:])}
    return result
