"""Options of tasks, their checks, and the native batch made from them."""

import json
import math
import operator
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Literal, Self, TypedDict

import numpy as np

from uvms_gym._core import Task

Scene = str | os.PathLike[str] | dict[str, Any]
#: Name of a level, or components by name: see `uvms_gym.disturbance_levels`.
Disturbance = str | Mapping[str, Any]
#: Switch, share, or ranges by the name of the parameter or the key of the scene.
Randomize = bool | float | Mapping[str, Any]


class RewardWeights(TypedDict, total=False):
    """Weights of the reward's terms, and the scale of the pose error, m; the others keep their defaults."""

    pose: float
    pose_scale: float
    effort: float
    action_rate: float
    diverged: float


class Tolerance(TypedDict, total=False):
    """Errors below which a pose counts as reached, m and rad; the others keep their defaults."""

    position: float
    attitude: float


class Preview(TypedDict, total=False):
    """Number of reference points seen ahead, and the time between them, s; the others keep their defaults."""

    points: int
    spacing: float


#: Options that are dicts, and their keys with types.
GROUPS: dict[str, Mapping[str, Any]] = {
    "reward": RewardWeights.__annotations__,
    "tolerance": Tolerance.__annotations__,
    "preview": Preview.__annotations__,
}
#: Options of the batch, not of the task.
BATCH_OPTIONS = ("integrator", "dtype", "threads", "error_estimate")
#: Maximum count of the native module.
_MOST = 2**31 - 1


