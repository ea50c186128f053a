"""Weighted mean of controllers."""

from collections.abc import Sequence
from typing import Any

from uvms_gym import _core
from uvms_gym._task.options import native
from uvms_gym.controllers.base import Controller, options_of


class Blend(Controller):
    """A weighted mean of controllers for the same environment.

    Each of them sees every observation; the action is `clip(sum of w_i clip(a_i))`, each clip to [-1, 1]. Errors of
    controllers that are made differently cancel in part. A guard hands over from the first controller to the second
    where the measured pose error of the task is large, such as from a policy, which knows only what it met in its
    training, to a controller with a model: the state's block `handed_over` is the share, 0 to 1.

    Parameters
    ----------
    controllers : sequence of Controller
    weights : sequence of float
        One per controller, each in [0, 1]; their sum is 1.
    guard : (float, float) or None
        Pose errors between which the first weight goes over to the second, m, with 1 rad as 0.5 m.
        None: no guard.
    env, **options
        As in `PD`; of the guard only.

    Raises
    ------
    ValueError
        The controllers read or give other entries, the weights or the guard are out of range, or the observations have
        no pose error.
    """

    def __init__(
        self,
        controllers: Sequence[Controller],
        weights: Sequence[float],
        guard: tuple[float, float] | None = None,
        env: Any = None,
        **options: Any,
    ) -> None:
        if len(controllers) != len(weights):
            raise ValueError(f"{len(controllers)} controllers, but {len(weights)} weights")
        self.controllers, self.weights, self.guard = tuple(controllers), tuple(map(float, weights)), guard
        self._options = {} if guard is None else options_of("Blend", env, options)
        parts = [(part.native, weight) for part, weight in zip(self.controllers, self.weights)]
        self.native = _core.Controller.blend(parts, None if guard is None else (native(self._options), guard))

    def __repr__(self) -> str:
        return f"Blend({list(self.controllers)!r}, weights={list(self.weights)!r}, guard={self.guard!r})"

    def __getstate__(self) -> tuple[Any, ...]:
        return self.controllers, self.weights, self.guard, self._options

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        controllers, weights, guard, options = state
        Blend.__init__(self, controllers, weights, guard, **options)
