"""Construction and read access that single and vector environments of all tasks share."""

from __future__ import annotations

import logging
import os
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from uvms_gym._core import Simulator, Task, scene_names, tasks
from uvms_gym._task.jacobians import base_actions
from uvms_gym._task.options import TaskOptions, check_count, native

#: Episode length of the registered environments, control periods.
EPISODE_STEPS = 400

#: Names of the metrics in `info` that all tasks share.
INFO = tuple(Task.INFO)


@dataclass(frozen=True)
class Block:
    """Named run of entries in a row of observations, actions or privileged information.

    Attributes
    ----------
    name : str
        Name of the quantity.
    offset : int
        First entry; `row[..., block.slice]` are the block's entries.
    length : int
        Number of entries.
    scale : tuple of float (length,)
        Physical value of an entry of 1. An action's entry of -1 asks for `low`, which may differ from `-scale`.
    low : tuple of float (length,)
        Physical value at the minimum of the entry; infinite where there is no bound.
    high : tuple of float (length,)
        Physical value at its maximum; infinite where there is no bound.
    unit : str
        Unit of the physical value.
    description : str
        Meaning, with the axes.
    """

    name: str
    offset: int
    length: int
    scale: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    unit: str
    description: str

    @property
    def slice(self) -> slice:
        """Entries of the block in a row."""
        return slice(self.offset, self.offset + self.length)


