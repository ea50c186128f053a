"""Navigation filter: consistency on simulated sensors, its errors beside raw measurements, and controllers on it."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym import NavigationFilter, Sensors, Simulator, _rotations, make_controller
from uvms_gym.envs import NavigationObservation, StationKeepVectorEnv

Floats = NDArray[np.float64]

#: Sensors as the filter assumes them: without outliers.
IDEAL: dict[str, Any] = {"imu": True, "dvl": True, "depth": True, "heading": True, "acoustic": {"outliers": 0.0}}
#: Standard deviations of the first estimate: m, rad, m/s.
DEVIATIONS = (0.3, 0.03, 0.05)
#: Control period of the runs, s.
PERIOD = 0.02
#: Amplitudes of the wrench, N and N m, and its angular frequency, rad/s: long waves.
AMPLITUDES, FREQUENCY = (30.0, 30.0, 20.0, 0.8, 0.8, 5.0), 1.2


@dataclass(frozen=True, eq=False)
class Run:
    """Runs of a filter.

    Attributes
    ----------
    nis : dict of tuple of numpy.ndarray (T, N)
        By sensor the normalised innovations squared, NaN without a reading, and their degrees of freedom.
    errors : numpy.ndarray (S, N, 12)
        Errors of pose and twist in body axes, once per second.
    covariances : numpy.ndarray (S, N, 12, 12)
        Their covariances.
    raw : numpy.ndarray (S, N, 2)
        Errors of the last fix against the present position, m, and of the last heading, rad.
    update_time : float
        Mean time of an update of one instance, s.
    """

    nis: dict[str, tuple[Floats, NDArray[np.uint64]]]
    errors: Floats
    covariances: Floats
    raw: Floats
    update_time: float

    def mean_nis(self, name: str) -> tuple[float, float]:
        """Mean NIS of a sensor per degree of freedom, and half of the 95 % band around 1."""
        nis, degrees = self.nis[name]
        count = int(degrees[np.isfinite(nis)].sum())
        return float(np.nansum(nis) / count), 1.96 * math.sqrt(2.0 / count)

    def nees(self, width: int = 9) -> Floats:
        """Mean normalised error squared (S,) of the first errors, per degree of freedom."""
        errors, covariances = self.errors[..., :width], self.covariances[..., :width, :width]
        weighted = np.linalg.solve(covariances, errors[..., None])[..., 0]
        return np.asarray(np.einsum("sni,sni->sn", errors, weighted).mean(axis=1) / width)


def errors(sim: Simulator, navigation: NavigationFilter) -> Floats:
    """Errors (N, 12) of pose, (R^T (r_true - r), log(R^T R_true)), and twist, in body axes."""
    estimated = navigation.rotation
    shift = np.einsum("nji,nj->ni", estimated, sim.position - navigation.position)
    turn = _rotations.logarithm(np.swapaxes(estimated, 1, 2) @ sim.rotation)
    return np.concatenate([shift, turn, sim.twist - navigation.twist], axis=1)


def run(
    seconds: float = 20.0,
    suite: Mapping[str, Any] = IDEAL,
    n: int = 256,
    *,
    seed: int = 0,
    yaw: float = 0.0,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    failures: Mapping[str, tuple[float, float]] | None = None,
    deviations: tuple[float, float, float] = DEVIATIONS,
    stated: tuple[float, float, float] | None = None,
) -> Run:
    """Run filters on vehicles that a wrench moves like long waves.

    Parameters
    ----------
    seconds : float
        Duration.
    suite : dict
        Sensors.
    n : int
        Number of vehicles, each with motion, noise and start of its own.
    seed : int
        Seed of all draws.
    yaw, offset : float, tuple of float
        Heading (rad) and position (m) of the whole scene in the world.
    failures : dict of tuple of float
        By sensor the times, s, at which it fails and works again.
    deviations : tuple of float
        Standard deviations of the first estimate: m, rad, m/s.
    stated : tuple of float or None
        Those that the filter assumes; None: the same.

    Returns
    -------
    Run
    """
    sim, rng = Simulator("bluerov2-heavy", n, error_estimate=False), np.random.default_rng(seed)
    turn = _rotations.about([0.0, 0.0, 1.0], yaw)
    home = np.concatenate([rng.uniform(-2.0, 2.0, (n, 2)), rng.uniform(-6.0, -4.0, (n, 1))], axis=1)
    attitude, twist = _rotations.exponential(0.2 * rng.normal(size=(n, 3))), 0.2 * rng.normal(size=(n, 6))
    sim.set_state(position=home @ turn.T + offset, rotation=turn @ attitude, twist=twist)
    sensors = Sensors(sim, suite, seed=seed)
    navigation = NavigationFilter(sensors.suite, n)
    first = [deviation * rng.normal(size=(n, 3)) for deviation in deviations]
    navigation.reset(
        sim,
        position=sim.position + np.einsum("nij,nj->ni", sim.rotation, first[0]),
        rotation=sim.rotation @ _rotations.exponential(first[1]),
        twist=sim.twist + np.concatenate([first[2], np.zeros((n, 3))], axis=1),
        deviations=stated or deviations,
    )
    phases, heights = rng.uniform(0.0, 2.0 * np.pi, (n, 6)), rng.uniform(0.5, 1.0, (n, 6)) * AMPLITUDES
    nis: dict[str, list[tuple[Floats, NDArray[np.uint64]]]] = {}
    rows: list[tuple[Floats, Floats, Floats]] = []
    fix, heading, spent, steps = np.full((n, 3), np.nan), np.full(n, np.nan), 0.0, round(seconds / PERIOD)
    for k in range(steps + 1):
        if k:
            sim.step(wrench=heights * np.sin(phases + FREQUENCY * k * PERIOD), substeps=2)
        for name, times in (failures or {}).items():
            for at, failed in zip(times, (True, False), strict=True):
                if k == round(at / PERIOD):
                    sensors.fail(name, failed)
        readings = sensors.measure(sim)
        start = time.perf_counter()
        navigation.update(readings)
        spent += time.perf_counter() - start
        for name, found in navigation.innovations().items():
            nis.setdefault(name, []).append((found["nis"], found["degrees"]))
        if "acoustic" in readings:
            fix = np.where(readings["acoustic"]["valid"][:, None], readings["acoustic"]["position"], fix)
        if "heading" in readings:
            heading = np.where(readings["heading"]["valid"], readings["heading"]["heading"][:, 0], heading)
        if k % round(1.0 / PERIOD) == 0:
            axis = sim.rotation[:, :, 0]
            apart = heading - np.arctan2(axis[:, 1], axis[:, 0])
            raw = np.stack([np.linalg.norm(fix - sim.position, axis=1), np.arctan2(np.sin(apart), np.cos(apart))], 1)
            rows.append((errors(sim, navigation), navigation.covariance, raw))
    apart_by_second, covariances, raw_errors = (np.stack(part) for part in zip(*rows, strict=True))
    by_sensor = {name: (np.stack([a for a, _ in rows]), np.stack([b for _, b in rows])) for name, rows in nis.items()}
    return Run(by_sensor, apart_by_second, covariances, raw_errors, spent / ((steps + 1) * n))


def consistency(groups: int = 16, seed: int = 1000) -> dict[str, Any]:
    """NIS, NEES and errors of groups of 256 runs, with their 95 % bands.

    Returns
    -------
    dict
        "nis": by sensor the mean per degree of freedom of each group, and half of the band. "nees": by group the mean
        of pose and twist per degree of freedom at the seconds in "time", and half of the band. "rms": position (mm)
        and attitude (degrees) of the filter beside the last fix and the last heading, from half of the time on.
        "update_time": us per instance.
    """
    runs = [run(seed=seed + 300 * k) for k in range(groups)]
    n = runs[0].errors.shape[1]
    nis = {}
    for name in runs[0].nis:
        means, bands = zip(*(one.mean_nis(name) for one in runs), strict=True)
        nis[name] = {"mean": means, "band": bands}

    def rms(values: Floats) -> float:
        return float(np.sqrt(np.mean(values**2)))

    late = slice(len(runs[0].errors) // 2, None)
    all_errors = np.concatenate([one.errors[late] for one in runs], axis=1)
    raw = np.concatenate([one.raw[late] for one in runs], axis=1)
    size = np.linalg.norm(all_errors.reshape(*all_errors.shape[:2], 4, 3), axis=3)
    return {
        "runs": n,
        "nis": nis,
        "nees": {
            "time": np.arange(1, len(runs[0].errors)),
            "mean": [one.nees(12)[1:] for one in runs],
            "band": 1.96 * math.sqrt(2.0 / (12 * n)),
        },
        "rms": {
            "position_mm": 1e3 * rms(size[..., 0]),
            "fix_mm": 1e3 * rms(raw[..., 0]),
            "attitude_deg": math.degrees(rms(size[..., 1])),
            "heading_deg": math.degrees(rms(raw[..., 1])),
            "velocity_mm_s": 1e3 * rms(size[..., 2]),
            "angular_velocity_deg_s": math.degrees(rms(size[..., 3])),
        },
        "update_time": 1e6 * float(np.median([one.update_time for one in runs])),
    }


#: Short-range fixes with the noise and the delay of the storm's pose, half as often.
CLOSE: dict[str, Any] = {
    "imu": True,
    "dvl": True,
    "depth": True,
    "heading": True,
    "acoustic": {"rate": 5.0, "delay": 0.1, "noise": 0.005, "vertical_noise": 0.005},
}
#: Measurements of the controllers: disturbance, sensors and deviations of the first estimate.
MEASUREMENTS: dict[str, tuple[Any, Any, tuple[float, float, float]]] = {
    "true state": ({"base": "storm", "noise": None, "delay": None}, None, DEVIATIONS),
    "pose as measured": ("storm", None, DEVIATIONS),
    "filter, short-range fixes": ({"base": "storm", "noise": None, "delay": None}, CLOSE, (0.01, 0.01, 0.02)),
    "filter, without DVL": (
        {"base": "storm", "noise": None, "delay": None},
        {name: value for name, value in CLOSE.items() if name != "dvl"},
        (0.01, 0.01, 0.02),
    ),
    "filter, USBL": ({"base": "storm", "noise": None, "delay": None}, {**CLOSE, "acoustic": True}, (0.1, 0.01, 0.02)),
}


def control(
    controllers: tuple[str, ...] = ("pd", "pid", "dob", "mpc"),
    scene: str = "bluerov2-heavy",
    n: int = 256,
    seed: int = 0,
) -> dict[str, dict[str, dict[str, Any]]]:
    """Station keeping in the storm on different measurements, in paired episodes of 20 s.

    Returns
    -------
    dict
        By controller and measurement: rms position (mm) and attitude error (degrees) and mean power (% of full power)
        of each episode, (n,); "estimate_mm", the rms error of the estimated position over all, None without a filter;
        "nis", the mean per degree of freedom of the accepted readings by sensor.
    """
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for name in controllers:
        found[name] = {}
        for label, (disturbance, suite, deviations) in MEASUREMENTS.items():
            # Steps of the environment UVMS-StationKeep-Storm-v0.
            inner = StationKeepVectorEnv(
                n,
                scene=scene,
                disturbance=disturbance,
                substeps=10,
                thruster_lag=0.1,
                max_episode_steps=None,
                error_estimate=False,
            )
            env = inner if suite is None else NavigationObservation(inner, suite, deviations=deviations)
            controller, state = make_controller(name, inner), None
            apart: list[Floats] = []
            sums: dict[str, Floats] = {}
            observation, _ = env.reset(seed=seed)
            for _ in range(200):
                action, state = controller.predict(observation, state)
                observation, _, ended, _, info = env.step(action)
                if ended.any():
                    raise RuntimeError(f"{name} on {label}: {np.count_nonzero(ended)} episodes ended early")
                if isinstance(env, NavigationObservation):
                    apart.append(env.navigation.position - inner.snapshot().position)
                    for sensor, one in env.navigation.innovations().items():
                        part = np.array([one[key][one["accepted"]].sum() for key in ("nis", "degrees")])
                        sums[sensor] = sums.get(sensor, 0.0) + part
            found[name][label] = {
                "position_mm": np.round(1e3 * info["rms_position_error"], 2),
                "attitude_deg": np.round(np.degrees(info["rms_attitude_error"]), 3),
                "power_percent": np.round(100.0 * info["mean_power"], 3),
                "estimate_mm": 1e3 * float(np.sqrt(3.0 * np.mean(np.square(apart)))) if apart else None,
                "nis": {sensor: total / count for sensor, (total, count) in sums.items() if count},
            }
    return found
