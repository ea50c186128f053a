"""Simulated vehicle with sensors, commands and a deadman; no ROS."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym import _rotations
from uvms_gym._core import Simulator
from uvms_gym.controllers.contract import policy_contract
from uvms_gym.envs.base import TaskEnv
from uvms_gym.ros2.instruments import Floats, Instruments, Reading

#: Age of the last command at which thrusts become 0 and joints hold, s.
DEADMAN = 0.5


@dataclass(frozen=True)
class Measurement:
    """Sensor values at one instant; SI units.

    Attributes
    ----------
    time : float
        Simulation time, s.
    position : numpy.ndarray (3,)
        Vehicle origin in the world, z up.
    quaternion : numpy.ndarray (4,)
        [w, x, y, z], body to world.
    twist : numpy.ndarray (6,)
        [v; omega] over ground, body axes (x forward, y left, z up).
    q, qd : numpy.ndarray (n,)
        Joint coordinates and rates.
    readings : dict
        Readings of the instruments that have arrived since the measurement before, by sensor.
    """

    time: float
    position: Floats
    quaternion: Floats
    twist: Floats
    q: Floats
    qd: Floats
    readings: Mapping[str, Reading]


class MeasuredState:
    """Pose, twist and joints of a simulated vehicle as its environment observes them, with noise, bias and delay.

    `deviations` are standard deviations of the noise by quantity (see the disturbance `noise`), empty without noise.

    Raises
    ------
    ValueError
        A noisy or late environment of a task other than station keeping, whose errors belong to a moving target.
    """

    def __init__(self, env: TaskEnv) -> None:
        disturbance = policy_contract(env)["disturbance"]
        self.deviations: dict[str, float] = dict(disturbance.get("noise") or {})
        self._exact = not (self.deviations or disturbance.get("outliers") or env._native.late)
        if not self._exact and env.task != "station-keep":
            allowed = "give a disturbance without them, such as calm"
            raise ValueError(f"noise, delay and gaps are for station keeping, not for {env.task}: {allowed}")
        self._env = env
        self._pose = Simulator(env._native.scene, 1)
        self._home = self._pose.q[0]

    def read(self, observation: NDArray[Any]) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Position, quaternion, twist, q and qd at the present state, whose observation (d,) is given."""
        if self._exact:
            true = self._env.snapshot()
            return true.position[0], true.quaternion[0], true.twist[0], true.q[0], true.qd[0]
        e = {b.name: observation[b.slice] * np.array(b.scale) for b in self._env.layout}
        target = self._env.episode
        angle = float(np.linalg.norm(e["attitude_error"]))
        axis = e["attitude_error"] / angle if angle > 0.0 else np.array([1.0, 0.0, 0.0])
        measured = target["target_rotation"][0] @ _rotations.about(axis, angle)
        self._pose.set_state(rotation=measured)
        return (
            target["target_position"][0] + measured @ e["position_error"],
            self._pose.quaternion[0],
            np.concatenate([e["linear_velocity"], e["angular_velocity"]]),
            e["joint_position"] + self._home if len(self._home) else self._home,
            e["joint_rate"] if len(self._home) else self._home,
        )


