"""Controllers by name: classical ones with tuned gains, and learned ones with shipped policies.

Tuned gains and policies for a task, a scene and a control period lie in one folder, `pretrained/TASK/SCENE/PERIODs`:
the gains as `gains.json`, the policy of training seed S as `NAME-S.safetensors`.
"""

import functools
import json
import os
import re
import warnings
from pathlib import Path
from typing import Any, Literal, NamedTuple

import gymnasium

from uvms_gym import _core
from uvms_gym._task.options import native
from uvms_gym.controllers.base import ClassicalController, Controller, options_of
from uvms_gym.controllers.feedback import PD, PID, DockPD, NoControl, PDRestoring
from uvms_gym.controllers.mlp import MLP, Residual
from uvms_gym.controllers.model_based import (
    DOB,
    MPC,
    NMPC,
    AdaptiveDOB,
    AdaptiveResolvedMotion,
    ComputedTorque,
    ResolvedMotion,
)

#: Folder of shipped policies and tuned gains.
PRETRAINED = Path(__file__).parents[1] / "pretrained"
#: Prefix of the file of a neural policy.
MLP_PREFIX = "mlp:"
#: Limit of learned corrections whose file has none.
LIMIT = 0.3

#: Names of tasks in environments' ids.
TASKS = dict(_core.tasks())
#: Basic controller of each task.
BASELINE = {"station-keep": "pd", "ee-track": "resolved", "dock": "dock-pd"}
_STATION, _TRACK, _DOCK = (("station-keep",), ("ee-track",), ("dock",))
_ALL = tuple(TASKS)


class ClassicalEntry(NamedTuple):
    """Classical controller: class, tasks, gains of this variant, and its role in comparisons.

    A "rival" takes part in all of them. "frontier": a variant with another limit on its commands. "bound": it is shown
    the true, present state, without noise and delay.
    """

    kind: type[ClassicalController]
    tasks: tuple[str, ...] = _STATION
    gains: dict[str, Any] = {}  # noqa: RUF012 (never changed)
    role: Literal["rival", "frontier", "bound"] = "rival"


class LearnedEntry(NamedTuple):
    """Learned controller: tasks, the base controller of residual policies, and its role as that of a classical one."""

    tasks: tuple[str, ...]
    base: str | None = None
    role: Literal["rival", "frontier"] = "rival"


