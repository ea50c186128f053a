"""Observations of an environment from measurements of a vehicle, and the actions of a controller on them; no ROS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym._core import Simulator
from uvms_gym.controllers.contract import policy_contract
from uvms_gym.envs.base import TaskEnv
from uvms_gym.ros2.instruments import Floats


class Observer:
    """Controller of an environment on the measurements of a vehicle.

    The environment gives the references and composes the observation from the measured state; its own physics does not
    matter. The memory of the observation, the previous action and the integral of the errors, is made from the
    measurements.

    Parameters
    ----------
    env : TaskEnv
        Environment of the controller.
    controller
        Object with `predict(observation, state)`.
    seed : int
        Seed of the references.
    start : dict
        Options of `env.reset`, such as `target_position`.
    """

    def __init__(
        self, env: TaskEnv, controller: Any, seed: int = 0, start: Mapping[str, ArrayLike] | None = None
    ) -> None:
        if env.options.action == "residual":
            raise ValueError("action is 'residual', but must be 'wrench' or 'thrusters'")
        self.env, self.controller, self.period = env, controller, env.control_period
        self._seed, self._start = seed, dict(start or {})
        self._home = Simulator(env._native.scene, 1).q[0]
        self._leak = policy_contract(env)["integral"]
        self._blocks = {block.name: block for block in env.layout}
        layout = env.action_layout
        self._low, self._high = (np.array([getattr(block, end)[0] for block in layout]) for end in ("low", "high"))
        self.reset()

    def reset(self) -> None:
        """Begin anew: references at their start, memories empty."""
        self.env.reset(seed=self._seed, options=self._start or None)
        self._action = np.zeros(len(self._low), np.float32)
        self._integral: Floats | None = None
        self._memory: Any = None

    def observe(self, position: ArrayLike, quaternion: ArrayLike, twist: ArrayLike, q: ArrayLike, qd: ArrayLike) -> Any:
        """Observation (d,) of a measured state: position (3,), quaternion (4,) [w, x, y, z], twist (6,), q, qd (n,)."""
        simulator, state = self.env.snapshot(), self.env.get_state()
        joints = {"q": q, "qd": qd} if simulator.num_joints else {}
        simulator.set_state(position=position, quaternion=quaternion, twist=twist, **joints)
        state["physics"] = simulator.__getstate__()
        self.env.set_state(state)
        row: NDArray[np.float32] = self.env._native.perfect_observations()[0]
        errors = np.concatenate([self._entries(row, name) for name in ("position_error", "attitude_error")])
        if self._integral is None:
            self._integral = np.zeros(6)
        else:
            self._integral = self._leak["keep"] * self._integral + self._leak["gain"] * errors
        block = self._blocks["error_integral"]
        row[block.slice] = self._integral / block.scale
        row[self._blocks["previous_action"].slice] = self._action
        return row

    def act(self, observation: Any) -> Floats:
        """Command (a,) in physical units, see `env.action_layout`; the references advance by one control period."""
        action, self._memory = self.controller.predict(observation, self._memory)
        self._action = np.clip(np.asarray(action, np.float32), -1.0, 1.0)
        targets = [self._entries(observation, name) for name in ("joint_reference", "joint_reference_rate")]
        #: Targets (n,) and rates (n,) of joints at the next control instant; None where efforts drive the joints.
        self.joint_targets = (targets[0] + self._home, targets[1]) if len(targets[0]) else None
        if self.env.step(self._action)[2]:
            raise ValueError("the vehicle is beyond the bounds of the task, 10 m from its target or at 10 m/s")
        action = self._action.astype(np.float64)
        return np.asarray(np.where(action >= 0.0, action * self._high, -action * self._low))

    def _entries(self, row: NDArray[np.float32], name: str) -> Floats:
        """Physical values of a block; none where there is no such block."""
        block = self._blocks.get(name)
        return np.zeros(0) if block is None else np.asarray(row[block.slice] * np.array(block.scale))
