"""Driven vehicle: what fits to synthetic logs with thruster commands, lags and a current give back."""

from typing import Any

import numpy as np

from uvms_gym import load_scene
from uvms_gym.identification import Fit, fit
from uvms_gym.identification.parameters import apply, make_parameters
from uvms_gym.studies.identification.synthetic import Sensors, synthetic_log

#: Free numbers.
FREE = (
    "vehicle.body.damping.linear",
    "vehicle.body.damping.quadratic",
    "vehicle.body.added_mass[0:3]",
    "vehicle.body.rotational_inertia",
    "vehicle.thrusters.lag",
    "map.thrusters.time.lag",
)
#: Interval between compared samples, s.
PERIOD = 0.05


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

    Parameters
    ----------
    scene : str
        Scene to start from; the truth differs by 0.3 in logarithms, and by 0.03 s in the lag of stamps.
    trials : int
        Number of trials.
    duration : float
        Length of a trial, s.
    thruster_lag : float
        Time constant of the thrusters to start from, s.
    current : float
        Speed of the current, m/s.
    seed : int
        Seed of truth, motion and noise.
    """
    start: dict[str, Any] = load_scene(scene)
    for thruster in start["vehicle"]["thrusters"]:
        thruster |= {"map": "t200", "lag": thruster_lag}
    start = load_scene(start)
    parameters = make_parameters(start, FREE)
    rng = np.random.default_rng(seed)
    spread = np.array([0.3 if p.logarithmic else 0.03 for p in parameters])
    x = np.array([p.origin for p in parameters]) + spread * rng.normal(size=len(spread))
    truth, corrections = apply(
        start, parameters, x, [], [thruster["name"] for thruster in start["vehicle"]["thrusters"]]
    )
    truth = load_scene(truth | {"provenance": {}})
    sensors = Sensors(thruster_lag=corrections.lags["thrusters"])
    names = [f"{k}" for k in range(trials)]
    logs = [synthetic_log(truth, n, duration, rng, sensors=sensors, driven=True, current=current) for n in names]
    found = fit(start, logs, FREE, balance=False, period=PERIOD)
    return found, {p.key: p.value(v) for p, v in zip(parameters, x.tolist())}