_RESOLVED_DOB = {"observer_bandwidth": (4.0, 4.0, 8.0), "delay": None}
CLASSICAL: dict[str, ClassicalEntry] = {
    "none": ClassicalEntry(NoControl, _ALL),
    "pd": ClassicalEntry(PD),
    "pd-restoring": ClassicalEntry(PDRestoring),
    "pid": ClassicalEntry(PID),
    "dob": ClassicalEntry(DOB),
    "dob-delay": ClassicalEntry(DOB, gains={"delay": None}),
    "dob-still": ClassicalEntry(DOB, gains={"delay": None}, role="frontier"),
    "dob-calm": ClassicalEntry(DOB, gains={"delay": None}),
    "dob-medium": ClassicalEntry(DOB, gains={"delay": None}, role="frontier"),
    "dob-free": ClassicalEntry(DOB, gains={"delay": None}, role="frontier"),
    "dob-wide": ClassicalEntry(DOB, gains={"delay": None}),
    "dob-adaptive": ClassicalEntry(AdaptiveDOB),
    "dob-informed": ClassicalEntry(DOB, role="bound"),
    "computed-torque": ClassicalEntry(ComputedTorque),
    "mpc": ClassicalEntry(MPC),
    "mpc-free": ClassicalEntry(MPC, role="frontier"),
    "resolved": ClassicalEntry(ResolvedMotion, _TRACK),
    "resolved-pid": ClassicalEntry(ResolvedMotion, _TRACK, {"integral_gain": 0.5}),
    "resolved-dob": ClassicalEntry(ResolvedMotion, _TRACK, _RESOLVED_DOB),
    "resolved-dob-still": ClassicalEntry(ResolvedMotion, _TRACK, _RESOLVED_DOB, "frontier"),
    "resolved-dob-calm": ClassicalEntry(ResolvedMotion, _TRACK, _RESOLVED_DOB, "frontier"),
    "resolved-dob-medium": ClassicalEntry(ResolvedMotion, _TRACK, _RESOLVED_DOB, "frontier"),
    "resolved-dob-free": ClassicalEntry(ResolvedMotion, _TRACK, _RESOLVED_DOB, "frontier"),
    "resolved-wide": ClassicalEntry(ResolvedMotion, _TRACK, _RESOLVED_DOB),
    "resolved-adaptive": ClassicalEntry(AdaptiveResolvedMotion, _TRACK),
    "resolved-informed": ClassicalEntry(ResolvedMotion, _TRACK, {**_RESOLVED_DOB, "delay": 0}, "bound"),
    "nmpc": ClassicalEntry(NMPC, (*_STATION, *_TRACK)),
    "dock-pd": ClassicalEntry(DockPD, _DOCK),
}
LEARNED: dict[str, LearnedEntry] = {
    "ppo": LearnedEntry(_ALL),
    "ppo-still": LearnedEntry((*_STATION, *_TRACK), role="frontier"),
    "ppo-calm": LearnedEntry((*_STATION, *_TRACK), role="frontier"),
    "ppo-quick": LearnedEntry((*_STATION, *_TRACK), role="frontier"),
    "ppo-free": LearnedEntry((*_STATION, *_TRACK), role="frontier"),
    "shac": LearnedEntry(_TRACK),
    "shac-still": LearnedEntry(_TRACK, role="frontier"),
    "shac-calm": LearnedEntry(_TRACK, role="frontier"),
    "shac-quick": LearnedEntry(_TRACK, role="frontier"),
    "shac-free": LearnedEntry(_TRACK, role="frontier"),
    "shac-distilled": LearnedEntry(_STATION),
    "shac-distilled-still": LearnedEntry(_STATION, role="frontier"),
    "shac-distilled-calm": LearnedEntry(_STATION),
    "shac-distilled-medium": LearnedEntry(_STATION, role="frontier"),
    "shac-distilled-free": LearnedEntry(_STATION, role="frontier"),
    "shac-distilled-wide": LearnedEntry(_STATION),
    "shac-wide": LearnedEntry(_TRACK),
    "ppo-pd": LearnedEntry(_STATION, "pd"),
    "ppo-dob": LearnedEntry(_STATION, "dob-delay"),
    "ppo-resolved-dob": LearnedEntry(_TRACK, "resolved-dob"),
}
#: All controllers of all tasks, without `mlp:FILE`.
NAMES = (*CLASSICAL, *LEARNED)
#: Families along the frontier: a controller under several limits on its commands, or prices of them.
FAMILIES = {
    "observer": (
        *("dob-still", "dob-calm", "dob-medium", "dob-delay", "dob-free"),
        *("resolved-dob-still", "resolved-dob-calm", "resolved-dob-medium", "resolved-dob", "resolved-dob-free"),
    ),
    "MPC": ("mpc", "mpc-free"),
    "PPO": ("ppo-still", "ppo-calm", "ppo", "ppo-quick", "ppo-free"),
    "SHAC": ("shac-still", "shac-calm", "shac", "shac-quick", "shac-free"),
    "SHAC, distilled": (
        *("shac-distilled-still", "shac-distilled-calm", "shac-distilled-medium"),
        *("shac-distilled", "shac-distilled-free"),
    ),
}
_ENTRIES: dict[str, ClassicalEntry | LearnedEntry] = {**CLASSICAL, **LEARNED}


class Unavailable(ValueError):
    """No policy is shipped for a known controller."""


class ControllerWarning(UserWarning):
    """A controller is used where it was not tuned or trained for, and may be unstable."""


def is_bound(name: str) -> bool:
    """True for a controller that comparisons show the true, present state: it bounds the others."""
    return name in CLASSICAL and CLASSICAL[name].role == "bound"


def rivals(task: str) -> tuple[str, ...]:
    """Names of the controllers of a task, without variants along the frontier and bounds."""
    return tuple(name for name in names(task) if _ENTRIES[name].role == "rival")


def names(task: str | None = None) -> tuple[str, ...]:
    """Names of the controllers of a task, such as "station-keep", or of all tasks."""
    return tuple(name for name, entry in _ENTRIES.items() if task is None or task in entry.tasks)