@dataclass(frozen=True, kw_only=True)
class TaskOptions:
    """Options that all tasks have.

    Attributes
    ----------
    scene : str, os.PathLike or dict
        Name of a shipped scene with thrusters, path of a TOML file, or a dict.
    action : {"wrench", "thrusters", "residual"}
        Meaning of an action's entries; see the environment's action space.
    dt : float or None
        Physics step, s, in (0, 1]. None: the scene's step (`integration.step`, 0.01 where it states none), in
        end-effector tracking half of it, or a shorter one that divides the control period. At 0.01 s the median error
        at the end effector after 10 s of driven motion is 1e-9 to 1e-8 m (f64; 1e-6 to 8e-6 m in f32; `uvms
        accuracy`). A step too large for the scene raises a `uvms_gym.StepWarning`, once, at the first `step`.
        `uvms accuracy --env ID --scene FILE` measures the errors over an environment's own episodes, and recommends
        a step.
    substeps : int
        Physics steps per control period, 1 to 10000; by default a period of 0.05 s. Changing only `dt` changes the
        control period. Without `dt` these are steps of 0.01 s (0.005 s in end-effector tracking), and the scene's
        step divides the same period.
    integrator : str or None
        Name of an integrator; see `uvms_gym.integrators`. None: the scene's (`integration.integrator`, "mk4" where it
        states none).
    dtype : {"float64", "float32"}
        Number type of the physics.
    max_current : float
        Maximum speed of the drawn steady current, m/s, >= 0, if `disturbance` is None. The scene's own current is
        added.
    start_distance : float
        Maximum initial position error, m, in [0, 10).
    start_angle : float
        Maximum initial attitude error, rad, >= 0.
    target_distance : float
        Maximum distance of a drawn target from the world origin, m, >= 0.
    target_heading : float
        Maximum heading of a drawn target, rad, >= 0.
    disturbance : str, dict or None
        Name of a level, or components by name, as described for `StationKeepEnv`. None: a steady current.
    randomize : bool, float, dict or None
        Parameters drawn anew in every episode; each has one factor, the same for all bodies. `True`: factors of 0.7 to
        1.3 on `mass`, `added_mass`, `linear_damping`, `quadratic_damping`, `thrust` and `thruster_lag`. A number such
        as 0.2: factors of 0.8 to 1.2 on the same parameters. A dict: for each parameter a share such as 0.2, or the
        minimum and maximum factor, such as `[0.8, 1.2]`. It may also have `volume`, a further factor on the displaced
        volume. (The factor of `mass` multiplies the volume, too, so that a floating body still floats.) It may have
        `payload` (maximum, or minimum and maximum, kg) and any other number of the scene by its key, such as
        `"arm.links[0].joint.friction.viscous"`. For such a number a share of 0.2 draws 0.8 to 1.2 times the scene's
        value, and two numbers are the minimum and maximum of the value itself, not factors. Where the value is a list,
        so are its minimum and maximum. `False`: none, even if the disturbance contains some. Draws are uniform.
        References, observations and rewards use the scene as given.
    thruster_lag : float or None
        Time constant of all thrusters, s, in [0, 10], instead of the scene's.
    end_effector : str or None
        Name of the end effector that follows references, is measured and carries the payloads of disturbances, instead
        of the scene's `arm.end_effector`; see `[arm.end_effectors]` in scenes.
    reward : dict or None
        Any of the weights `pose` (0.1), `effort` (0.02), `action_rate` (0.1) and `diverged` (0; 100 in end-effector
        tracking, 500 in docking), >= 0; and `pose_scale` (0.02 m), the s in ln(1 + (p / s)^2), > 0. This term is
        quadratic for pose errors p much smaller than s, and logarithmic for much larger ones.
    tolerance : dict or None
        Any of `position` (0.05 m) and `attitude` (0.1 rad), >= 0: errors below which `info["success"]` is 1. The reward
        does not depend on them.
    residual_scale : float
        Maximum correction of `action="residual"`, relative to the actuators' limits, in [0, 1].
    privileged : bool
        Add the true state, current, parameters and target to `info["privileged"]`, (m,), for asymmetric critics;
        `env.unwrapped.privileged_layout` describes the entries.
    error_estimate : bool or None
        True: estimate the integration errors since the start of the episode in `info["error_estimate"]`, (6,). The
        first two entries are for position (m) and attitude (rad) of the vehicle, the third for the worst joint (rad or
        m), the next two for position (m) and attitude (rad) of the end effector. The last is the largest error as a
        share of the size of the motion (`Simulator.error_estimate`). The `final_info` of a vector environment, which
        describes the ends of episodes, does not contain it. Steps take up to 3.3 times as long, 5.5 times in float32.
        None: estimate the errors of a few instances, for warnings only. False: estimate none.
    threads : int or None
        Maximum number of threads, >= 1; None: all. One instance never uses more than one.
    """

    #: Name of the task.
    task: ClassVar[str] = ""
    #: Classes of the tasks' options, by the name of the task.
    by_task: ClassVar[dict[str, type["TaskOptions"]]] = {}
    #: Reward weight on changes of the action in the variants of the environment with disturbances.
    storm_action_rate: ClassVar[float] = 0.2
    #: Further options of these variants.
    storm: ClassVar[Mapping[str, Any]] = {}
    #: Duration of an episode of the registered environments, s.
    episode_time: ClassVar[float] = 20.0

    scene: Scene = "petasus-pum"
    action: Literal["wrench", "thrusters", "residual"] = "wrench"
    dt: float | None = None
    substeps: int = 5
    integrator: str | None = None
    dtype: Literal["float64", "float32"] = "float64"
    max_current: float = 0.3
    start_distance: float = 0.05
    start_angle: float = 0.05
    target_distance: float = 0.0
    target_heading: float = 0.0
    disturbance: Disturbance | None = None
    randomize: Randomize | None = None
    thruster_lag: float | None = None
    end_effector: str | None = None
    reward: RewardWeights | None = None
    tolerance: Tolerance | None = None
    residual_scale: float = 0.3
    privileged: bool = False
    error_estimate: bool | None = None
    threads: int | None = None

    def __init_subclass__(cls, task: str, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls.task = task
        cls.by_task[task] = cls

    def __post_init__(self) -> None:
        """Check types and counts; ranges are checked by the native module."""
        for field in fields(self):
            name, value, default = field.name, getattr(self, field.name), field.default
            if name == "integrator" and not isinstance(value, str | None):
                raise TypeError(f"integrator is {value!r}, but must be a string or None")
            if isinstance(default, str) and name != "scene" and not isinstance(value, str):
                raise TypeError(f"{name} is {value!r}, but must be a string")
            if name == "end_effector" and not isinstance(value, str | None):
                raise TypeError(f"{name} is {value!r}, but must be a string or None")
            if isinstance(default, bool) and not isinstance(value, (bool, np.bool_)):
                raise TypeError(f"{name} is {value!r}, but must be True or False")
            if isinstance(default, float) or (name in ("dt", "thruster_lag") and value is not None):
                _check_number(name, value)
            if name in GROUPS:
                _check_group(name, value)
        if self.error_estimate is not None and not isinstance(self.error_estimate, (bool, np.bool_)):
            raise TypeError(f"error_estimate is {self.error_estimate!r}, but must be True, False or None")
        check_count("substeps", self.substeps)
        if self.threads is not None:
            check_count("threads", self.threads)

    def with_changes(self, given: Mapping[str, Any]) -> Self:
        """Copy with other values by name.

        Raises
        ------
        TypeError, ValueError
            Unknown option (the message lists the known ones), or a value of the wrong type.
        """
        known = self.to_dict()
        if unknown := given.keys() - known:
            raise TypeError(f"unexpected keyword argument {min(unknown)!r}; known: {', '.join(known)}")
        return replace(self, **given)

    def to_dict(self) -> dict[str, Any]:
        """Options by name, without `task`; values are not copied."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def option_names() -> set[str]:
    """Names of the options of all tasks, and `task`."""
    return {"task"}.union(*([field.name for field in fields(kind)] for kind in TaskOptions.by_task.values()))


def options_by_task(given: Mapping[str, Any]) -> TaskOptions:
    """Options of the task in `given["task"]`, station keeping by default; errors as of `with_changes`."""
    task = given.get("task", "station-keep")
    if task not in TaskOptions.by_task:
        raise ValueError(f"task is {task!r}, but must be one of {', '.join(map(repr, TaskOptions.by_task))}")
    return TaskOptions.by_task[task]().with_changes({name: value for name, value in given.items() if name != "task"})


def native(
    options: TaskOptions | Mapping[str, Any],
    *,
    num_envs: int = 1,
    autoreset: str = "disabled",
    max_episode_steps: int | None = None,
) -> Task:
    """Native batch of a task with these options (of a dict see `options_by_task`).

    Raises
    ------
    TypeError, ValueError
        Unknown option, or a value out of its range (`uvms_gym.SceneError` for the scene).
    """
    if not isinstance(options, TaskOptions):
        options = options_by_task(options)
    check_count("num_envs", num_envs)
    if max_episode_steps is not None:
        check_count("max_episode_steps", max_episode_steps, minimum=0)
    given = {name: value for name, value in options.to_dict().items() if value is not None}
    given.pop("scene", None)
    batch = {name: given.pop(name) for name in BATCH_OPTIONS if name in given}
    del given["privileged"]
    given["task"] = options.task
    if "disturbance" in given:
        given["disturbance"] = as_json("disturbance", given["disturbance"])
    if isinstance(given.get("randomize"), Mapping):
        given["randomize"] = {name: span for name, span in given["randomize"].items() if span is not None}
    limit = max_episode_steps or None
    try:
        return Task(options.scene, given, **batch, num_envs=num_envs, autoreset=autoreset, max_episode_steps=limit)
    except ValueError as error:
        if type(error) is not ValueError or not str(error).startswith("options: "):
            raise
        reason = str(error)
    raise ValueError(_once(reason.removeprefix("options: ")))


def _once(reason: str) -> str:
    """Reason of a refused option with its key once: the native reader repeats it, at the start and in a last line."""
    key, _, rest = reason.split("\nin `")[0].strip().partition(": ")
    return f"{key}: {rest.removeprefix(f'{key}: ')}" if rest else key


def _check_group(name: str, given: Any) -> None:
    """Check names and numbers of an option that is a dict."""
    if not isinstance(given, Mapping | None):
        raise TypeError(f"{name} is {given!r}, but must be a dict or None")
    known = GROUPS[name]
    for key, value in (given or {}).items():
        if key not in known:
            kind = "reward weight" if name == "reward" else f"entry of {name}"
            raise ValueError(f"unknown {kind} {key!r}; known: {', '.join(known)}")
        if known[key] is int:
            check_count(f"{name}[{key!r}]", value, minimum=0)
        else:
            _check_number(f"{name}[{key!r}]", value)


def _check_number(name: str, value: Any) -> None:
    try:
        math.isfinite(value)
    except TypeError:
        raise TypeError(f"{name} is {value!r}, but must be a real number") from None
    except OverflowError:
        raise ValueError(f"{name} is an integer of {value.bit_length()} bits, which is too large") from None


def check_count(name: str, value: Any, minimum: int = 1) -> None:
    """Refuse anything but an integer from `minimum` to 2**31 - 1."""
    try:
        count = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} is {value!r}, but must be an integer") from None
    if count < minimum:
        raise ValueError(f"{name} is {count}, but must be at least {minimum}")
    if count > _MOST:
        raise ValueError(f"{name} is {count}, but must be at most {_MOST}")


def as_json(name: str, given: Any) -> str:
    """JSON of a name or a dict of plain values and arrays."""
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
    kind = type(value).__name__
    raise TypeError(f"a {kind} is not allowed; use numbers, strings, lists, dicts or arrays")