class SimulatedVehicle:
    """Environment that is commanded by thrusts or a wrench, and joint targets or efforts, in physical units.

    Thrusts become 0 and joints hold once the last command is older than `DEADMAN`.

    Parameters
    ----------
    env : TaskEnv
        Environment with `action="thrusters"`.
    seed : int
        Seed of its episodes, and of the noise of the instruments.
    sensors : dict
        Settings of the instruments that differ from their defaults: see `Instruments`.
    """

    def __init__(self, env: TaskEnv, seed: int = 0, sensors: Mapping[str, Any] | None = None) -> None:
        if env.options.action != "thrusters":
            raise ValueError(f"action is {env.options.action!r}, but must be 'thrusters'")
        self.env, self.period = env, env.control_period
        self._seed: int | None = seed
        self._model = Simulator(env._native.scene, 1)
        self.thrusters, self.joints = self._model.thruster_names, self._model.joint_names
        limits = env.action_layout
        self._low, self._high = (np.array([getattr(block, end)[0] for block in limits]) for end in ("low", "high"))
        #: Names of joints that efforts move; where there are none the joints follow targets.
        self.driven = [block.name for block in limits[len(self.thrusters) :]]
        self.state = MeasuredState(env)
        self.instruments = Instruments(self._model, sensors or {}, seed, self.period)
        self._columns = _reference_columns(env) if self.joints and not self.driven else []
        self.episode = -1
        self.reset()

    def reset(self) -> Measurement:
        """Begin the next episode at time 0, without commands."""
        observation, self.info = self.env.reset(seed=self._seed)
        self._seed, self.steps, self.over, self.time = None, 0, False, 0.0
        self.episode += 1
        self._thrust = np.zeros(len(self._low))
        self._target: Floats | None = None
        self._commanded = {"thrusts": -math.inf, "joints": -math.inf}
        if self.episode > 0:
            self.instruments.reset()
        return self._measure(observation)

    @property
    def silent(self) -> bool:
        """Whether the deadman has stopped the thrusters."""
        return self._stale("thrusts")

    def command_thrust(self, thrust: ArrayLike) -> None:
        """Thrusts (m,), N."""
        m = len(self.thrusters)
        self._thrust[:m] = _numbers("thrusts", thrust, m)
        self._commanded["thrusts"] = self.time

    def command_wrench(self, wrench: ArrayLike) -> None:
        """Wrench (6,) on the vehicle, N and N m, body axes; allocated to the thrusters."""
        self.command_thrust(self._model.allocate(_numbers("wrench", wrench, 6))[0])

    def command_joints(self, position: ArrayLike, rate: ArrayLike = (), effort: ArrayLike = ()) -> None:
        """Targets (n,) and rates (n,) at the end of the control period; or efforts of the joints `driven`.

        Raises
        ------
        ValueError
            Other counts, numbers that are not finite, or targets where efforts are needed and the other way round.
        """
        n, m = len(self.joints), len(self.thrusters)
        if self.driven:
            if not np.size(effort):
                raise ValueError("joint_targets have no efforts, but efforts drive the joints of this task")
            self._thrust[m:] = _numbers("efforts", effort, len(self.driven))
        else:
            target = _numbers("positions", position, n)
            rates = _numbers("velocities", rate, n) if np.size(rate) else np.zeros(n)
            self._target = np.concatenate([target, rates])
        self._commanded["joints"] = self.time

    def step(self) -> Measurement:
        """One control period under the last commands; `over` is true once the vehicle has diverged."""
        m, ask = len(self.thrusters), self._thrust.copy()
        if self.silent:
            ask[:m] = 0.0
        if self._stale("joints"):
            ask[m:], self._target = 0.0, None
        if self._columns:
            state, now = self.env.get_state(), self.env.episode["joint_reference"][0]
            target = np.concatenate([now, np.zeros(len(now))]) if self._target is None else self._target
            state["episodes"][0, self._columns] = target
            self.env.set_state(state)
        action = np.where(ask >= 0.0, ask / self._high, -ask / self._low)
        observation, _, self.over, _, self.info = self.env.step(action.astype(np.float32))
        self.steps += 1
        self.time = self.steps * self.period
        return self._measure(observation)

    def _measure(self, observation: NDArray[Any]) -> Measurement:
        readings = self.instruments.read(self.env.snapshot())
        self.measurement = Measurement(self.time, *self.state.read(observation), readings)
        return self.measurement

    def _stale(self, kind: str) -> bool:
        return self.time - self._commanded[kind] > DEADMAN - 1e-9


def _numbers(name: str, given: ArrayLike, count: int) -> Floats:
    """Finite numbers (count,)."""
    numbers = np.asarray(given, dtype=np.float64)
    if numbers.shape != (count,):
        raise ValueError(f"{name} have {numbers.size} numbers, but must have {count}")
    if not np.isfinite(numbers).all():
        raise ValueError(f"{name} are {numbers.tolist()}, but must be finite")
    return numbers


def _reference_columns(env: TaskEnv) -> list[int]:
    """Columns of the state's "episodes" that are the references (n) of joints at the next instant and their rates (n).

    Found by changing one column at a time.
    """
    blocks = {block.name: block for block in env.layout}
    entries = list(itertools.chain(*(range(*blocks[name].slice.indices(10**6)) for name in _REFERENCES)))
    env.reset(seed=0)
    state, found = env.get_state(), dict.fromkeys(entries, -1)
    usual = env._native.perfect_observations()[0]
    for column in range(state["episodes"].shape[1]):
        changed = {**state, "episodes": state["episodes"].copy()}
        changed["episodes"][0, column] += 1e-2
        try:
            env.set_state(changed)
        except ValueError:
            continue  # A count or a key.
        apart = np.flatnonzero(env._native.perfect_observations()[0] != usual)
        if len(apart) == 1 and apart[0] in found:
            found[apart[0]] = column
    if -1 in found.values():
        raise ValueError(f"the joints of {env.task} follow no reference that can be commanded")
    return list(found.values())


_REFERENCES = ("joint_reference", "joint_reference_rate")