def make_controller(
    name: str, env: Any = None, *, gains: Literal["tuned", "scene"] = "tuned", seed: int | None = None, **options: Any
) -> Controller:
    """Make a controller by its name, with tuned gains or a shipped policy.

    `make_controller("pd", env)` has tuned gains where the package ships them; `PD(env)`, and
    `make_controller("pd", env, gains="scene")`, have those of the scene.

    Parameters
    ----------
    name : str
        One of `NAMES`, or `mlp:FILE`.
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        Environment of the controller.
    gains : {"tuned", "scene"}
        Gains of classical controllers. "tuned": those shipped for this task, scene and control period, the class's
        defaults where none are, or where measurements are older than in tuning and the controller does not predict over
        that; "scene": the class's defaults, which are the scene's `kp` and `kd`.
    seed : int or None
        Training seed of the policy; None: the first shipped one.
    **options
        Without `env`: arguments of its environment, and `task`, by default "station-keep".

    Warns
    -----
    ControllerWarning
        Measurements are older than those the controller was tuned or trained with, or for a policy younger.

    Raises
    ------
    ValueError
        An unknown name for this task, a policy of another environment, or a broken file. `Unavailable` where no such
        policy is shipped; the message names those that are.
    TypeError
        `env` is something else, or options are given besides.
    OSError
        A file cannot be read.
    """
    if gains not in ("tuned", "scene"):
        raise ValueError(f"gains is {gains!r}, but must be 'tuned' or 'scene'")
    # Some controllers need the sensors' delay, which belongs to the disturbance.
    given = options_of("controller", env, options, "disturbance")
    task = given.get("task", "station-keep")
    if name.startswith(MLP_PREFIX):
        policy = MLP.load(name.removeprefix(MLP_PREFIX), **given)
        if given:
            _warn_of_training(name, policy.notes, given)
        return policy
    check_name(name, task)
    if name in CLASSICAL:
        return _classical(name, given, gains)
    made = native(given)
    file = _policy_file(name, seed, given, _folder(given, made))
    base = LEARNED[name].base
    policy = MLP.load(file, residual=base is not None, **given)
    _warn_of_training(name, policy.notes, given)
    if base is None:
        return policy
    said = policy.notes.get("base", base)
    if said != base:
        raise ValueError(f"{file}: its base is {said}, but must be {base}")
    try:
        # The gains of its training, not those tuned since.
        entry = CLASSICAL[base]
        corrected = entry.kind(**{**entry.gains, **json.loads(policy.notes.get("base_gains", "{}"))}, **given)
        return Residual(corrected, policy, float(policy.notes.get("limit", LIMIT)))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file}: {error}") from None


def check_name(name: str, task: str) -> None:
    """Refuse a name that is not a controller of a task.

    Raises
    ------
    ValueError
        The message lists the known ones.
    """
    if name not in names(task) and not name.startswith(MLP_PREFIX):
        what = f"controller {name!r} is not for {TASKS[task]}" if name in NAMES else f"unknown controller {name!r}"
        raise ValueError(f"{what}; known: {', '.join(names(task))}, {MLP_PREFIX}FILE")


def seeds(name: str, env: Any = None, **options: Any) -> tuple[int, ...]:
    """Training seeds of a learned controller's shipped policies for an environment; none for classical ones."""
    if name not in LEARNED:
        return ()
    given = options_of("controller", env, options)
    return _shipped(given, folder(**given)).get(name, ())


def available(env: Any = None, **options: Any) -> tuple[str, ...]:
    """Controllers available for this task (gains or policy shipped)."""
    given = options_of("controller", env, options)
    shipped = _shipped(given, folder(**given))
    return tuple(name for name in names(given.get("task", "station-keep")) if name in CLASSICAL or name in shipped)


def folder(env: Any = None, **options: Any) -> Path:
    """Folder of shipped gains and policies for an environment; it may not exist."""
    given = options_of("controller", env, options)
    return _folder(given, native(given))


def _folder(given: dict[str, Any], made: _core.Task) -> Path:
    task = TASKS[given.get("task", "station-keep")]
    return PRETRAINED / task / made.snapshot().scene_name / f"{made.control_period:.6g}s"


def tuned(name: str, env: Any = None, **options: Any) -> dict[str, Any] | None:
    """Shipped gains of a classical controller: `gains` as its class takes them, and the record of their tuning.

    None where none are shipped.

    Raises
    ------
    OSError, ValueError
        The file cannot be read or is malformed.
    """
    return _tuned(name, folder(env, **options) / "gains.json")


def _tuned(name: str, file: Path) -> dict[str, Any] | None:
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


def policy_file(name: str, seed: int | None = None, env: Any = None, **options: Any) -> Path:
    """File of a learned controller's shipped policy.

    Raises
    ------
    Unavailable
        None is shipped; the message names those that are.
    """
    given = options_of("controller", env, options)
    return _policy_file(name, seed, given, folder(**given))


def _policy_file(name: str, seed: int | None, given: dict[str, Any], place: Path) -> Path:
    shipped = _shipped(given, place)
    task, scene, period = place.parts[-3:]
    where = (
        f"{task}, scene {scene}, control period {period.removesuffix('s')} s, actions {given.get('action', 'wrench')}"
    )
    if name not in shipped:
        there = f"shipped for it: {', '.join(shipped)}" if shipped else f"shipped are {_places()}"
        raise Unavailable(f"no policy {name} is shipped for {where}; {there}")
    seed = shipped[name][0] if seed is None else seed
    if seed not in shipped[name]:
        known = ", ".join(map(str, shipped[name]))
        raise Unavailable(f"no policy {name} of training seed {seed} is shipped for {where}; its seeds: {known}")
    return place / f"{name}-{seed}.safetensors"


