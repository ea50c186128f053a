"""Cells of a comparison: an environment, a scene, and conditions, those designed for or others."""

import copy
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium

from uvms_gym.cli.common import fail
from uvms_gym.controllers.registry import TASKS
from uvms_gym.disturbances import disturbances
from uvms_gym.envs import EPISODE_STEPS

Options = dict[str, Any]
Components = dict[str, Any]

#: The conditions that environments have by themselves.
DESIGN = "design"
#: Of the disturbances that are scaled: by how much, and what of them.
HARDER = 1.3
_SCALED: Mapping[str, tuple[str, ...]] = {
    "current": ("speed",),
    "drift": ("deviation",),
    "gust": ("speed",),
    "waves": ("height",),
    "impulse": ("share", "force"),
    "payload": ("share", "mass"),
    "arm": ("amplitude",),
}
#: What is not pushed or pulled, but seen.
_SENSORS = ("noise", "delay")


class Cell(NamedTuple):
    """What controllers are compared in.

    Attributes
    ----------
    env, scene : str
        Environment's id; scene as given.
    level : str or None
        Disturbance in place of the environment's own.
    condition : str
        Name in `CONDITIONS`.
    options : dict
        Arguments of the environment.
    designed : dict
        Arguments that controllers are told, and `task`: those of the conditions designed for.
    steps : int
        Control periods of an episode.
    """

    env: str
    scene: str
    level: str | None
    condition: str
    options: Options
    designed: Options
    steps: int

    @property
    def group(self) -> str:
        """Environment and scene."""
        return f"{self.env}, {Path(self.scene).stem if self.scene.endswith('.toml') else self.scene}"

    @property
    def label(self) -> str:
        """Disturbance and condition, as far as they are not the design's."""
        words = [self.level or "", self.condition if self.condition != DESIGN else ""]
        return " ".join(word for word in words if word) or DESIGN

    @property
    def name(self) -> str:
        """All of it in words."""
        return f"{self.group}, {self.label}"


class Condition(NamedTuple):
    """A departure from the design: what it is, the environment's arguments, and whether controllers are told."""

    summary: str
    change: Callable[[Options], Options]
    told: bool = False


def _level(options: Options) -> Components:
    """Components of the disturbance that the environment has by itself."""
    given = options.get("disturbance")
    if given is None:
        return {"current": {"speed": [0.0, options.get("max_current", 0.3)]}}
    return copy.deepcopy(disturbances()[given].components) if isinstance(given, str) else copy.deepcopy(dict(given))


def _with(options: Options, **changes: Any) -> Components:
    return {**_level(options), **changes}


def _only(options: Options, *kept: str) -> Components:
    """Some components, and sensors as they are."""
    level = _level(options)
    return {name: True for name in kept if name not in level} | {
        name: part for name, part in level.items() if name in (*kept, *_SENSORS)
    }


def harder(components: Components, factor: float = HARDER) -> Components:
    """Make disturbances stronger: what pushes and pulls, the arm's swing, and what a weak thruster lacks."""
    scaled = copy.deepcopy(components)
    for name, keys in _SCALED.items():
        for key in keys:
            if isinstance(scaled.get(name), dict) and key in scaled[name]:
                scaled[name][key] = _times(scaled[name][key], factor)
    if isinstance(thrusters := scaled.get("thrusters"), dict) and "gain" in thrusters:
        thrusters["gain"] = _times(thrusters["gain"], 1.0 / factor)
    return scaled


def _times(value: Any, factor: float) -> Any:
    return [factor * x for x in value] if isinstance(value, list) else factor * value


def _still(options: Options) -> Options:
    """No motion of the arm's own, where the task has one."""
    return {"arm_amplitude": 0.0} if options["task"] == "station-keep" else {}


