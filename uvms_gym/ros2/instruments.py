"""IMU, DVL and pressure sensor of a simulated vehicle, by `uvms_gym.Sensors` (docs/sensors.md); no ROS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym._core import Sensors, Simulator

Floats = NDArray[np.float64]
#: Sensors that the node publishes, by their topics.
TOPICS = {"imu": "imu", "dvl": "dvl", "depth": "pressure"}
#: Height of the surface above the world's origin, m, unless the declaration states it; pressure there, Pa.
SURFACE, ATMOSPHERE = 10.0, 101325.0


@dataclass(frozen=True)
class Reading:
    """Reading of one sensor that has arrived; SI units.

    Attributes
    ----------
    time : float
        Time of the sample, s.
    rpy : numpy.ndarray (3,)
        Axes of the sensor about the vehicle's, roll, pitch, yaw, rad.
    mounted : bool
        Whether position or axes of the sensor differ from the vehicle frame's.
    values : dict
        Values in the sensor's axes by quantity: "specific_force", m/s^2, and "angular_velocity", rad/s, means since the
        last sample; "velocity" over the bottom, m/s; "pressure", Pa, absolute.
    covariance : dict
        Covariance (k, k) of the white noise of each.
    """

    time: float
    rpy: Floats
    mounted: bool
    values: Mapping[str, Floats]
    covariance: Mapping[str, Floats]


class Instruments:
    """Sensors on a simulated vehicle, with noise, rate, delay, drop-outs and failures.

    Parameters
    ----------
    simulator : Simulator
        The vehicle, one instance.
    suite : dict
        Settings that differ from the defaults by sensor ("imu", "dvl", "depth"); False: no such sensor.
    seed : int
        Seed of the noise.
    period : float
        Interval of the calls, s.

    Raises
    ------
    ValueError
        Unknown sensor or setting, or a number out of range.
    """

    def __init__(self, simulator: Simulator, suite: Mapping[str, Any], seed: int, period: float) -> None:
        for name in suite:
            if name not in TOPICS:
                raise ValueError(f"sensors: unknown sensor {name!r}; the node publishes {', '.join(TOPICS)}")
        wanted = {"imu": True, "dvl": True, "depth": True, **suite}
        if wanted["depth"] is True or isinstance(wanted["depth"], Mapping):
            wanted["depth"] = {"surface": SURFACE, **({} if wanted["depth"] is True else wanted["depth"])}
        try:
            given = {name: setting for name, setting in wanted.items() if setting is not False}
            self._sensors = Sensors(simulator, given, seed=seed)
        except (TypeError, ValueError) as error:
            raise ValueError(f"sensors: {error}") from None
        self._period = period
        self.suite = self._sensors.suite
        water = simulator.scene["water"]
        self._weight = float(water["density"]) * float(np.linalg.norm(water["gravity"]))

    def reset(self) -> None:
        """Begin a new episode: new biases, no samples on their way."""
        self._sensors.reset()

    def fail(self, name: str, failed: bool = True) -> None:
        """Let a sensor fail, or work again."""
        self._sensors.fail(name, failed)

    def read(self, simulator: Simulator) -> dict[str, Reading]:
        """Readings that have arrived since the last call, by sensor."""
        found, made = self._sensors.measure(simulator), {}
        for name, setting in self.suite.items():
            other = ("valid", "time", "latest_angular_velocity")
            values = {key: rows[0] for key, rows in found[name].items() if key not in other}
            if name == "dvl":
                values = {"velocity": values["velocity"]}
            if name == "depth":
                values = {"pressure": ATMOSPHERE + self._weight * np.maximum(values["depth"], 0.0)}
            if not found[name]["valid"][0] or not all(np.isfinite(value).all() for value in values.values()):
                continue
            rpy = np.array(setting.get("rpy", (0.0, 0.0, 0.0)))
            mounted = bool(np.any(rpy) or np.any(setting["position"]))
            made[name] = Reading(float(found[name]["time"][0]), rpy, mounted, values, self._covariance(name))
        return made

    def _covariance(self, name: str) -> dict[str, Floats]:
        """Covariance of the white noise of a sensor's values."""
        setting = self.suite[name]
        if name == "imu":
            # White noise of a mean over the interval between two samples.
            interval = max(self._period, 1.0 / setting["rate"])
            density = {"specific_force": "accelerometer_noise", "angular_velocity": "gyro_noise"}
            return {key: np.eye(3) * setting[noise] ** 2 / interval for key, noise in density.items()}
        if name == "depth":
            return {"pressure": np.eye(1) * (self._weight * setting["noise"]) ** 2}
        # Least squares of four beams, at azimuths of 45 degrees and three times 90 more.
        sine, cosine = np.sin(setting["beam_angle"]), np.cos(setting["beam_angle"])
        return {"velocity": np.diag(setting["noise"] ** 2 / np.array([2 * sine**2, 2 * sine**2, 4 * cosine**2]))}
