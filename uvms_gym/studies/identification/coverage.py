"""Fits to synthetic logs against the true values: coverage of their intervals, and a driven vehicle."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from uvms_gym import load_scene
from uvms_gym.identification import Fit, fit
from uvms_gym.identification.intervals import UNDETERMINED
from uvms_gym.identification.parameters import make_parameters
from uvms_gym.logs.log import Scene
from uvms_gym.studies.identification.synthetic import Sensors, draw_truth, synthetic_log
from uvms_gym.studies.progress import tracked

#: Free numbers, and standard deviations by which the truth differs from the scene: of the logarithm for positive ones.
TRUTH: dict[str, float] = {
    "vehicle.body.center_of_buoyancy[0]": 0.003,
    "vehicle.body.center_of_buoyancy[1]": 0.003,
    "vehicle.body.center_of_buoyancy[2]": 0.003,
    "vehicle.body.rotational_inertia[0]": 0.3,
    "vehicle.body.rotational_inertia[1]": 0.3,
    "vehicle.body.damping.linear[3]": 0.7,
    "vehicle.body.damping.linear[4]": 0.7,
    "vehicle.body.damping.quadratic[3]": 0.7,
    "vehicle.body.damping.quadratic[4]": 0.7,
    "arm.links[wrist].body.volume": 0.1,
    "map.joints.axes.shoulder.zero": 0.05,
    "map.joints.axes.upper-arm.zero": 0.05,
    "map.joints.axes.elbow.zero": 0.05,
    "map.joints.axes.wrist.zero": 0.05,
    "map.joints.time.lag": 0.03,
}
#: Free numbers of a driven vehicle.
DRIVEN = (
    "vehicle.body.damping.linear",
    "vehicle.body.damping.quadratic",
    "vehicle.body.added_mass[0:3]",
    "vehicle.body.rotational_inertia",
    "vehicle.thrusters.lag",
    "map.thrusters.time.lag",
)


@dataclass(frozen=True, eq=False)
class Coverage:
    """Outcome of F fits of p parameters."""

    #: Parameters.
    keys: tuple[str, ...]
    #: (F, p) True where the interval contains the truth.
    inside: np.ndarray[Any, np.dtype[np.bool_]]
    #: (F, p) variance as a share of the prior's.
    shares: np.ndarray[Any, np.dtype[np.float64]]
    #: (F, p) error in standard deviations.
    scores: np.ndarray[Any, np.dtype[np.float64]]

    @property
    def by_key(self) -> dict[str, float]:
        """Share of fits whose interval contains the truth."""
        return dict(zip(self.keys, self.inside.mean(axis=0).tolist()))

    @property
    def overall(self) -> float:
        """Share of intervals that contain the truth, of all parameters that the fit calls determined."""
        return float(self.inside[self.shares <= UNDETERMINED].mean())


def coverage(
    fits: int = 200,
    *,
    scene: Scene = "bluerov2-alpha5-pool",
    truth: Mapping[str, float] = TRUTH,
    trials: int = 10,
    duration: float = 15.0,
    seed: int = 0,
) -> Coverage:
    """Fit synthetic logs of random truths, with the noise, rates and lags of the pool data set.

    Every fit has its own logs, with trials of `duration` s; fit i has the seed (`seed`, i). `truth` are the free
    numbers, with the deviation of their true values from the scene's.
    """
    loaded = load_scene(scene)
    # (The map of these logs corrects nothing: a lag of 0 to start from would be far off.)
    data = {"joints": {"time": {"lag": Sensors().joint_lag}}}
    parameters = make_parameters(loaded, list(truth), data)
    inside, shares, scores = [], [], []
    for i in tracked(range(fits), "fits"):
        rng = np.random.default_rng((seed, i))
        changed, sensors, x = draw_truth(loaded, parameters, np.array(list(truth.values())), rng)
        logs = [synthetic_log(changed, f"{k}", duration, rng, sensors=sensors) for k in range(trials)]
        found = fit(loaded, logs, list(truth), map_data=data, balance=False)
        inside.append([low <= p.value(v) <= high for p, v, (low, high) in zip(parameters, x, found.intervals.values())])
        shares.append(found.uncertainty.shares)
        scores.append((found.solution.common - x) / found.uncertainty.deviations)
    return Coverage(tuple(truth), np.array(inside), np.array(shares), np.array(scores))


def driven_fit(
    scene: str = "bluerov2-heavy",
    *,
    trials: int = 8,
    duration: float = 30.0,
    thruster_lag: float = 0.15,
    current: float = 0.15,
    seed: int = 0,
) -> tuple[Fit, dict[str, float]]:
    """Fit a vehicle driven by random commands through the T200 map, and its true values by key.

    True values differ from the scene by 0.3 in logarithms, and by 0.03 s in the lag of stamps. `thruster_lag` is the
    thrusters' time constant at the start, s; `current` the speed of the current, m/s; a trial lasts `duration` s.
    """
    start: dict[str, Any] = load_scene(scene)
    for thruster in start["vehicle"]["thrusters"]:
        thruster |= {"map": "t200", "lag": thruster_lag}
    start = load_scene(start)
    parameters = make_parameters(start, DRIVEN)
    rng = np.random.default_rng(seed)
    truth, sensors, x = draw_truth(start, parameters, np.where([p.logarithmic for p in parameters], 0.3, 0.03), rng)
    names = [f"{k}" for k in range(trials)]
    logs = [synthetic_log(truth, n, duration, rng, sensors=sensors, driven=True, current=current) for n in names]
    found = fit(start, logs, DRIVEN, balance=False, period=0.05)
    return found, {p.key: p.value(v) for p, v in zip(parameters, x.tolist())}
