"""Catalogue of controllers: meaning and values of gains, tuning and training, and stored results."""

import functools
import inspect
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium

from uvms_gym import _core, controllers
from uvms_gym.controllers import MLP
from uvms_gym.controllers.base import ClassicalController
from uvms_gym.controllers.families import BASELINE, CONTROLLERS, TASKS, is_learned, names
from uvms_gym.controllers.registry import PRETRAINED, design, policies_at, tuned_at
from uvms_gym.studies.comparison.metrics import METRICS

#: Columns of `settings_table`: texts, and all.
TEXTS = ("controller", "role", "purpose", "tuned or trained in", "limits or prices")
SETTINGS = (*TEXTS, "pose, mm", "p95", "p99.9", "worst", "power, %", "variation")


class Stored(NamedTuple):
    """Records of a controller for one task, scene and control period.

    Attributes
    ----------
    name : str
        Canonical name.
    origin : str
        Disturbance and age of measurements, control periods, in tuning or training.
    costs : str
        Limits on effort and variation in tuning, or their prices in the reward.
    gains : dict
        Tuned gains; empty for policies.
    metrics : mapping
        Estimates of the stored comparison; empty without one.
    """

    name: str
    origin: str
    costs: str
    gains: dict[str, Any]
    metrics: Mapping[str, Any]


def places(task: str | None = None, scene: str | None = None) -> list[Path]:
    """Places with gains or policies in the package: TASK/SCENE/PERIODs."""
    found = sorted({file.parent.relative_to(PRETRAINED) for file in PRETRAINED.glob("*/*/*s/*")}, reverse=True)
    wanted = TASKS.get(task or ""), scene
    return [one for one in found if all(part in (None, own) for part, own in zip(wanted, one.parts))]


def stored(chosen: Iterable[str], place: Path) -> list[Stored]:
    """Records of controllers at a place, without controllers of other tasks.

    Raises
    ------
    OSError, ValueError
        A file cannot be read or is malformed.
    """
    task = next(task for task, env in TASKS.items() if env == place.parts[0])
    return [_stored(name, place, BASELINE[task]) for name in chosen if name in names(task)]


def _stored(name: str, place: Path, base: str) -> Stored:
    metrics = _results(PRETRAINED / place / "results.json").get(name, {})
    if is_learned(name):
        files = policies_at(place).get(name, {}).values()
        if not files:
            return Stored(name, "", "", {}, metrics)
        notes = MLP.load(next(iter(files)), residual=True).notes
        env, arguments = notes.get("environment"), notes.get("env_kwargs", "{}")
        prices = json.loads(arguments).get("reward", {})
        costs = ", ".join(f"{key} {prices[key]:g}" for key in ("effort", "action_rate") if key in prices)
        return Stored(name, _origin(env, arguments), costs, {}, metrics)
    if (entry := tuned_at(name, place)) is None:
        return Stored(name, "default gains", "", {}, metrics)
    limits = {} if name == base else CONTROLLERS[name].setting.limits._asdict()
    costs = ", ".join(f"{key} {limit:g}" for key, limit in limits.items() if limit is not None)
    costs = costs and f"{costs} times {base}'s"
    return Stored(name, _origin(entry.get("tuning", {}).get("env"), "{}"), costs, entry["gains"], metrics)


def _origin(env: str | None, arguments: str) -> str:
    """Disturbance of an environment and the age of its measurements, in words."""
    if env not in gymnasium.registry:
        return str(env or "")
    low, high = design(env, arguments)["delay"]
    level = gymnasium.spec(env).kwargs.get("disturbance", "a current")
    return f"{level}, delay {low if low == high else f'{low} to {high}'}"


@functools.cache
def _results(file: Path) -> dict[str, Any]:
    """Metrics by controller of a stored comparison."""
    if not file.exists():
        return {}
    (result, *_) = json.loads(file.read_text(encoding="utf-8"))["results"]
    return {name: entry["metrics"] for name, entry in result["controllers"].items()}


def settings_table(found: Sequence[Stored]) -> list[tuple[str, ...]]:
    """Rows of `SETTINGS`."""
    settings = {one.name: CONTROLLERS[one.name].setting for one in found}
    return [
        (one.name, settings[one.name].role, settings[one.name].about, *one[1:3], *figures(one.metrics)) for one in found
    ]


def figures(metrics: Mapping[str, Any]) -> tuple[str, ...]:
    """Pose error with its interval, 95th and 99.9th percentile, worst, mm, power, %, variation, 1e-3; empty without."""
    if not metrics:
        return ("",) * (len(SETTINGS) - len(TEXTS))
    pose, power, variation = (metrics[name]["whole"] for name in ("pose", "power", "variation"))
    low, value, high = (METRICS["pose"].scale * pose["iqm"][end] for end in ("low", "value", "high"))
    return (
        f"{value:.2f} [{low:.2f}, {high:.2f}]",
        *(f"{METRICS['pose'].scale * tail:.1f}" for tail in (pose["p95"]["value"], pose["p999"], pose["worst"])),
        f"{METRICS['power'].scale * power['iqm']['value']:.1f}",
        f"{METRICS['variation'].scale * variation['iqm']['value']:.2f}",
    )


def gain_texts(kind: type[ClassicalController]) -> dict[str, str]:
    """Meaning of each gain, with its unit, from the docstring of the class."""
    known = _core.gain_names(kind.kind)
    lines = (inspect.getdoc(kind) or "").partition("Parameters\n----------\n")[2]
    entries = re.findall(r"^(\S.*)\n((?:    .*\n?)+)", lines, re.MULTILINE)
    texts = {name: " ".join(text.split()) for head, text in entries for name in head.partition(" : ")[0].split(", ")}
    return {name: _resolved(name, texts[name]) for name in known}


def _resolved(name: str, text: str) -> str:
    """Meaning of a gain; where another class has the text, that text, without the other's default if this has one."""
    if not (match := re.match(r"(?:Gains of|Meaning as in) `(\w+)`[.,;]? ?(.*)", text)):
        return text
    meaning = gain_texts(getattr(controllers, match[1]))[name]
    if "by default" in match[2]:
        meaning = re.sub(r"(?<=\.) [^.]*(?:\.\d[^.]*)*by default\.$", "", meaning)
    return f"{meaning} {match[2][:1].upper()}{match[2][1:]}".strip()
