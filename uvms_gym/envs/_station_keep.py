"""What the single and the vector environment of station keeping have in common."""

import math
import operator
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
_WORDS = ("action", "integrator", "dtype")
_NUMBERS = tuple(name for name, value in DEFAULTS.items() if isinstance(value, float))
#: Greatest count that is handed on.
_MOST = 2**31 - 1


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
    _check(given, num_envs, max_episode_steps)
    weights = given.pop("reward") or {}
    if unknown := weights.keys() - REWARD.keys():
        raise ValueError(f"unknown reward weight {min(unknown)!r}; known: {', '.join(REWARD)}")
    for term, weight in weights.items():
        _check_number(f"reward[{term!r}]", weight)
    return StationKeep(
        **given,
        **{f"reward_{term}": weight for term, weight in {**REWARD, **weights}.items()},
        num_envs=num_envs,
        autoreset=autoreset,
        max_episode_steps=max_episode_steps or None,
    )


def _check(given: Mapping[str, Any], num_envs: Any, max_episode_steps: Any) -> None:
    """Check types, and that counts are such; ranges are checked further down."""
    for name in _WORDS:
        if not isinstance(given[name], str):
            raise TypeError(f"{name} is {given[name]!r}, but must be a string")
    for name in _NUMBERS:
        _check_number(name, given[name])
    _check_count("substeps", given["substeps"])
    _check_count("num_envs", num_envs)
    if given["threads"] is not None:
        _check_count("threads", given["threads"])
    if max_episode_steps is not None:
        _check_count("max_episode_steps", max_episode_steps, least=0)
    if not isinstance(given["reward"], Mapping | None):
        raise TypeError(f"reward is {given['reward']!r}, but must be a dict or None")


def _check_number(name: str, value: Any) -> None:
    try:
        math.isfinite(value)
    except TypeError:
        raise TypeError(f"{name} is {value!r}, but must be a real number") from None
    except OverflowError:
        raise ValueError(f"{name} is an integer of {value.bit_length()} bits, which is too large") from None


def _check_count(name: str, value: Any, least: int = 1) -> None:
    try:
        count = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} is {value!r}, but must be an integer") from None
    if count < least:
        raise ValueError(f"{name} is {count}, but must be at least {least}")
    if count > _MOST:
        raise ValueError(f"{name} is {count}, but must be at most {_MOST}")


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
        ValueError, TypeError
            The state is not one of such an environment; nothing has changed then.
        """
        if not isinstance(state, Mapping):
            raise TypeError(f"state must be a dict as get_state gives it, not {type(state).__name__}")
        for part in ("physics", "episodes"):
            if part not in state:
                raise ValueError(f"state lacks {part!r}, which get_state gives")
        self._native.__setstate__((state["physics"], state["episodes"]))


_FLOAT32 = np.dtype(np.float32)


def as_actions(given: ArrayLike, shape: tuple[int, ...]) -> Actions:
    """Check shape and type, and clip what float32 may not hold; whether it is finite is checked further down."""
    if type(given) is np.ndarray and given.dtype is _FLOAT32 and given.shape == shape:
        return given
    try:
        array = np.asarray(given)
    except ValueError:
        raise ValueError(f"action must be an array of shape {shape}, but its rows differ in length") from None
    if array.dtype.kind not in "fiu":
        raise ValueError(f"action must be an array of real numbers of shape {shape}, not of dtype {array.dtype}")
    if array.shape != shape:
        raise ValueError(f"action has shape {array.shape}, but must have {shape}")
    if array.dtype != np.float32:
        array = np.where(np.isfinite(array), np.clip(array, -1.0, 1.0), array)
    return array.astype(np.float32, copy=False)


def starts(options: Mapping[str, Any] | None, *extra: str) -> dict[str, Any]:
    """Check the names of reset options; a new dict without those whose value is None."""
    if not isinstance(options, Mapping | None):
        raise TypeError(f"options must be a dict or None, not {type(options).__name__}")
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
