"""Making of controllers by name, with tuned gains or a shipped policy.

Tuned gains and policies for a task, a scene and a control period lie in one folder, `TASK/SCENE/PERIODs`: the gains as
`gains.json`, the policy of training seed S as `NAME-S.safetensors`, with a hyphen for the name's slash. The package has
the policies of training seed 0 of all rivals; a checkout has all others in `training/policies`.
"""

import functools
import json
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import gymnasium

from uvms_gym import _core
from uvms_gym._task.options import native, option_names
from uvms_gym.controllers.base import Controller, given_options, options_of
from uvms_gym.controllers.blend import Blend
from uvms_gym.controllers.contract import differences, policy_contract, refused
from uvms_gym.controllers.families import (
    CODE_PREFIX,
    CONTROLLERS,
    MLP_PREFIX,
    TASKS,
    ControllerEntry,
    canonical,
    is_learned,
    names,
    role,
)
from uvms_gym.controllers.mlp import MLP, Residual
from uvms_gym.controllers.universal import PERIOD, UniversalPolicy

#: Folder of the package's policies, tuned gains and stored results.
PRETRAINED = Path(__file__).parents[1] / "pretrained"
#: Folders of policies like it, in the order of the search: also the checkout's, if the package is run from one.
FOLDERS = [PRETRAINED, *Path(__file__).parents[2].glob("training/policies")]
#: Limit of learned corrections whose file has none.
LIMIT = 0.3


class Unavailable(ValueError):
    """No policy is there for a known controller."""


class ControllerWarning(UserWarning):
    """A controller is used where it was not tuned or trained for, and may be unstable."""


@contextmanager
def policies_in(folder: Path) -> Iterator[None]:
    """Search a folder of policies, too, for the duration of a block.

    Raises
    ------
    ValueError
        It has none.
    """
    if not any(folder.glob("*/*/*s/*.safetensors")):
        raise ValueError(f"{folder} has no policies TASK/SCENE/PERIODs/NAME-SEED.safetensors")
    FOLDERS.append(folder)
    try:
        yield
    finally:
        FOLDERS.remove(folder)


def make_controller(
    name: str,
    setting: Any = None,
    env: Any = None,
    *,
    gains: Literal["tuned", "scene"] = "tuned",
    seed: int | None = None,
    **options: Any,
) -> Controller:
    """Make a controller by its name, with tuned gains or a shipped policy.

    `make_controller("pd", env)` has tuned gains where the package ships them; `PD(env)`, and
    `make_controller("pd", env, gains="scene")`, have the scene's gains. `make_controller("dob", "calm", env)` and
    `make_controller("dob/calm", env)` are the same. `uvms controllers` lists all controllers.

    Parameters
    ----------
    name : str
        Family, or `FAMILY/SETTING`, or `mlp:FILE`.
    setting : str or None
        Setting of the family; it may be left out before `env`. None: the one in the name, or the default.
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        Environment of the controller.
    gains : {"tuned", "scene"}
        Gains of classical controllers. "tuned": those shipped for this task, scene and control period, the class's
        defaults where none are, or where measurements are older than in tuning and the controller does not predict over
        that; "scene": the class's defaults, which are the scene's `kp` and `kd`.
    seed : int or None
        Training seed of the policy; None: the first that is there.
    **options
        Without `env`: arguments of its environment, and `task`, by default "station-keep".

    Warns
    -----
    ControllerWarning
        Measurements are older than those the controller was tuned with. For a policy: a number of the scene, delay,
        lag, noise, disturbance or an option of the task is beyond those of its training.

    Raises
    ------
    ValueError
        An unknown name for this task, a policy of another environment or with other scales and limits, or a broken
        file. `Unavailable` where there is no such policy; the message names those that are there.
    TypeError
        `name` or `env` is something else, or options are given besides.
    OSError
        A file cannot be read.
    """
    if gains not in ("tuned", "scene"):
        raise ValueError(f"gains is {gains!r}, but must be 'tuned' or 'scene'")
    if not isinstance(name, str):
        raise TypeError(f"name must be a string, not {type(name).__name__}")
    if name.startswith(CODE_PREFIX):
        raise ValueError(f"{name!r} names Python code, which only commands and comparisons run: import it instead")
    if env is None and not isinstance(setting, str):
        setting, env = None, setting
    # Some controllers need the sensors' delay, which belongs to the disturbance.
    given = options_of("controller", env, options, "disturbance")
    name = canonical(name, setting, given.get("task", "station-keep"))
    whole = {key: value for key, value in given_options("controller", env, options).items() if key in option_names()}
    if name.startswith(MLP_PREFIX):
        policy = MLP.load(name.removeprefix(MLP_PREFIX), **given)
        if whole:
            _check_training(name, policy, whole)
        return policy
    entry = CONTROLLERS[name]
    if entry.kind is not None:
        return _classical(entry, given, gains)
    if parts := entry.setting.parts:
        made = [make_controller(part, env=env, gains=gains, seed=seed, **options) for part in parts]
        return Blend(made, list(parts.values()), entry.setting.guard, **given)
    file, base = _policy_file(name, seed, given), entry.setting.base
    if role(name) == "general":
        policy = _universal(file, whole)
        _check_training(name, policy, whole)
        return policy
    policy = MLP.load(file, residual=base is not None, **given)
    _check_training(name, policy, whole)
    if base is None:
        return policy
    said = policy.notes.get("base", base)
    if said != base:
        raise ValueError(f"{file}: its base is {said}, but must be {base}")
    try:
        # The gains of its training, not those tuned since.
        corrected = CONTROLLERS[base].make(json.loads(policy.notes.get("base_gains", "{}")), **given)
        return Residual(corrected, policy, float(policy.notes.get("limit", LIMIT)))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file}: {error}") from None


