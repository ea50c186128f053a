"""Coverage: how often intervals of fits to synthetic logs hold the true values."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from uvms_gym import load_scene
from uvms_gym.identification import fit
from uvms_gym.identification.intervals import UNDETERMINED
from uvms_gym.identification.parameters import apply, make_parameters
from uvms_gym.logs.log import Scene
from uvms_gym.studies.identification.synthetic import Sensors, synthetic_log

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


@dataclass(frozen=True, eq=False)
class Coverage:
    """Outcome of F fits of p parameters.

    Attributes
    ----------
    keys : tuple of str
        Parameters.
    inside : numpy.ndarray (F, p)
        True where the interval holds the truth.
    shares : numpy.ndarray (F, p)
        Variance as a share of the prior's.
    scores : numpy.ndarray (F, p)
        Error in standard deviations.
    """

    keys: tuple[str, ...]
    inside: np.ndarray[Any, np.dtype[np.bool_]]
    shares: np.ndarray[Any, np.dtype[np.float64]]
    scores: np.ndarray[Any, np.dtype[np.float64]]

    @property
    def by_key(self) -> dict[str, float]:
        """Share of fits whose interval holds the truth."""
        return dict(zip(self.keys, self.inside.mean(axis=0).tolist()))

    @property
    def open_by_key(self) -> dict[str, float]:
        """Share of fits that say that the data leave the parameter open."""
        return dict(zip(self.keys, (self.shares > UNDETERMINED).mean(axis=0).tolist()))

    @property
    def overall(self) -> float:
        """Share of all intervals of parameters that the fit calls determined that hold the truth."""
        return float(self.inside[self.shares <= UNDETERMINED].mean())


def coverage(
    fits: int = 200,
    *,
    scene: Scene = "bluerov2-alpha5-pool",
    truth: Mapping[str, float] = TRUTH,
    trials: int = 10,
    duration: float = 15.0,
    seed: int = 0,
    report: Callable[[int], None] | None = None,
) -> Coverage:
    """Fit synthetic logs of random truths, with the noise, rates and lags of the pool data set.

    Parameters
    ----------
    fits : int
        Number of fits, each to logs of its own.
    scene : str, os.PathLike or dict
        Scene to start from.
    truth : mapping of str to float
        Free numbers with the spread of the truth around the scene's values.
    trials : int
        Trials per fit.
    duration : float
        Length of a trial, s.
    seed : int
        Seed of fit i is (seed, i).
    report : callable, optional
        Called after every fit with its number.
    """
    loaded = load_scene(scene)
    joints = [link["name"] for link in loaded["arm"]["links"]]
    lag = Sensors().joint_lag
    # (The map of these logs corrects nothing: a lag of 0 to start from would be far off.)
    data = {"joints": {"time": {"lag": lag}}}
    parameters = make_parameters(loaded, list(truth), data)
    spread = np.array(list(truth.values()))
    inside, shares, scores = [], [], []
    for i in range(fits):
        rng = np.random.default_rng((seed, i))
        x = np.array([p.origin for p in parameters]) + spread * rng.normal(size=len(spread))
        changed, corrections = apply(loaded, parameters, x, joints)
        zeros = corrections.zeros if corrections.zeros is not None else np.zeros(len(joints))
        sensors = Sensors(joint_lag=corrections.lags.get("joints", 0.0), joint_zeros=tuple(zeros.tolist()))
        changed = load_scene(changed | {"provenance": {}})
        logs = [synthetic_log(changed, f"{k}", duration, rng, sensors=sensors) for k in range(trials)]
        found = fit(loaded, logs, list(truth), map_data=data, balance=False)
        u = found.uncertainty
        z = (found.solution.common - x) / u.deviations
        inside.append([low <= p.value(v) <= high for p, v, (low, high) in zip(parameters, x, found.intervals.values())])
        shares.append(u.shares)
        scores.append(z)
        if report is not None:
            report(i + 1)
    return Coverage(tuple(truth), np.array(inside), np.array(shares), np.array(scores))
