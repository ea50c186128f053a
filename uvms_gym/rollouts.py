"""Episodes under a controller, run natively: no Python between control periods."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvms_gym._task.base import INFO
from uvms_gym.controllers import Controller
from uvms_gym.envs.base import TaskVectorEnv

Floats = NDArray[np.float64]

#: Control periods of one instance that are run between two looks at signals: a second or so.
_PIECE = 1 << 18


class Tally(NamedTuple):
    """What came of control periods, per instance; those after its episode's end do not count.

    Attributes
    ----------
    steps : numpy.ndarray (N,)
        Control periods that count.
    returns : numpy.ndarray (N,)
        Sum of their rewards.
    terminated, truncated : numpy.ndarray (N,), bool
        Whether the episode ended in them, and how.
    sums, squares : dict of str to numpy.ndarray (N,)
        Sums of every entry of `info` over them, and of its square.
    last : dict of str to numpy.ndarray (N,)
        Every entry of `info` after the last of them; 0 where there are none.
    """

    steps: NDArray[np.uint32]
    returns: Floats
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    sums: dict[str, Floats]
    squares: dict[str, Floats]
    last: dict[str, Floats]


class Rollout:
    """Episodes of all instances of a vector environment under a controller, from where they stand.

    The numbers are those, bit for bit, that stepping the environment with the controller's actions would give. Whatever
    the autoreset mode, an instance whose episode is over waits; `env.reset` starts the next ones.

    Parameters
    ----------
    env : UVMS vector environment
        Reset before the first `run`. Wrappers do not matter.
    controller : uvms_gym.controllers.Controller
        Its memory starts with the rollout.
    trace : sequence of int
        Instances to record, period by period.

    Raises
    ------
    TypeError
        Another kind of environment or controller.
    ValueError
        An instance that there is not; from `run`, a controller for other observations or actions.
    """

    def __init__(self, env: Any, controller: Controller, trace: Sequence[int] = ()) -> None:
        inner = getattr(env, "unwrapped", env)
        if not isinstance(inner, TaskVectorEnv):
            raise TypeError(f"a rollout takes a native UVMS vector environment, not {type(inner).__name__}")
        if not isinstance(controller, Controller):
            raise TypeError(f"a rollout takes a controller of uvms_gym, not {type(controller).__name__}")
        self._env = inner
        self._rollout = inner._native.rollout(controller.native, list(trace))

    def run(self, steps: int, tick: Callable[[int], object] | None = None) -> None:
        """Run so many control periods; `tick` is told after each part how many it had.

        An interrupt (Ctrl-C) stops it between parts. Parts make no difference to the result.
        """
        part = max(1, _PIECE // self._env.num_envs)
        for done in range(0, steps, part):
            now = min(part, steps - done)
            self._env._native.run(self._rollout, now)
            if tick is not None:
                tick(now)

    def take(self) -> Tally:
        """Tell what came of the control periods since the last call, and count anew."""
        rollout = self._rollout
        tally = Tally(
            rollout.steps,
            rollout.returns,
            rollout.terminated,
            rollout.truncated,
            dict(zip(INFO, rollout.sums, strict=True)),
            dict(zip(INFO, rollout.squares, strict=True)),
            dict(zip(INFO, rollout.last, strict=True)),
        )
        rollout.count_anew()
        return tally

    @property
    def traces(self) -> dict[int, dict[str, NDArray[Any]]]:
        """Records of the chosen instances.

        By instance: observations (T, d) that the controller saw, its actions (T, a), the rewards (T,) and measures
        (T, k) that followed.
        """
        traces = self._rollout.traces
        return {trace.pop("instance"): trace for trace in traces}
