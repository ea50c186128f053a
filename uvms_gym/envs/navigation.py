"""Observations of a navigation filter on simulated sensors, in place of the environment's measured pose."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from uvms_gym import _rotations
from uvms_gym._core import NavigationFilter, Sensors
from uvms_gym.envs.base import Observations, TaskVectorEnv

#: Decay of the leaky integral of errors, 1/s.
_LEAK = 0.1


class NavigationObservation(gym.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """Vector environment whose observations have the pose and twist of a navigation filter on simulated sensors.

    The filter starts from the true motion with errors of the given deviations, drawn for each episode, and is updated
    once per control period. `position_error`, `attitude_error`, `linear_velocity`, `angular_velocity` and
    `error_integral` are those of its estimate; noise and delay of the disturbance act on no other entries than those of
    joints. Rewards and metrics are of the true state. Seed and episode number determine all draws.

    Controllers made for the environment compensate the delay of its disturbance. The filter's estimate has none: make
    the environment with `{"base": "storm", "delay": None, "noise": None}`.

    Parameters
    ----------
    env : UVMS vector environment of station keeping
        With another autoreset mode than `SAME_STEP`.
    suite : dict, sequence of str, or None
        Sensors as of `Sensors`; an IMU is needed.
    deviations : tuple of float
        Standard deviations of the first estimate along each body axis: position (m), attitude (rad), velocity (m/s).

    Attributes
    ----------
    sensors : Sensors
        `sensors.fail(name)` begins a failure.
    navigation : NavigationFilter
        Estimate, covariance and innovations.
    readings : dict
        Readings of the last control period, as of `Sensors.measure`; also in `info["sensors"]`.

    Raises
    ------
    TypeError
        Other kind of environment.
    ValueError
        Another task or autoreset mode, or settings that `Sensors` or `NavigationFilter` refuses.
    """

    def __init__(
        self,
        env: gym.vector.VectorEnv[Any, Any, Any],
        suite: Mapping[str, Any] | Sequence[str] | None = None,
        *,
        deviations: tuple[float, float, float] = (0.1, 0.02, 0.02),
    ) -> None:
        super().__init__(env)
        inner = env.unwrapped
        if not isinstance(inner, TaskVectorEnv):
            raise TypeError(f"env must be a UVMS vector environment, not {type(inner).__name__}")
        if inner.task != "station-keep":
            raise ValueError(f"the task of env is {inner.task}, but must be station-keep")
        if inner.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP:
            raise ValueError("autoreset_mode of env is SAME_STEP, but must be NEXT_STEP or DISABLED")
        n = inner.num_envs
        self._inner, self._deviations = inner, deviations
        self.sensors = Sensors(inner.snapshot(), suite)
        self.navigation = NavigationFilter(self.sensors.suite, n)
        self.readings: dict[str, Any] = {}
        blocks = {block.name: block for block in inner.layout}
        names = ("position_error", "attitude_error", "linear_velocity", "angular_velocity", "error_integral")
        self._slices = [blocks[name].slice for name in names]
        self._scale = np.concatenate([blocks[name].scale for name in names])
        self._integral = np.zeros((n, 6))
        keep = math.exp(-_LEAK * inner.control_period)
        self._leak = keep, (1.0 - keep) / _LEAK

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """As of `TaskVectorEnv.reset`."""
        observations, info = self.env.reset(seed=cast(Any, seed), options=options)
        mask = (options or {}).get("reset_mask")
        begun = np.ones(self.num_envs, dtype=np.bool_) if mask is None else np.asarray(mask)
        return self._observe(observations, begun, ~begun), self._with_readings(info)

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """As of `TaskVectorEnv.step`."""
        observations, rewards, terminated, truncated, info = self.env.step(cast(Any, actions))
        begun = self._inner.episode["step"] == 0
        seen = self._observe(observations, begun, np.zeros_like(begun))
        return seen, rewards, terminated, truncated, self._with_readings(info)

    def _with_readings(self, info: dict[str, Any]) -> dict[str, Any]:
        return {**info, "sensors": self.readings}

    def _begin(self, begun: NDArray[np.bool_]) -> None:
        """Begin episodes of sensors and filter."""
        n, episode = self.num_envs, self._inner.episode
        position, attitude, velocity = self._deviations
        errors = np.zeros((n, 9))
        for i in np.flatnonzero(begun).tolist():
            key = np.random.SeedSequence([int(episode["seed"][i]), int(episode["episode"][i])])
            errors[i] = np.random.default_rng(key).normal(size=9)
            seed = int(key.generate_state(1, np.uint64)[0])
            self.sensors.reset((seed - i) % 2**64, np.arange(n) == i)
        sim = self._inner.snapshot()
        shift, turn, speed = position * errors[:, :3], attitude * errors[:, 3:6], velocity * errors[:, 6:]
        self.navigation.reset(
            sim,
            position=sim.position + np.einsum("nij,nj->ni", sim.rotation, shift),
            rotation=sim.rotation @ _rotations.exponential(turn),
            twist=sim.twist + np.concatenate([speed, np.zeros((n, 3))], axis=1),
            deviations=self._deviations,
            mask=begun,
        )
        self._integral[begun] = 0.0

    def _observe(
        self, observations: Observations, begun: NDArray[np.bool_], waiting: NDArray[np.bool_]
    ) -> Observations:
        """Observations (N, d) of the estimate; instances that wait have no new control period."""
        if begun.any():
            self._begin(begun)
        self.readings = self.sensors.measure(self._inner.snapshot())
        self.navigation.update(self.readings)
        episode, rotation = self._inner.episode, self.navigation.rotation
        shift = self.navigation.position - episode["target_position"]
        turn = np.swapaxes(episode["target_rotation"], 1, 2) @ rotation
        error = np.concatenate([np.einsum("nji,nj->ni", rotation, shift), _rotations.logarithm(turn)], axis=1)
        keep, gain = self._leak
        moved = ~(begun | waiting)
        self._integral[moved] = keep * self._integral[moved] + gain * error[moved]
        values = np.concatenate([error, self.navigation.twist, self._integral], axis=1) / self._scale
        seen, first = observations.copy(), 0
        for part in self._slices:
            seen[:, part] = values[:, first : first + part.stop - part.start]
            first += part.stop - part.start
        bound = self._inner._native.observation_bound
        return np.asarray(np.clip(seen, -bound, bound), dtype=np.float32)
