"""What the single and the vector environment of station keeping have in common."""

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict

import numpy as np
from gymnasium import logger, spaces
from numpy.typing import ArrayLike, NDArray

from uvms_gym._core import Simulator, StationKeep

Scene = str | os.PathLike[str] | dict[str, Any]
Observations = NDArray[np.float32]
Actions = NDArray[np.float32]

#: Parts of an episode's start that `reset(options=...)` takes instead of drawing them.
RESET_OPTIONS = ("position", "attitude", "twist", "q", "qd", "target_position", "target_attitude", "current")


class RewardWeights(TypedDict, total=False):
    """Weights of the reward's terms; what is left out keeps its default."""

    pose: float
    effort: float
    rate: float


class Options(TypedDict, total=False):
    """Arguments that both environments take; `StationKeepEnv` documents them."""

    scene: Scene
    action: Literal["wrench", "thrusters"]
    dt: float
    substeps: int
    integrator: str
    dtype: Literal["float64", "float32"]
    max_current: float
    start_distance: float
    start_angle: float
    target_distance: float
    target_turn: float
    arm_amplitude: float
    reward: RewardWeights | None
    threads: int | None


DEFAULTS: Options = {
    "scene": "petasus-pum",
    "action": "wrench",
    "dt": 0.01,
    "substeps": 5,
    "integrator": "mk4",
    "dtype": "float64",
    "max_current": 0.3,
    "start_distance": 0.05,
    "start_angle": 0.05,
    "target_distance": 0.0,
    "target_turn": 0.0,
    "arm_amplitude": 0.4,
    "reward": None,
    "threads": None,
}
REWARD: RewardWeights = {"pose": 0.1, "effort": 0.02, "rate": 0.1}


def native(
    options: Options, *, num_envs: int = 1, autoreset: str = "disabled", max_episode_steps: int | None = None
) -> StationKeep:
    """Make the native batch; what `options` lacks has its default.

    Raises
    ------
    TypeError, ValueError
        An unknown argument, or one out of its range (`uvms_gym.SceneError` for the scene).
    """
    given: dict[str, Any] = {**DEFAULTS, **options}
    if unknown := given.keys() - DEFAULTS.keys():
        raise TypeError(f"unexpected keyword argument {min(unknown)!r}; known: {', '.join(DEFAULTS)}")
    weights = given.pop("reward") or {}
    if unknown := weights.keys() - REWARD.keys():
        raise ValueError(f"unknown reward weight {min(unknown)!r}; known: {', '.join(REWARD)}")
    return StationKeep(
        **given,
        **{f"reward_{term}": weight for term, weight in {**REWARD, **weights}.items()},
        num_envs=num_envs,
        autoreset=autoreset,
        max_episode_steps=max_episode_steps or None,
    )


class StationKeepBase:
    """Spaces, state and read access."""

    _native: StationKeep
    options: Options

    _action_shape: tuple[int, ...]

    def _spaces(self) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
        """Spaces of one instance's observation and action."""
        bound = self._native.observation_bound
        action = np.ones(len(self._native.action_layout), dtype=np.float32)
        self._action_shape = action.shape
        return spaces.Box(-bound, bound, dtype=np.float32), spaces.Box(-action, action, dtype=np.float32)

    @property
    def simulator(self) -> Simulator:
        """A copy of the physics at this instant: the true state to read, and a simulator to look ahead with."""
        return self._native.simulator

    @property
    def layout(self) -> Sequence[Mapping[str, Any]]:
        """Blocks of an observation: name, offset, scale, bound, unit, description."""
        return self._native.layout

    @property
    def action_layout(self) -> list[tuple[str, list[float], str]]:
        """Entries of an action: name, what -1 and +1 ask for, unit."""
        return self._native.action_layout

    @property
    def episode(self) -> dict[str, NDArray[Any]]:
        """What the running episodes drew, one row per instance: seed, target, current, joint reference, step."""
        return self._native.episodes()

    def get_state(self) -> dict[str, NDArray[np.float64]]:
        """Everything that makes the environment go on as if it had not been interrupted."""
        physics, episodes = self._native.__getstate__()
        return {"physics": physics, "episodes": episodes}

    def set_state(self, state: Mapping[str, ArrayLike]) -> None:
        """Continue, bit for bit, from what `get_state` of an environment with the same arguments gave.

        Raises
        ------
        ValueError
            The state is not one of such an environment; nothing has changed then.
        """
        self._native.__setstate__((state["physics"], state["episodes"]))


def as_actions(given: ArrayLike, shape: tuple[int, ...]) -> Actions:
    """Check shape and type; whether the numbers are finite is checked further down."""
    array = np.asarray(given)
    if array.shape != shape:
        raise ValueError(f"action has shape {array.shape}, but must have {shape}")
    if array.dtype.kind not in "fiu":
        raise ValueError(f"action must be an array of real numbers, not of {array.dtype}")
    with np.errstate(over="ignore"):
        return array.astype(np.float32, copy=False)


def starts(options: Mapping[str, Any] | None, *extra: str) -> dict[str, Any]:
    """Check the names of reset options; a new dict without those whose value is None."""
    known = (*RESET_OPTIONS, *extra)
    for name in options or {}:
        if name not in known:
            raise ValueError(f"unknown reset option {name!r}; known: {', '.join(known)}")
    return {name: value for name, value in (options or {}).items() if value is not None}


def refuse_rendering(render_mode: str | None) -> None:
    """There is no renderer."""
    if render_mode is not None:
        raise ValueError(f"render_mode is {render_mode!r}, but must be None: there is nothing to render with")


def warn_of_rendering() -> None:
    """Say what Gymnasium says of an environment without render mode."""
    logger.warn("You are calling render method without specifying any render mode.")
