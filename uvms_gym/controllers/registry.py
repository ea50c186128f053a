"""Controllers by name: classical ones with tuned gains, and learned ones with the policies that the package ships.

What is shipped for a task, a scene and a control period lies in one folder, `pretrained/TASK/SCENE/PERIODs`: the tuned
gains as `gains.json`, a policy of training seed S as `NAME-S.safetensors`.
"""

import inspect
import json
import os
import re
from pathlib import Path
from typing import Any, Literal, NamedTuple, Unpack

from uvms_gym.controllers.base import Controller, options_of
from uvms_gym.controllers.feedback import PD, PID, NoControl
from uvms_gym.controllers.mlp import MLP
from uvms_gym.controllers.model import DOB, MPC, ComputedTorque, PDRestoring
from uvms_gym.controllers.residual import Residual
from uvms_gym.controllers.resolved import ResolvedMotion
from uvms_gym.envs._options import Options, native

#: Where shipped policies and tuned gains lie.
PRETRAINED = Path(__file__).parents[1] / "pretrained"
#: What stands before the file of a neural policy.
MLP_PREFIX = "mlp:"
#: What learned corrections are limited to where their file does not say it.
LIMIT = 0.3

#: Tasks by the names that environments and policies have for them.
TASKS = {"station-keep": "UVMS-StationKeep", "ee-track": "UVMS-EETrack"}
_STATION, _TRACK = (("station-keep",), ("ee-track",))
_BOTH = (*_STATION, *_TRACK)


class Classical(NamedTuple):
    """A controller that needs no policy: its class, the tasks it is for, and arguments besides its gains."""

    kind: type[Any]
    tasks: tuple[str, ...] = _STATION
    arguments: dict[str, Any] = {}  # noqa: RUF012 (never changed)


class Learned(NamedTuple):
    """A controller of shipped policies: the tasks it is for, and what its policies correct."""

    tasks: tuple[str, ...]
    base: str | None = None


CLASSICAL: dict[str, Classical] = {
    "none": Classical(NoControl, _BOTH),
    "pd": Classical(PD),
    "pd-restoring": Classical(PDRestoring),
    "pid": Classical(PID),
    "dob": Classical(DOB),
    "dob-delay": Classical(DOB, arguments={"delay": None}),
    "dob-calm": Classical(DOB, arguments={"delay": None}),
    "computed-torque": Classical(ComputedTorque),
    "mpc": Classical(MPC),
    "resolved": Classical(ResolvedMotion, _TRACK),
    "resolved-pid": Classical(ResolvedMotion, _TRACK, {"integral": 0.5}),
    "resolved-dob": Classical(ResolvedMotion, _TRACK, {"observer": (4.0, 4.0, 8.0), "delay": 1}),
}
LEARNED: dict[str, Learned] = {
    "ppo": Learned(_BOTH),
    "ppo-pd": Learned(_STATION, "pd"),
    "ppo-dob": Learned(_STATION, "dob-delay"),
    "ppo-resolved-dob": Learned(_TRACK, "resolved-dob"),
}
#: All controllers, of whatever task; `mlp:FILE` besides.
NAMES = (*CLASSICAL, *LEARNED)


class Unavailable(ValueError):
    """The controller is known, but nothing is shipped that it could be made of."""


def names(task: str | None = None) -> tuple[str, ...]:
    """Names of the controllers for a task ("station-keep" or "ee-track"), or of all."""
    return tuple(name for name in NAMES if task is None or task in _entry(name).tasks)


def make_controller(
    name: str,
    env: Any = None,
    *,
    gains: Literal["tuned", "scene"] = "tuned",
    seed: int | None = None,
    **options: Unpack[Options],
) -> Controller:
    """Make a controller by its name.

    Parameters
    ----------
    name : str
        One of `NAMES`, or `mlp:FILE`.
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        The environment that it is for.
    gains : {"tuned", "scene"}
        Gains of classical controllers: those that are shipped for this task, scene and control period, the class's own
        where there are none; or its own in any case.
    seed : int or None
        Training seed of the policy; None: the first that is shipped.
    **options
        Without `env`: arguments of its environment, and `task` ("station-keep" or "ee-track").

    Raises
    ------
    ValueError
        The name is not known for this task, the policy is for something else, or a file is broken. `Unavailable` where
        no such policy is shipped; the message names what is.
    TypeError
        `env` is something else, or options are given besides.
    OSError
        A file cannot be read.
    """
    if gains not in ("tuned", "scene"):
        raise ValueError(f"gains is {gains!r}, but must be 'tuned' or 'scene'")
    # Of the disturbance some controllers have to know the sensors' delay.
    given = options_of("controller", env, options, "disturbance")
    task = given.get("task", "station-keep")
    if name.startswith(MLP_PREFIX):
        return MLP.load(name.removeprefix(MLP_PREFIX), **given)
    check_name(name, task)
    if name in CLASSICAL:
        return _classical(name, given, gains)
    file = policy_file(name, seed, **given)
    base = LEARNED[name].base
    if base is None:
        return MLP.load(file, **given)
    correction = MLP.load(file, residual=True, **given)
    said = correction.notes.get("base", base)
    if said != base:
        raise ValueError(f"{file}: it corrects {said}, not {base}")
    try:
        # With the gains that it was trained with, whatever is tuned since.
        kind, _, arguments = CLASSICAL[base]
        corrected = kind(**{**arguments, **json.loads(correction.notes.get("base_gains", "{}"))}, **given)
        return Residual(corrected, correction, float(correction.notes.get("limit", LIMIT)))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file}: {error}") from None


