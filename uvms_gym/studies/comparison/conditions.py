"""Conditions of a comparison: environment, scene, disturbance, and a departure from the design."""

import copy
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from uvms_gym._core import task_defaults
from uvms_gym._task.options import check_count
from uvms_gym.controllers.families import TASKS
from uvms_gym.disturbances import disturbance_levels
from uvms_gym.envs import EPISODE_STEPS, VARIANTS, TaskOptions

Options = dict[str, Any]
Components = dict[str, Any]

#: The environments' own conditions.
DESIGN = "design"
#: Factor of stronger disturbances, and the scaled numbers of each component.
HARDER = 1.3
SCALED: Mapping[str, tuple[str, ...]] = {
    "current": ("speed",),
    "drift": ("deviation",),
    "gust": ("speed",),
    "waves": ("height",),
    "impulse": ("share", "force"),
    "payload": ("share", "mass"),
    "arm": ("amplitude",),
}
_HEAVY_PAYLOAD = {"share": [0.16, 0.24], "pick": [2.0, 6.0], "hold": [4.0, 8.0]}
#: Components of sensors, which act on observations only.
_SENSORS = ("noise", "outliers", "dropout", "delay")
#: Factor of starts far from the target, and their maximum distance, m: beyond it an episode ends.
FARTHER, FARTHEST = 10.0, 9.0


class Condition(NamedTuple):
    """Environment, scene, disturbance and departure of one comparison.

    Attributes
    ----------
    env, scene : str
        Environment's id; scene as given.
    level : str or None
        Disturbance in place of the environment's own.
    departure : str
        Name in `DEPARTURES`.
    options : dict
        Arguments of the environment.
    designed : dict
        Arguments known to controllers, which are the design's, and `task`.
    steps : int
        Control periods of an episode.
    """

    env: str
    scene: str
    level: str | None
    departure: str
    options: Options
    designed: Options
    steps: int

    @property
    def group(self) -> str:
        """Environment and scene."""
        return f"{self.env}, {Path(self.scene).stem if self.scene.endswith('.toml') else self.scene}"

    @property
    def label(self) -> str:
        """Disturbance and departure, as far as they differ from the design."""
        words = [self.level or "", self.departure if self.departure != DESIGN else ""]
        return " ".join(word for word in words if word) or DESIGN

    @property
    def name(self) -> str:
        """Group and label."""
        return f"{self.group}, {self.label}"


def informed(condition: Condition, state: str | None) -> Condition:
    """Condition in which sensors show the true `state`, "present" or "late": its episodes are the same.

    With None it is the condition as given.
    """
    if state is None:
        return condition
    perfect = [name for name in _SENSORS if state == "present" or name != "delay"]
    options = {**condition.options, "disturbance": _with(condition.options, **dict.fromkeys(perfect))}
    return condition._replace(options=options)


class Departure(NamedTuple):
    """Departure from the design: summary, changed arguments, and whether controllers know them."""

    summary: str
    change: Callable[[Options], Options]
    known: bool = False


def _level(options: Options) -> Components:
    """Components of the environment's own disturbance."""
    given = options.get("disturbance")
    if given is None:
        return {"current": {"speed": [0.0, options.get("max_current", 0.3)]}}
    return copy.deepcopy(dict(disturbance_levels()[given].components if isinstance(given, str) else given))


def _with(options: Options, **changes: Any) -> Components:
    return {**_level(options), **changes}


def _only(options: Options, *kept: str) -> Components:
    """Selected components, with unchanged sensors."""
    level = _level(options)
    return {name: True for name in kept if name not in level} | {
        name: part for name, part in level.items() if name in (*kept, *_SENSORS)
    }


def harder(components: Components, factor: float = HARDER) -> Components:
    """Scale disturbances: flow and forces, the arm's amplitude, and the loss of thrusters."""
    scaled = copy.deepcopy(components)
    for name, keys in SCALED.items():
        for key in keys:
            if isinstance(scaled.get(name), dict) and key in scaled[name]:
                scaled[name][key] = _times(scaled[name][key], factor)
    if isinstance(thrusters := scaled.get("thrusters"), dict) and "gain" in thrusters:
        thrusters["gain"] = _times(thrusters["gain"], 1.0 / factor)
    return scaled


def _times(value: Any, factor: float) -> Any:
    return [factor * x for x in value] if isinstance(value, list) else factor * value


def _far(options: Options) -> Options:
    """Starts farther from the target than the task's."""
    defaults = task_defaults(options["task"])
    distance, angle = (FARTHER * options.get(name, defaults[name]) for name in ("start_distance", "start_angle"))
    return {"start_distance": min(distance, FARTHEST), "start_angle": min(angle, np.pi)}


def _still(options: Options) -> Options:
    """No scripted motion of the arm, where the task has one."""
    return {"arm_amplitude": 0.0} if hasattr(TaskOptions.by_task[options["task"]], "arm_amplitude") else {}


