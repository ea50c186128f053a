"""Learned corrections to a controller."""

from typing import Any

from uvms_gym.controllers.base import Controller
from uvms_gym.controllers.mlp import MLP


class Residual(Controller):
    """A base controller and a residual policy that corrects it. [Sil18]

    The network reads the observation and then the controller's action; the action is
    `clip(base + limit * clip(network))`, each clip to [-1, 1].

    Parameters
    ----------
    base : Controller
        Base controller.
    correction : MLP
        Residual policy (`residual=True`): it reads d + a entries and gives a.
    limit : float
        Greatest correction of an entry of the action, in [0, 1].

    Raises
    ------
    ValueError
        The network reads or gives other entries, or the limit is out of range.
    """

    def __init__(self, base: Controller, correction: MLP, limit: float = 0.3) -> None:
        self.base, self.correction, self.limit = base, correction, float(limit)
        self.native = correction.native.correcting(base.native, self.limit)

    def __reduce__(self) -> Any:
        return type(self), (self.base, self.correction, self.limit)