def check_name(name: str, task: str) -> None:
    """Refuse a name that no controller for a task has.

    Raises
    ------
    ValueError
        The message lists the known ones.
    """
    if name not in names(task) and not name.startswith(MLP_PREFIX):
        what = f"controller {name!r} is not for {TASKS[task]}" if name in NAMES else f"unknown controller {name!r}"
        raise ValueError(f"{what}; known: {', '.join(names(task))}, {MLP_PREFIX}FILE")


def seeds(name: str, env: Any = None, **options: Unpack[Options]) -> tuple[int, ...]:
    """Training seeds of a learned controller's shipped policies for an environment; none of classical ones."""
    if name not in LEARNED:
        return ()
    return _shipped(options_of("controller", env, options)).get(name, ())


def available(env: Any = None, **options: Unpack[Options]) -> tuple[str, ...]:
    """Names of the controllers that there is all for: classical ones, and learned ones with a policy."""
    given = options_of("controller", env, options)
    shipped = _shipped(given)
    return tuple(name for name in names(given.get("task", "station-keep")) if name in CLASSICAL or name in shipped)


def folder(env: Any = None, **options: Unpack[Options]) -> Path:
    """Folder of what is shipped for an environment, whether it is there or not."""
    given = options_of("controller", env, options)
    made = native(given)
    task = TASKS[given.get("task", "station-keep")]
    return PRETRAINED / task / made.simulator.scene_name / f"{made.control_period:.6g}s"


def tuned(name: str, env: Any = None, **options: Unpack[Options]) -> dict[str, Any] | None:
    """Shipped gains of a classical controller: `gains` as its class takes them, and how they were found.

    None where there are none.

    Raises
    ------
    OSError, ValueError
        The file cannot be read, or is not as it should be.
    """
    file = folder(env, **options) / "gains.json"
    if not file.exists():
        return None
    try:
        stored = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{file}: no JSON: {error}") from None
    if not isinstance(stored, dict):
        raise ValueError(f"{file}: holds no dict of controllers")
    if name not in stored:
        return None
    entry = stored[name]
    if not isinstance(entry, dict) or not isinstance(entry.get("gains"), dict):
        raise ValueError(f"{file}: {name} has no dict of gains")
    return entry


def policy_file(name: str, seed: int | None = None, env: Any = None, **options: Unpack[Options]) -> Path:
    """File of a learned controller's shipped policy.

    Raises
    ------
    Unavailable
        There is none; the message names what there is.
    """
    given = options_of("controller", env, options)
    place, shipped = folder(**given), _shipped(given)
    task, scene, period = place.parts[-3:]
    where = f"{task}, scene {scene}, control period {period.removesuffix('s')} s, actions {_action(given)}"
    if name not in shipped:
        there = f"shipped for it: {', '.join(shipped)}" if shipped else f"shipped are {_places()}"
        raise Unavailable(f"no policy {name} is shipped for {where}; {there}")
    seed = shipped[name][0] if seed is None else seed
    if seed not in shipped[name]:
        known = ", ".join(map(str, shipped[name]))
        raise Unavailable(f"no policy {name} of training seed {seed} is shipped for {where}; its seeds: {known}")
    return place / f"{name}-{seed}.safetensors"


def _classical(name: str, given: Options, gains: str) -> Controller:
    entry = CLASSICAL.get(name)
    if entry is None:
        raise Unavailable(f"there is no controller {name} to be corrected")
    stored = tuned(name, **given) if gains == "tuned" else None
    if stored is None:
        made: Controller = entry.kind(**entry.arguments, **given)
        return made
    try:
        # Whatever a class does not know it takes for an option of an environment.
        if unknown := stored["gains"].keys() - _parameters(entry.kind):
            raise TypeError(f"unknown gain {min(unknown)!r}")
        made = entry.kind(**{**entry.arguments, **stored["gains"]}, **given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{folder(**given) / 'gains.json'}: {name}: {error}") from None
    return made


def _parameters(kind: type[Any]) -> set[str]:
    """Names of what a class and those that it is derived from take."""
    made = (vars(base)["__init__"] for base in kind.__mro__[:-1] if "__init__" in vars(base))
    return {name for function in made for name in inspect.signature(function).parameters}


def _entry(name: str) -> Classical | Learned:
    return CLASSICAL[name] if name in CLASSICAL else LEARNED[name]


def _shipped(given: Options) -> dict[str, tuple[int, ...]]:
    """Training seeds of the policies that are shipped for these options, by the learned controllers' names."""
    place = folder(**given)
    found: dict[str, list[int]] = {}
    # Policies are trained on wrenches.
    for file in os.listdir(place) if place.is_dir() and _action(given) == "wrench" else ():
        if (match := re.fullmatch(r"(.+)-(\d+)\.safetensors", file)) and match[1] in LEARNED:
            found.setdefault(match[1], []).append(int(match[2]))
    return {name: tuple(sorted(found[name])) for name in LEARNED if name in found}


def _action(given: Options) -> str:
    return given.get("action", "wrench")


def _places() -> str:
    """Say what policies are shipped for, whatever it is."""
    found = sorted({file.parent.relative_to(PRETRAINED) for file in PRETRAINED.glob("*/*/*s/*.safetensors")})
    return "those for " + "; ".join(" ".join(place.parts) for place in found) if found else "none"
