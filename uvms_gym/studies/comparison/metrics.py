"""Measures of episodes, from the statistics of a rollout."""

from collections.abc import Callable, Mapping
from operator import methodcaller
from typing import Any, NamedTuple

import numpy as np

from uvms_gym import ATTITUDE_LEVER
from uvms_gym.rollouts import RolloutStats
from uvms_gym.studies.numerics import Floats

#: Parts of an episode: all of it, and the rest after the first `SETTLED` seconds.
PARTS, SETTLED = ("whole", "settled"), 3.0


def pose_rms(stats: RolloutStats, task: str = "station-keep") -> Floats:
    """Root mean squares (N,) of the pose error sqrt(position^2 + (lever * attitude)^2), m.

    The error is the vehicle's, or the end effector's where `task` is "ee-track".
    """
    part = "end_effector_" if task == "ee-track" else ""
    position, attitude = (stats.squares[f"{part}{name}_error"] for name in ("position", "attitude"))
    return np.sqrt((position + ATTITUDE_LEVER**2 * attitude) / np.maximum(stats.steps, 1))


class Metric(NamedTuple):
    """A measure of an episode.

    Attributes
    ----------
    title, unit : str
        For tables and pictures, after `scale`.
    measure : callable
        Measure per episode (N,), in SI units, from the statistics of its steps.
    scale : float
        Factor from SI to the unit.
    error : bool
        True for errors: root mean squares over the steps.
    less_is_better : bool
        True where less is better.
    cut : float
        Share of episodes that the mean leaves out at either end.
    whole_episode : bool
        True if defined for whole episodes only.
    """

    title: str
    unit: str
    measure: Callable[[RolloutStats], Floats]
    scale: float = 1.0
    error: bool = False
    less_is_better: bool = True
    cut: float = 0.25
    whole_episode: bool = False

    @property
    def label(self) -> str:
        """Title with unit."""
        return f"{self.title}, {self.unit}" if self.unit else self.title

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of an episode with this measure."""
        return PARTS[:1] if self.whole_episode else PARTS


METRICS: dict[str, Metric] = {
    "pose": Metric("pose", "mm", pose_rms, 1e3, error=True),
    "position": Metric("position", "mm", methodcaller("rms", "position_error"), 1e3, error=True),
    "attitude": Metric("attitude", "mrad", methodcaller("rms", "attitude_error"), 1e3, error=True),
    "end_effector": Metric("end effector", "mm", methodcaller("rms", "end_effector_position_error"), 1e3, error=True),
    "power": Metric("power", "%", methodcaller("mean", "power"), 1e2),
    "saturation": Metric("saturation", "%", methodcaller("mean", "saturation"), 1e2),
    "variation": Metric("variation", "1e-3", methodcaller("mean", "action_rate"), 1e3),
    "recovery": Metric("recovery", "s", lambda stats: stats.last["recovery_time"], whole_episode=True),
    "within": Metric("in tolerance", "% of time", methodcaller("mean", "success"), 1e2, less_is_better=False),
    "success": Metric(
        "success", "%", lambda stats: stats.last["success"], 1e2, less_is_better=False, cut=0.0, whole_episode=True
    ),
    "diverged": Metric(
        "diverged", "%", lambda stats: stats.terminated.astype(np.float64), 1e2, cut=0.0, whole_episode=True
    ),
}
#: Metric of the ranking, and its scores.
HEADLINE, RANKED = "pose", "pose/whole"


def by_metric(entries: Mapping[str, Any]) -> dict[str, Any]:
    """Entries by metric and part, from entries by "metric/part"."""
    found: dict[str, Any] = {}
    for key, entry in entries.items():
        metric, part = key.split("/")
        found.setdefault(metric, {})[part] = entry
    return found