DEPARTURES: dict[str, Departure] = {
    DESIGN: Departure("the design", lambda options: {}),
    "lag": Departure("thrusters lag by 0.2 s", lambda options: {"thruster_lag": 0.2}),
    "delay": Departure("sensors are 0.2 s late", lambda options: {"disturbance": _with(options, delay={"time": 0.2})}),
    "x1.3": Departure(
        f"disturbances {HARDER:g} times as strong", lambda options: {"disturbance": harder(_level(options))}
    ),
    "storm-hard": Departure("the level reserved for evaluation", lambda options: {"disturbance": "storm-hard"}),
    "dropout": Departure(
        "30 % of the measurements are lost",
        lambda options: {"disturbance": _with(options, dropout={"probability": 0.3})},
    ),
    "outliers": Departure(
        "1 % of the measured poses are 0.1 to 0.5 m off",
        lambda options: {"disturbance": _with(options, outliers={"probability": 0.01})},
    ),
    "dead-thruster": Departure(
        "a thruster dies after 5 to 15 s",
        lambda options: {"disturbance": _with(options, thrusters={"gain": 0.0, "time": [5.0, 15.0]})},
    ),
    "far-start": Departure("starts ten times as far", _far),
    "payload": Departure(
        "payload of 16 to 24 % of the thrust", lambda options: {"disturbance": _with(options, payload=_HEAVY_PAYLOAD)}
    ),
    "arm-only": Departure(
        "no disturbance but the arm's motion", lambda options: {"disturbance": _only(options, "arm")}
    ),
    "impulses-only": Departure(
        "no disturbance but pushes", lambda options: {"disturbance": _only(options, "impulse"), **_still(options)}
    ),
    "calm": Departure("still water, sensors without noise or delay", lambda options: {"disturbance": "calm"}),
    "period-0.05": Departure("control period of 0.05 s", lambda options: {"period": 0.05}, known=True),
}


def make_conditions(
    envs: Sequence[str],
    scenes: Mapping[str, Any],
    levels: Sequence[str] = (),
    departures: Sequence[str] = (DESIGN,),
    **options: Any,
) -> list[Condition]:
    """Cross environments, scenes, disturbances and departures.

    Parameters
    ----------
    envs : sequence of str
        Ids of Gymnasium.
    scenes : mapping
        Scenes as the environments take them, by name.
    levels : sequence of str
        Disturbances in place of the environments' own; none: theirs.
    departures : sequence of str
        Names in `DEPARTURES`.
    **options
        Further arguments of all environments.

    Raises
    ------
    ValueError
        An environment, a disturbance or a departure is unknown, the environment is of another kind, or two files of
        scenes have the same name.
    """
    for kind, given, known in (("disturbance", levels, disturbance_levels()), ("condition", departures, DEPARTURES)):
        for name in given:
            if name not in known:
                raise ValueError(f"there is no {kind} {name!r}; known: {', '.join(known)}")
    found = []
    chosen: list[str | None] = [*levels] or [None]
    for env in envs:
        task, steps, own = _spec(env)
        for scene, description in scenes.items():
            for level in chosen:
                base = {**own, **options, "scene": description, "task": task}
                steps = base.pop("max_episode_steps", steps)
                check_count("max_episode_steps", steps)
                if level is not None:
                    base["disturbance"] = level
                found += [_condition(env, scene, level, departure, base, steps) for departure in departures]
    for condition in found:
        if len(alike := {one.scene for one in found if one.name == condition.name}) > 1:
            raise ValueError(f"scenes {' and '.join(sorted(alike))} have the same name; rename one of the files")
    return found


def _condition(env: str, scene: str, level: str | None, departure: str, base: Options, steps: int) -> Condition:
    chosen = DEPARTURES[departure]
    options = {**base, **chosen.change(base)}
    if (period := options.pop("period", None)) is not None:
        defaults = task_defaults(options["task"])
        dt, before = (options.get(name) or defaults[name] for name in ("dt", "substeps"))
        substeps = max(1, round(period / dt))
        options["substeps"], steps = substeps, round(steps * before / substeps)
    designed = options if chosen.known else base
    options = {key: value for key, value in options.items() if key not in ("task", "reward")}
    return Condition(env, scene, level, departure, options, dict(designed), steps)


def _spec(env: str) -> tuple[str, int, Options]:
    """Task, length of an episode and own arguments of an environment."""
    try:
        spec = gymnasium.spec(env)
    except gymnasium.error.Error as error:
        raise ValueError(str(error)) from None
    ids = {f"{name}{variant}": task for task, name in TASKS.items() for variant in ("", *VARIANTS)}
    task = ids.get(spec.name)
    if task is None:
        raise ValueError(f"{env!r} is no environment of uvms_gym, such as UVMS-StationKeep-Storm-v0")
    return task, spec.max_episode_steps or EPISODE_STEPS, dict(spec.kwargs)