CONDITIONS: dict[str, Condition] = {
    DESIGN: Condition("as designed for", lambda options: {}),
    "lag": Condition("thrusters lag by 0.2 s", lambda options: {"thruster_lag": 0.2}),
    "delay": Condition("sensors are 0.2 s late", lambda options: {"disturbance": _with(options, delay={"time": 0.2})}),
    "x1.3": Condition(
        f"disturbances {HARDER:g} times as strong", lambda options: {"disturbance": harder(_level(options))}
    ),
    "storm-hard": Condition("the level held out for evaluation", lambda options: {"disturbance": "storm-hard"}),
    "payload": Condition(
        "payload of 16 to 24 % of the thrust",
        lambda options: {
            "disturbance": _with(options, payload={"share": [0.16, 0.24], "pick": [2.0, 6.0], "hold": [4.0, 8.0]})
        },
    ),
    "arm-only": Condition(
        "no disturbance but the arm's motion", lambda options: {"disturbance": _only(options, "arm")}
    ),
    "impulses-only": Condition(
        "no disturbance but pushes",
        lambda options: {"disturbance": _only(options, "impulse"), **_still(options)},
    ),
    "calm": Condition("still water, sensors without noise or delay", lambda options: {"disturbance": "calm"}),
    "period-0.05": Condition("control period of 0.05 s", lambda options: {"period": 0.05}, told=True),
}


def cells(
    envs: Sequence[str],
    scenes: Sequence[str],
    descriptions: Mapping[str, Any],
    levels: Sequence[str],
    conditions: Sequence[str],
    given: Options,
) -> list[Cell]:
    """Cross environments, scenes, disturbances and conditions.

    Parameters
    ----------
    envs, scenes : sequence of str
    descriptions : mapping
        Scenes as read.
    levels : sequence of str
        Disturbances in place of the environments' own, each; none: theirs.
    conditions : sequence of str
        Names in `CONDITIONS`.
    given : dict
        Arguments of all environments besides.

    Raises
    ------
    TyperException
        An environment that there is not, or of another kind; a disturbance or a condition that there is not.
    """
    for name in levels:
        if name not in disturbances():
            raise fail(f"there is no disturbance {name!r}; known: {', '.join(disturbances())}")
    for name in conditions:
        if name not in CONDITIONS:
            raise fail(f"there is no cell {name!r}; known: {', '.join(CONDITIONS)}")
    found = []
    chosen: list[str | None] = [*levels] or [None]
    for env in envs:
        task, steps, own = _spec(env)
        for scene in scenes:
            for level in chosen:
                base = {**own, **given, "scene": descriptions[scene], "task": task}
                if level is not None:
                    base["disturbance"] = level
                found += [_cell(env, scene, level, condition, base, steps) for condition in conditions]
    return found


def _cell(env: str, scene: str, level: str | None, condition: str, base: Options, steps: int) -> Cell:
    chosen = CONDITIONS[condition]
    options = {**base, **chosen.change(base)}
    if (period := options.pop("period", None)) is not None:
        dt = options.get("dt", 0.01)
        before, substeps = options.get("substeps", 5), max(1, round(period / dt))
        options["substeps"], steps = substeps, round(steps * before / substeps)
    designed = options if chosen.told else base
    options = {key: value for key, value in options.items() if key != "task"}
    # Changes of the action are then told by the term of the reward.
    options["reward"] = {"rate": 1.0}
    return Cell(env, scene, level, condition, options, dict(designed), steps)


def _spec(env: str) -> tuple[str, int, Options]:
    """Task, episode's length and own arguments of an environment."""
    try:
        spec = gymnasium.spec(env)
    except gymnasium.error.Error as error:
        raise fail(str(error)) from None
    task = next((task for task, name in TASKS.items() if spec.name in (name, f"{name}-Storm")), None)
    if task is None:
        raise fail(f"--env is {env!r}, but only those of uvms_gym work, such as UVMS-StationKeep-Storm-v0")
    return task, spec.max_episode_steps or EPISODE_STEPS, dict(spec.kwargs)