def policies(env: Any = None, **options: Any) -> dict[str, dict[int, Path]]:
    """Files of policies for an environment, by controller and training seed."""
    given = options_of("controller", env, options)
    # Policies are trained on wrenches.
    if given.get("action", "wrench") != "wrench":
        return {}
    at = place(**given)
    found = policies_at(at)
    if at.parts[2] == f"{PERIOD:g}s" and all(entry["scale"][0] > 0.0 for entry in native(given).action_layout):
        found |= _general(at.parts[0])
    return _with_means(found)


def available(env: Any = None, **options: Any) -> tuple[str, ...]:
    """Controllers available for this task: classical ones, and those with a policy."""
    given = options_of("controller", env, options)
    there = policies(**given)
    return tuple(name for name in names(given.get("task", "station-keep")) if not is_learned(name) or name in there)


def place(env: Any = None, **options: Any) -> Path:
    """Place of gains and policies for an environment, relative to `PRETRAINED` and other folders."""
    given = options_of("controller", env, options)
    made = native(given)
    task = TASKS[given.get("task", "station-keep")]
    return Path(task, made.snapshot().scene_name, f"{made.control_period:.6g}s")


def tuned(name: str, env: Any = None, **options: Any) -> dict[str, Any] | None:
    """Shipped gains of a classical controller: `gains` as its class takes them, and the record of their tuning.

    None where none are shipped.

    Raises
    ------
    OSError, ValueError
        The file cannot be read or is malformed.
    """
    return tuned_at(name, place(env, **options))


def tuned_at(name: str, at: Path) -> dict[str, Any] | None:
    """As `tuned`, for a place."""
    name = canonical(name)
    name = CONTROLLERS[name].setting.tuned or name
    file = PRETRAINED / at / "gains.json"
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


def _policy_file(name: str, seed: int | None, given: dict[str, Any]) -> Path:
    there = policies(**given)
    task, scene, period = place(**given).parts
    if role(name) == "general":
        # The policy itself says what it is for.
        there |= _general(task)
    where = (
        f"{task}, scene {scene}, control period {period.removesuffix('s')} s, actions {given.get('action', 'wrench')}"
    )
    if name not in there:
        others = f"for it: {', '.join(there)}" if there else _places()
        raise Unavailable(f"no policy {name} is there for {where}; {others} (a checkout has more in training/policies)")
    files = there[name]
    seed = min(files) if seed is None else seed
    if seed not in files:
        known = ", ".join(map(str, files))
        raise Unavailable(f"no policy {name} of training seed {seed} is there for {where}; its seeds: {known}")
    return files[seed]


def _general(task: str) -> dict[str, dict[int, Path]]:
    """Files of the policies for any scene, by controller and training seed."""
    found: dict[str, dict[int, Path]] = {}
    for name in (name for name in names(learned=True) if role(name) == "general"):
        files = [file for folder in FOLDERS for file in sorted((folder / task).glob(f"{name}-*.safetensors"))]
        if files:
            found[name] = {int(file.stem.rpartition("-")[2]): file for file in reversed(files)}
    return found


def _universal(file: Path, options: dict[str, Any]) -> MLP:
    policy = UniversalPolicy.load(file)
    try:
        return policy.network(**options)
    except ValueError as error:
        raise Unavailable(str(error)) from None


