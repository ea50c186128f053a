"""Episodes under a controller, run natively: no Python between control periods."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym.controllers import Controller
from uvms_gym.envs.base import TaskVectorEnv
from uvms_gym.envs.navigation import NavigationObservation

Floats = NDArray[np.float64]

#: Control periods of all instances in a part: about a second without a controller.
_PIECE = 1 << 18


@dataclass(frozen=True, eq=False)
class RolloutStats:
    """Statistics of the control periods so far, per instance; those after its episode's end do not count.

    Attributes
    ----------
    steps : numpy.ndarray (N,)
        Number of control periods.
    returns : numpy.ndarray (N,)
        Sum of their rewards.
    terminated : numpy.ndarray (N,), bool
        True where the episode ended for a reason within the task.
    truncated : numpy.ndarray (N,), bool
        True where it ended by its time limit.
    sums : dict of str to numpy.ndarray (N,)
        Sum of every metric in `info` (the names are the environment's `metric_names`).
    squares : dict of str to numpy.ndarray (N,)
        Sum of the square of every metric.
    last : dict of str to numpy.ndarray (N,)
        Every metric after the last control period; 0 without control periods.
    """

    steps: NDArray[np.uint32]
    returns: Floats
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    sums: dict[str, Floats]
    squares: dict[str, Floats]
    last: dict[str, Floats]

    def __repr__(self) -> str:
        n, over = len(self.steps), int(np.count_nonzero(self.terminated | self.truncated))
        return f"RolloutStats({n} instances, {int(self.steps.sum())} control periods, {over} episodes over)"

    def mean(self, name: str) -> Floats:
        """Mean of a metric over each instance's control periods, (N,); 0 without any."""
        return np.asarray(self.sums[name] / np.maximum(self.steps, 1))

    def rms(self, name: str) -> Floats:
        """Root mean square of a metric over each instance's control periods, (N,); 0 without any."""
        return np.sqrt(self.squares[name] / np.maximum(self.steps, 1))


class Rollout:
    """Episodes of all instances of a vector environment under a controller, from their current states.

    The numbers are those of stepping the environment with the controller's actions, bit for bit. In every autoreset
    mode an instance whose episode is over waits; `env.reset` starts the next episodes.

    Parameters
    ----------
    env : UVMS vector environment
        Reset before the first `run`. Wrappers do not matter, except `NavigationObservation`, which is refused.
    controller : uvms_gym.controllers.Controller
        Its memory starts with the rollout.
    trace : sequence of int
        Instances to record, period by period.

    Raises
    ------
    TypeError
        Other kind of environment or controller, or an environment with `NavigationObservation`.
    ValueError
        Instance out of range; from `run`, a controller for other observations or actions.
    """

    def __init__(self, env: Any, controller: Controller, trace: Sequence[int] = ()) -> None:
        inner = getattr(env, "unwrapped", env)
        if not isinstance(inner, TaskVectorEnv):
            raise TypeError(f"a rollout takes a native UVMS vector environment, not {type(inner).__name__}")
        if not isinstance(controller, Controller):
            raise TypeError(f"a rollout takes a controller of uvms_gym, not {type(controller).__name__}")
        wrapper = env
        while wrapper is not inner:
            if isinstance(wrapper, NavigationObservation):
                raise TypeError("a rollout runs without wrappers, but env has NavigationObservation")
            wrapper = wrapper.env
        self._env, self._controller = inner, controller
        self._rollout = inner._native.rollout(controller.native, list(trace))

    def __repr__(self) -> str:
        return f"Rollout({self._env!r}, {self._controller!r})"

    def run(self, steps: int, tick: Callable[[int], object] | None = None) -> None:
        """Run `steps` control periods in parts; `tick` is called after each part with its number of control periods.

        The parts do not change the result. An interrupt (Ctrl-C) ends the run within a tenth of a second; instances
        have then taken some of the control periods, not all equally many: reset them before going on.
        """
        part = max(1, _PIECE // self._env.num_envs)
        for done in range(0, steps, part):
            now = min(part, steps - done)
            self._env._native.run(self._rollout, now)
            if tick is not None:
                tick(now)

    def pop_stats(self) -> RolloutStats:
        """Return the statistics so far and clear them; the controller's memory stays."""
        stats = self._rollout.pop_stats()
        for kind in ("sums", "squares", "last"):
            stats[kind] = dict(zip(self._env.metric_names, stats[kind], strict=True))
        return RolloutStats(**stats)

    @property
    def traces(self) -> dict[int, dict[str, NDArray[Any]]]:
        """Records of the chosen instances.

        By instance: observations (T, d) of the controller, its actions (T, a), and the rewards (T,) and metrics (T, k)
        that followed.
        """
        traces = self._rollout.traces
        return {trace.pop("instance"): trace for trace in traces}