def _classical(name: str, given: dict[str, Any], gains: str) -> Controller:
    entry = CLASSICAL[name]
    if gains == "scene":
        return entry.kind(**entry.gains, **given)
    task = native(given)
    file = _folder(given, task) / "gains.json"
    stored = _tuned(name, file)
    if stored is None:
        return entry.kind(**entry.gains, **given)
    try:
        # The class would take other names for options of an environment.
        if unknown := stored["gains"].keys() - set(_core.gain_names(entry.kind.kind)):
            raise TypeError(f"unknown gain {min(unknown)!r}")
        made = entry.kind(**{**entry.gains, **stored["gains"]}, **given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file}: {name}: {error}") from None
    if entry.role == "bound":
        return made
    late = _warn_of_delay(name, stored.get("tuning", {}).get("env"), task, made.gains.get("delay"))
    return entry.kind(**entry.gains, **given) if late else made


def _warn_of_training(name: str, notes: dict[str, str], given: dict[str, Any]) -> None:
    """Warn of measurements of another age, and of thrusters with another lag, than a policy was trained with."""
    env, arguments = notes.get("environment"), notes.get("env_kwargs", "{}")
    try:
        _warn_of_delay(name, env, native(given), arguments=arguments)
        lag = _design(str(env), arguments)[1] if env in gymnasium.registry else given.get("thruster_lag")
    except (TypeError, ValueError):
        return  # Notes of another version.
    if lag != (here := given.get("thruster_lag")):
        trained, found = ("as in the scene" if one is None else f"{one:g} s" for one in (lag, here))
        warnings.warn(
            f"{name} was trained in {env} with thruster_lag {trained}; here it is {found}: it may be much worse",
            ControllerWarning,
            stacklevel=3,
        )


def _warn_of_delay(
    name: str, env: str | None, made: _core.Task, bridged: int | None = None, arguments: str = "{}"
) -> bool:
    """Warn of measurements whose age differs from those that a controller was tuned or trained with, in `env`.

    Later ones make controllers unstable but those that predict over them: over `bridged` control periods. Policies do
    not stand earlier ones either. True where a classical controller should have its default gains, which are lower.
    """
    if env not in gymnasium.registry:
        return False
    (low, high), (minimum, most) = _design(env, arguments)[0], made.delays
    if bridged == minimum == most or (most <= high and (minimum >= low or name in CLASSICAL)):
        return False
    defaults = name in CLASSICAL and minimum == most
    designed, found = (f"{a} to {b}" if a < b else f"{a}" for a, b in ((low, high), (minimum, most)))
    warnings.warn(
        f"{name} was tuned or trained in {env}, for measurements {designed} control periods old; here they are "
        f"{found}: {'default gains take the place of tuned ones' if defaults else 'it may be unstable'}",
        ControllerWarning,
        stacklevel=4,
    )
    return defaults


@functools.cache
def _design(env: str, arguments: str) -> tuple[tuple[int, int], float | None]:
    """Minimum and maximum age of the measurements, control periods, and the thrusters' lag, s (None: the scene's).

    Of a registered environment with arguments as JSON.
    """
    spec = gymnasium.spec(env)
    task = next(task for task, name in TASKS.items() if str(spec.name).startswith(name))
    given = {"task": task, **spec.kwargs, **json.loads(arguments)}
    matters = {key: given[key] for key in ("task", "dt", "substeps", "disturbance", "thruster_lag") if key in given}
    return native(matters).delays, given.get("thruster_lag")


def _shipped(given: dict[str, Any], place: Path) -> dict[str, tuple[int, ...]]:
    """Training seeds of the policies in a folder that are for these options, by controller."""
    found: dict[str, list[int]] = {}
    # Policies are trained on wrenches.
    for file in os.listdir(place) if place.is_dir() and given.get("action", "wrench") == "wrench" else ():
        if (match := re.fullmatch(r"(.+)-(\d+)\.safetensors", file)) and match[1] in LEARNED:
            found.setdefault(match[1], []).append(int(match[2]))
    return {name: tuple(sorted(found[name])) for name in LEARNED if name in found}


def _places() -> str:
    """Environments that policies are shipped for, as text."""
    found = sorted({file.parent.relative_to(PRETRAINED) for file in PRETRAINED.glob("*/*/*s/*.safetensors")})
    return "those for " + "; ".join(" ".join(place.parts) for place in found) if found else "none"