class TaskBase:
    """Spaces, layouts, state and forecast of an environment."""

    #: Class of the environment's options.
    options_class: ClassVar[type[TaskOptions]]
    _certificate_mentioned: ClassVar[bool] = False

    options: TaskOptions
    _native: Task
    _action_shape: tuple[int, ...]

    def _make(
        self, options: TaskOptions | None, changes: Mapping[str, Any], **batch: Any
    ) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
        """Make the native batch with options changed by name; spaces of one instance's observation and action."""
        if options is None:
            options = self.options_class()
        elif not isinstance(options, self.options_class):
            raise TypeError(f"options must be {self.options_class.__name__}, not {type(options).__name__}")
        self.options = options.with_changes(changes)
        self._native = native(self.options, **batch)
        self._mention_certificate()
        bound = self._native.observation_bound
        action = np.ones(len(self._native.action_layout), dtype=np.float32)
        self._action_shape = action.shape
        return spaces.Box(-bound, bound, dtype=np.float32), spaces.Box(-action, action, dtype=np.float32)

    def __repr__(self) -> str:
        parts = [spec.id] if (spec := getattr(self, "spec", None)) is not None else []
        parts += [f"num_envs={count}"] if (count := getattr(self, "num_envs", None)) is not None else []
        parts.append(f"scene={self._native.snapshot().scene_name!r}")
        own = self.options_class()
        for name, value in self.options.to_dict().items():
            if name != "scene" and value != getattr(own, name):
                parts.append(f"{name}={reprlib.repr(value)}")
        return f"{type(self).__name__}({', '.join(parts)})"

    def _mention_certificate(self) -> None:
        """Log, once per process, the command that certifies the accuracy for a user's own scene.

        A log record, not a warning: nothing is wrong, and programs that turn warnings into errors must run.
        """
        scene = self.options.scene
        if TaskBase._certificate_mentioned or (isinstance(scene, str) and scene in scene_names()):
            return
        TaskBase._certificate_mentioned = True
        file = "FILE" if isinstance(scene, dict) else os.fspath(scene)
        command = f"uvms accuracy --env {dict(tasks())[self.task]}-v0 --scene {file}"
        logging.getLogger("uvms_gym").info("accuracy of the step for a scene of your own: %s", command)

    @property
    def task(self) -> str:
        """Name of the task."""
        return self.options.task

    @property
    def control_period(self) -> float:
        """Duration of a step of the environment, s."""
        return self._native.control_period

    @property
    def layout(self) -> tuple[Block, ...]:
        """Blocks of an observation."""
        return tuple(Block(**block) for block in self._native.layout)

    @property
    def action_layout(self) -> tuple[Block, ...]:
        """Entries of an action, one block each."""
        return tuple(Block(**block) for block in self._native.action_layout)

    @property
    def privileged_layout(self) -> tuple[Block, ...]:
        """Parts of `info["privileged"]`."""
        return tuple(Block(**block) for block in self._native.privileged_layout)

    @property
    def metric_names(self) -> tuple[str, ...]:
        """Names of the metrics in `info`, first of those that all tasks share, then of the task's own."""
        return tuple(self._native.metric_names)

    @property
    def episode(self) -> dict[str, NDArray[Any]]:
        """Drawn parts and progress of the running episodes, one row per instance.

        seed, episode, step (N,); target_position (N, 3), m, and target_rotation (N, 3, 3), as of now; current (N, 3),
        m/s, world axes; action (N, a); joint_reference and joint_reference_rate (N, n), where joints follow one.
        """
        return self._native.episodes()

    def _forces(self, actions: NDArray[np.float32], observations: NDArray[np.float32] | None) -> NDArray[np.float64]:
        """Forces (N, f) of actions (N, a)."""
        return self._native.forces(self._native.frames()[1], actions, self._base(observations))[0]

    def _base(self, observations: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
        """Actions (N, a) of the base controller, with residual actions."""
        if self.options.action != "residual":
            return None
        if observations is None:
            raise ValueError("residual actions correct a controller: give its observations (N, d)")
        return base_actions(self._native, observations)

    def _errors(self) -> NDArray[np.float64]:
        """Rows of `info["error_estimate"]`, (N, 6)."""
        errors = self._native.error_estimate()
        joints = errors["q"].max(axis=1, initial=0.0)
        ends = (errors["end_effector_position"], errors["end_effector_attitude"])
        return np.stack([errors["position"], errors["attitude"], joints, *ends, errors["relative"]], axis=1)

    def snapshot(self) -> Simulator:
        """Simulator with a copy of the current state of all instances: to read the true state, or to look ahead."""
        return self._native.snapshot()

    def disturbance(self, instance: int = 0, steps: int = EPISODE_STEPS) -> dict[str, NDArray[np.float64]]:
        """Disturbance of an instance over its next `steps` control periods, for a vehicle that stays in place.

        After `reset` it covers the whole episode. Waves, tether and pushes depend a little on the vehicle's position;
        the rest is exact.

        Returns
        -------
        dict of numpy.ndarray
            time (T,), s since the episode's start; current (T, 3), m/s, and its acceleration (T, 3), m/s^2, world axes;
            wrench (T, 6), N and N m, body axes, thrusters excluded; gains (T, thrusters), remaining share of each
            thruster's thrust; payload (T,), kg.

        Raises
        ------
        IndexError, ValueError, gymnasium.error.ResetNeeded
            `instance` or `steps` is out of range, or there is no episode.
        """
        check_count("instance", instance, minimum=0)
        check_count("steps", steps, minimum=0)
        return self._native.disturbance(instance, steps)

    def get_state(self) -> dict[str, NDArray[np.float64]]:
        """Complete state, to continue from with `set_state`."""
        physics, episodes = self._native.__getstate__()
        return {"physics": physics, "episodes": episodes}

    def set_state(self, state: Mapping[str, ArrayLike]) -> None:
        """Continue, bit for bit, from the state of an environment with the same arguments.

        Raises
        ------
        ValueError, TypeError
            The state is not one of such an environment; nothing has changed then.
        """
        if not isinstance(state, Mapping):
            raise TypeError(f"state must be a dict as get_state gives it, not {type(state).__name__}")
        for part in ("physics", "episodes"):
            if part not in state:
                raise ValueError(f"state lacks {part!r}, which get_state gives")
        self._native.__setstate__((state["physics"], state["episodes"]))
