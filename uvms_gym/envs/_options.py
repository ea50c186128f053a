"""What environments are made with: arguments, their defaults and checks, and the native batch."""

import json
import math
import operator
import os
from collections.abc import Mapping
from typing import Any, Literal, TypedDict

import numpy as np

from uvms_gym._core import Task

Scene = str | os.PathLike[str] | dict[str, Any]
#: Name of a level, or components by name: see `uvms_gym.disturbances`.
Disturbance = str | Mapping[str, Any]
#: Whether, by what share, or ranges by the name of the parameter.
Randomize = bool | float | Mapping[str, Any]


class RewardWeights(TypedDict, total=False):
    """Weights of the reward's terms; what is left out keeps its default."""

    pose: float
    effort: float
    rate: float
    diverged: float


class Tolerance(TypedDict, total=False):
    """Errors below which a pose counts as reached, m and rad; what is left out keeps its default."""

    position: float
    attitude: float


class Preview(TypedDict, total=False):
    """Points of a reference that are seen ahead, and the time between them, s; what is left out keeps its default."""

    points: int
    spacing: float


class Options(TypedDict, total=False):
    """Arguments that single and vector environments take; the single ones document them."""

    task: str
    scene: Scene
    action: Literal["wrench", "thrusters", "residual"]
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
    disturbance: Disturbance | None
    randomize: Randomize | None
    thruster_lag: float | None
    reference: Literal["point", "line", "circle", "figure-eight", "spline", "mixed"]
    reference_size: float
    reference_speed: float
    reference_turn: float
    preview: Preview | None
    reward: RewardWeights | None
    tolerance: Tolerance | None
    residual: float
    privileged: bool
    threads: int | None


_COMMON: Options = {
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
    "disturbance": None,
    "randomize": None,
    "thruster_lag": None,
    "reward": None,
    "tolerance": None,
    "residual": 0.3,
    "privileged": False,
    "threads": None,
}
#: Arguments of each task's environments, and their defaults.
DEFAULTS: dict[str, Options] = {
    "station-keep": {**_COMMON, "arm_amplitude": 0.4},
    "ee-track": {
        **_COMMON,
        "reference": "mixed",
        "reference_size": 0.4,
        "reference_speed": 0.2,
        "reference_turn": 0.4,
        "preview": None,
    },
}
#: Weights of each task's reward.
REWARD: dict[str, RewardWeights] = {
    "station-keep": {"pose": 0.1, "effort": 0.02, "rate": 0.1, "diverged": 0.0},
    "ee-track": {"pose": 0.1, "effort": 0.02, "rate": 0.1, "diverged": 100.0},
}
TOLERANCE: Tolerance = {"position": 0.05, "attitude": 0.1}
PREVIEW: Preview = {"points": 3, "spacing": 0.2}
#: Arguments that are dicts, and the defaults of what these hold.
_GROUPS: dict[str, Mapping[str, Any]] = {
    "reward": REWARD["station-keep"],
    "tolerance": TOLERANCE,
    "preview": PREVIEW,
}
#: Those that are not the task's own business.
_PHYSICS = ("integrator", "dtype", "threads")
#: Greatest count that is handed on.
_MOST = 2**31 - 1


def native(
    options: Options, *, num_envs: int = 1, autoreset: str = "disabled", max_episode_steps: int | None = None
) -> Task:
    """Make the native batch; what `options` lacks has its default. Their `task` is station keeping by default.

    Raises
    ------
    TypeError, ValueError
        An unknown argument, or one out of its range (`uvms_gym.SceneError` for the scene).
    """
    task = options.get("task", "station-keep")
    if task not in DEFAULTS:
        raise ValueError(f"task is {task!r}, but must be one of {', '.join(map(repr, DEFAULTS))}")
    defaults = DEFAULTS[task]
    given: dict[str, Any] = {**defaults, **options, "task": task}
    if unknown := given.keys() - defaults.keys() - {"task"}:
        raise TypeError(f"unexpected keyword argument {min(unknown)!r}; known: {', '.join(defaults)}")
    _check(given, num_envs, max_episode_steps)
    for group in _GROUPS.keys() & given.keys():
        given[group] = _group(group, given[group])
    if given["disturbance"] is None:
        del given["disturbance"]
    else:
        given["disturbance"] = as_json("disturbance", given["disturbance"])
    if given["randomize"] is None:
        del given["randomize"]
    elif isinstance(given["randomize"], Mapping):
        given["randomize"] = {name: span for name, span in given["randomize"].items() if span is not None}
    if given["thruster_lag"] is None:
        del given["thruster_lag"]
    else:
        _check_number("thruster_lag", given["thruster_lag"])
    given["reward"] = {**REWARD[task], **given["reward"]}
    scene, physics = given.pop("scene"), {name: given.pop(name) for name in _PHYSICS}
    del given["privileged"]
    return Task(
        scene,
        given,
        **physics,
        num_envs=num_envs,
        autoreset=autoreset,
        max_episode_steps=max_episode_steps or None,
    )


def _check(given: Mapping[str, Any], num_envs: Any, max_episode_steps: Any) -> None:
    """Check types, and that counts are such; ranges are checked further down."""
    for name, value in DEFAULTS[given["task"]].items():
        if isinstance(value, str) and name != "scene" and not isinstance(given[name], str):
            raise TypeError(f"{name} is {given[name]!r}, but must be a string")
        if isinstance(value, bool) and not isinstance(given[name], (bool, np.bool_)):
            raise TypeError(f"{name} is {given[name]!r}, but must be True or False")
        if isinstance(value, float):
            _check_number(name, given[name])
    check_count("substeps", given["substeps"])
    check_count("num_envs", num_envs)
    if given["threads"] is not None:
        check_count("threads", given["threads"])
    if max_episode_steps is not None:
        check_count("max_episode_steps", max_episode_steps, least=0)


def _group(name: str, given: Any) -> dict[str, Any]:
    """Check a dict of numbers; a new one."""
    if not isinstance(given, Mapping | None):
        raise TypeError(f"{name} is {given!r}, but must be a dict or None")
    known = _GROUPS[name]
    for key, value in (given or {}).items():
        if key not in known:
            kind = "reward weight" if name == "reward" else f"entry of {name}"
            raise ValueError(f"unknown {kind} {key!r}; known: {', '.join(known)}")
        if isinstance(known[key], int):
            check_count(f"{name}[{key!r}]", value, least=0)
        else:
            _check_number(f"{name}[{key!r}]", value)
    return dict(given or {})


def _check_number(name: str, value: Any) -> None:
    try:
        math.isfinite(value)
    except TypeError:
        raise TypeError(f"{name} is {value!r}, but must be a real number") from None
    except OverflowError:
        raise ValueError(f"{name} is an integer of {value.bit_length()} bits, which is too large") from None


def check_count(name: str, value: Any, least: int = 1) -> None:
    try:
        count = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} is {value!r}, but must be an integer") from None
    if count < least:
        raise ValueError(f"{name} is {count}, but must be at least {least}")
    if count > _MOST:
        raise ValueError(f"{name} is {count}, but must be at most {_MOST}")


def as_json(name: str, given: Any) -> str:
    """Write a name or a dict of plain values and arrays as JSON."""
    if not isinstance(given, str | Mapping):
        raise TypeError(f"{name} is {given!r}, but must be the name of a level or a dict of components")
    try:
        return json.dumps(given, allow_nan=False, default=_plain)
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"{name} must hold plain values: {error}") from None


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} is none")