def _classical(entry: ControllerEntry, given: dict[str, Any], gains: str) -> Controller:
    at = place(**given)
    if gains == "scene" or (stored := tuned_at(entry.name, at)) is None:
        return entry.make({}, **given)
    try:
        assert entry.kind is not None
        # The class would take other names for options of an environment.
        if unknown := stored["gains"].keys() - set(_core.gain_names(entry.kind.kind)):
            raise TypeError(f"unknown gain {min(unknown)!r}")
        made = entry.make(stored["gains"], **given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{PRETRAINED / at / 'gains.json'}: {entry.name}: {error}") from None
    if entry.setting.role == "bound":
        return made
    tuned_in, bridged = stored.get("tuning", {}).get("env"), made.gains.get("delay")
    return entry.make({}, **given) if _warn_of_delay(entry.name, tuned_in, native(given).delays, bridged) else made


def _check_training(name: str, policy: MLP, options: dict[str, Any]) -> None:
    """Compare an environment with the contract of a policy's training.

    Other units, scales and limits of an entry are refused. Of all else beyond the training one warning is given.
    """
    there, here = training_contract(policy), policy_contract(**options)
    if apart := list(refused(there, here)):
        raise ValueError(f"{name}: the policy does not fit: {'; '.join(apart)}")
    if apart := list(differences(there, here, beyond=True)):
        env = policy.notes.get("environment", "another environment")
        warnings.warn(
            f"{name} was trained in {env}; here {'; '.join(apart)}: it may be unstable", ControllerWarning, stacklevel=3
        )


def training_contract(policy: MLP) -> dict[str, Any]:
    """Contract of a policy's training, from its file; {} if unknown.

    Older files have only the name and the arguments of the environment: its contract is as of now, without the scene
    and the entries where the policy's scene is none of the package.
    """
    try:
        if (text := policy.notes.get("contract")) is not None:
            return dict(json.loads(text))
        found = design(policy.notes["environment"], policy.notes.get("env_kwargs", "{}"))
    except (KeyError, TypeError, ValueError, gymnasium.error.Error):
        return {}  # Notes of another version.
    same = found["scene"]["name"] == (policy.spec or {}).get("scene")
    return found if same else {key: found[key] for key in ("delay", "thruster_lag", "level", "disturbance", "options")}


def _warn_of_delay(name: str, env: str | None, delays: tuple[int, int], bridged: int | None) -> bool:
    """Warn of measurements older than those that a classical controller was tuned with, in `env`.

    They make controllers unstable but those that predict over them: over `bridged` control periods. True where the
    controller should have its default gains, which are lower.
    """
    if env not in gymnasium.registry:
        return False
    (low, high), (minimum, maximum) = design(env, "{}")["delay"], delays
    if bridged == minimum == maximum or maximum <= high:
        return False
    defaults = minimum == maximum
    designed, found = (f"{a} to {b}" if a < b else f"{a}" for a, b in ((low, high), (minimum, maximum)))
    warnings.warn(
        f"{name} was tuned in {env}; here delay is {found} instead of {designed} control periods: "
        f"{'default gains take the place of tuned ones' if defaults else 'it may be unstable'}",
        ControllerWarning,
        stacklevel=4,
    )
    return defaults


@functools.cache
def design(env: str, arguments: str) -> dict[str, Any]:
    """Contract of a registered environment with arguments as JSON; a scene in a file of its own does not count."""
    spec = gymnasium.spec(env)
    task = next(task for task, name in TASKS.items() if str(spec.name).startswith(name))
    given = {"task": task, **spec.kwargs, **json.loads(arguments)}
    if given.get("scene") not in _core.scene_names():
        given.pop("scene", None)
    return policy_contract(**{key: value for key, value in given.items() if key in option_names()})


def policies_at(at: Path) -> dict[str, dict[int, Path]]:
    """Files of the policies for a place, by controller and training seed; of a mean the files of its policy."""
    learned = {name.replace("/", "-"): name for name in names(learned=True)}
    found: dict[str, dict[int, Path]] = {name: {} for name in learned.values()}
    for folder in (folder / at for folder in FOLDERS if (folder / at).is_dir()):
        for file in sorted(os.listdir(folder)):
            stem, _, seed = file.removesuffix(".safetensors").rpartition("-")
            if file.endswith(".safetensors") and stem in learned and seed.isdecimal():
                found[learned[stem]].setdefault(int(seed), folder / file)
    return _with_means({name: dict(sorted(files.items())) for name, files in found.items() if files})


def _with_means(found: dict[str, dict[int, Path]]) -> dict[str, dict[int, Path]]:
    """Also means of controllers, with the files of their policies."""
    first = {name: next(iter(entry.setting.parts), "") for name, entry in CONTROLLERS.items()}
    return found | {name: found[policy] for name, policy in first.items() if policy in found}


def _places() -> str:
    """Environments that there are policies for, as text."""
    found = {file.parent.relative_to(folder) for folder in FOLDERS for file in folder.glob("*/*/*s/*.safetensors")}
    return "policies are for " + "; ".join(" ".join(one.parts) for one in sorted(found)) if found else "there are none"
