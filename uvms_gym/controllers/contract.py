"""Contract of a policy: the environment that it was trained in as plain data, and the differences from another one."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterator, Mapping
from typing import Any

from uvms_gym import _core
from uvms_gym._files import read_text
from uvms_gym._task.options import native, options_by_task
from uvms_gym.controllers.base import Controller, given_options
from uvms_gym.controllers.mlp import MLP

#: Version of the form.
FORM = "uvms-contract/1"
#: Leak of the error integral, 1/s.
LEAK = 0.1
#: Texts, sources and pictures in scenes, which are no numbers of the physics.
_NO_PHYSICS = ("provenance", "summary", "name", "shape", "meshes")
#: Options that the contract has under names of its own, and prices of the training.
_ELSEWHERE = (
    *("task", "action", "dt", "substeps", "end_effector", "disturbance", "max_current", "randomize", "thruster_lag"),
    "reward",
)
#: Computation of each block of an observation on a vehicle.
COMPUTATION = {
    "position_error": "measured position less the target, in axes of the frame as measured",
    "attitude_error": "angle times axis of the turn from the target to the frame as measured, at most pi long",
    "linear_velocity": "speed over ground, not relative to the water, at the vehicle's origin",
    "angular_velocity": "rate gyro less its bias",
    "relative_velocity": "speed over ground less that of the dock at the same instant",
    "relative_angular_velocity": "rate gyro less the turn rate of the dock",
    "up": "unit vector against gravity, by the attitude as measured",
    "joint_position": "joint encoder less the coordinate at home, `home` of the joint in the scene",
    "joint_rate": "joint rate, positive as the coordinate",
    "joint_reference": "reference one control period ahead less the coordinate at home",
    "joint_reference_rate": "rate of the reference one control period ahead",
    "reference_twist": "velocity of the reference now, in axes of the end effector as measured",
    "preview": "errors as position_error and attitude_error, against each of the next points of the reference",
    "fixture": "encoder of the fixture, or its coordinate by the end effector's pose as measured, and its rate",
    "contact_force": "force sensor at the wrist, turned to axes of the end effector, less the tool's own weight",
    "previous_action": "action of the last control instant, clipped to [-1, 1]; 0 at the first",
    "error_integral": "0 at the first control instant, then I = keep I + gain e with the errors e measured now",
}

#: Meaning of an entry of an action on a vehicle.
ACTION = "low at -1, 0 at 0, high at 1, linear on each side; beyond [-1, 1] clipped"


def policy_contract(env: Any = None, **options: Any) -> dict[str, Any]:
    """Contract of a policy in an environment, as plain data for JSON.

    Parameters
    ----------
    env : UVMS environment or None
    **options
        Without `env`: arguments of its environment, and `task`.

    Returns
    -------
    dict
        task; scene (name, digest, numbers by their keys); end_effector; action_kind; control_period, s; rate, Hz;
        delay, minimum and maximum age of the measurements, control periods; thruster_lag, s, None: the scene's; level,
        name of the disturbance; disturbance, its components, noise of the sensors among them; options of the task;
        integral, the discretisation of `error_integral`; observation and action, one dict per entry with name, unit,
        frame (the meaning with the axes), scale, low and high (physical values), and computation.

    Raises
    ------
    TypeError, ValueError
        `env` is something else, or options are unknown or out of range.
    """
    given = given_options("contract", env, options)
    task, made = options_by_task(given), native(given)
    # As the native module has them, with all defaults.
    resolved: dict[str, Any] = made.__getnewargs_ex__()[0][1]
    snapshot, period = made.snapshot(), made.control_period
    numbers = dict(_numbers(made.scene))
    numbers.pop("vehicle.thruster_lag", None)
    keep = math.exp(-LEAK * period)
    return {
        "form": FORM,
        "task": dict(_core.tasks())[task.task],
        "scene": {"name": snapshot.scene_name, "digest": _digest(numbers), "numbers": numbers},
        "end_effector": task.end_effector,
        "action_kind": task.action,
        "control_period": period,
        "rate": 1.0 / period,
        "delay": list(made.delays),
        "thruster_lag": task.thruster_lag,
        "level": task.disturbance if isinstance(task.disturbance, str) else None,
        "disturbance": _components(resolved),
        "options": {key: value for key, value in resolved.items() if key not in _ELSEWHERE},
        "integral": {"leak": LEAK, "keep": keep, "gain": (1.0 - keep) / LEAK},
        "observation": _entries(made.layout),
        "action": [{**entry, "computation": ACTION} for entry in _entries(made.action_layout)],
    }


def check_contract(
    given: Mapping[str, Any] | str | os.PathLike[str],
    env: Any = None,
    *,
    controller: Controller | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Refuse an environment, and a controller, that differ from a contract.

    Parameters
    ----------
    given : mapping or path
        Contract, or its JSON file.
    env : UVMS environment or None
    controller : Controller or None
        Controller that will run under the contract in place of the exported file: without a further delay, and if it is
        an `MLP` the same policy.
    **options
        Without `env`: arguments of its environment, and `task`.

    Returns
    -------
    dict
        The contract.

    Raises
    ------
    ValueError
        No contract, or one of another environment: one line with each difference and its size.
    TypeError
        `env` is something else.
    OSError
        The file cannot be read.
    """
    if isinstance(given, Mapping):
        place, found = "", dict(given)
    else:
        place = f"{os.fspath(given)}: "
        try:
            found = json.loads(read_text(given))
        except ValueError as error:
            raise ValueError(f"{place}no JSON: {error}") from None
    if not isinstance(found, dict) or found.get("form") != FORM:
        said = found.get("form") if isinstance(found, dict) else None
        raise ValueError(f"{place}no contract of uvms_gym: its form is {said!r}, but must be {FORM!r}")
    here = policy_contract(env, **options)
    try:
        apart = list(differences(found, here))
        if controller is not None:
            apart += _differences_of_controller(found, controller)
    except KeyError as error:
        raise ValueError(f"{place}no contract of uvms_gym: {error} is missing") from None
    except (AttributeError, TypeError, ValueError):
        raise ValueError(f"{place}no contract of uvms_gym: a part has another form") from None
    if apart:
        raise ValueError(f"{place}the environment differs from the contract: {'; '.join(apart)}")
    return found


def digest_of(policy: MLP) -> str:
    """SHA-256 of a policy's network, as in contracts."""
    return hashlib.sha256(policy.native.to_bytes()).hexdigest()


def _differences_of_controller(there: Mapping[str, Any], controller: Controller) -> Iterator[str]:
    """Differences of a controller from the exported policy of a contract."""
    if delay := there.get("further_delay", 0):
        yield _said("further_delay", 0, delay)
    own = there.get("policy")
    if own is not None and isinstance(controller, MLP) and (here := digest_of(controller)) != own["digest"]:
        yield f"the policy has the digest {here[:12]} instead of {own['digest'][:12]}"


def refused(there: Mapping[str, Any], here: Mapping[str, Any]) -> Iterator[str]:
    """The first difference that changes the meaning of an entry of the observation and of the action."""
    for part in ("observation", "action"):
        own, other = there.get(part), here[part]
        if own is None:
            continue
        if len(own) != len(other):
            yield f"{part} has {len(other)} entries instead of {len(own)}"
            continue
        pairs = (
            (one, found, key) for one, found in zip(own, other) for key in ("name", "unit", "scale", "low", "high")
        )
        apart = [pair for pair in pairs if not _equal(pair[0][pair[2]], pair[1][pair[2]])]
        if apart:
            one, found, key = apart[0]
            more = f", and {len(apart) - 1} more numbers of the {part}" if len(apart) > 1 else ""
            yield _said(f"{key} of {part} {one['name']}", found[key], one[key]) + more


def differences(there: Mapping[str, Any], here: Mapping[str, Any], *, beyond: bool = False) -> Iterator[str]:
    """Differences of a contract `here` from one `there`, which may lack parts, each once with its size.

    With `beyond` ranges within those of the training, and disturbances that it had besides, are no differences.
    """
    for key in ("task", "end_effector", "action_kind", "control_period"):
        if key in there and not _equal(there[key], here[key]):
            yield _said(key, here[key], there[key])
    if "scene" in there and there["scene"]["name"] != here["scene"]["name"]:
        yield _said("scene", here["scene"]["name"], there["scene"]["name"])
    else:
        if "scene" in there:
            yield from _largest(there["scene"]["numbers"], here["scene"]["numbers"], "", "scene")
        yield from refused(there, here)
    own, other = there.get("delay"), here["delay"]
    if own is not None and own != other and not (beyond and _within(other, own)):
        yield f"delay is {_span(other)} instead of {_span(own)} control periods"
    own, other = there.get("thruster_lag"), here["thruster_lag"]
    if "thruster_lag" in there and own != other:
        yield "thruster_lag is {} instead of {}".format(
            *("as in the scene" if one is None else f"{one:g} s" for one in (other, own))
        )
    if "disturbance" in there:
        for noise in (True, False):
            own, other = (_leaves(one["disturbance"], noise) for one in (there, here))
            if beyond:
                inside = {key for key in {**own, **other} if key not in other or _within(other[key], own.get(key, 0.0))}
                own, other = ({key: one[key] for key in one if key not in inside} for one in (own, other))
            levels = [one.get("level") for one in (here, there)]
            named = "disturbance" if None in levels or levels[0] == levels[1] else "disturbance ({} instead of {})"
            yield from _largest(own, other, *(("", "noise") if noise else (named.format(*levels) + " ", "disturbance")))
    for key, value in there.get("options", {}).items():
        if not _equal(value, found := here["options"].get(key)):
            yield _said(key, found, value)


def _largest(own: Mapping[str, Any], other: Mapping[str, Any], before: str, group: str) -> Iterator[str]:
    """The largest relative difference among numbers by keys, and the number of others."""
    apart = [key for key in {**own, **other} if not _equal(own.get(key), other.get(key))]
    if apart:
        worst = max(sorted(apart), key=lambda key: _size(other.get(key), own.get(key)))
        more = f", and {len(apart) - 1} more numbers of the {group}" if len(apart) > 1 else ""
        yield before + _said(worst, other.get(worst), own.get(worst)) + more


def _entries(layout: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """One dict per entry of an observation or an action."""
    entries = []
    for block in layout:
        name, length = block["name"], block["length"]
        for k in range(length):
            entries.append(
                {
                    "name": f"{name}[{k}]" if length > 1 else name,
                    "block": name,
                    "unit": block["unit"],
                    "frame": block["description"],
                    "scale": float(block["scale"][k]),
                    "low": float(block["low"][k]),
                    "high": float(block["high"][k]),
                    "computation": COMPUTATION.get(name, ""),
                }
            )
    return entries


def _components(options: dict[str, Any]) -> dict[str, Any]:
    """Components of a disturbance, by whichever way it is given."""
    if (text := options.get("disturbance")) is not None:
        return dict(json.loads(text))
    drawn = {"parameters": options["randomize"]} if "randomize" in options else {}
    return {"current": {"speed": [0.0, options["max_current"]]}, **drawn}


def _numbers(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Numbers and choices of a scene by their keys, without what does not concern the physics."""
    if isinstance(value, Mapping):
        for name, part in value.items():
            if name not in _NO_PHYSICS:
                yield from _numbers(part, f"{key}.{name}" if key else name)
    elif isinstance(value, list | tuple):
        for k, part in enumerate(value):
            yield from _numbers(part, f"{key}[{k}]")
    elif value is not None:
        yield key, value


def _leaves(components: Mapping[str, Any], noise: bool) -> dict[str, Any]:
    """Numbers and ranges of a disturbance by their keys, of its noise or of all else but the delay."""
    return {
        f"{name}.{key}": value
        for name, part in components.items()
        if part is not None and name != "delay" and (name == "noise") == noise
        for key, value in (part.items() if isinstance(part, Mapping) else [("on", part)])
    }


def _digest(numbers: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(numbers, sort_keys=True).encode()).hexdigest()


def _equal(one: Any, other: Any) -> bool:
    """Equal, numbers but for their last digits: they may have passed through a file."""
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_equal, one, other))
    if _is_number(one) and _is_number(other):
        return math.isclose(one, other, rel_tol=1e-9, abs_tol=0.0) or one == other
    return bool(one == other)


def _within(found: Any, allowed: Any) -> bool:
    """True for a number or range within another one."""
    spans = [one if isinstance(one, list | tuple) else [one, one] for one in (found, allowed)]
    if not all(len(span) == 2 and all(map(_is_number, span)) for span in spans):
        return False
    (low, high), (minimum, maximum) = spans
    return bool(minimum <= low and high <= maximum)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _size(here: Any, there: Any) -> float:
    """Relative difference; infinite where there is none."""
    if _is_number(here) and _is_number(there) and there != 0:
        return abs(float(here / there) - 1.0)
    return math.inf


def _span(value: list[int]) -> str:
    low, high = value
    return f"{low}" if low == high else f"{low} to {high}"


def _said(what: str, here: Any, there: Any) -> str:
    """One difference with its size."""
    shown = ("none" if one is None else f"{one:.9g}" if _is_number(one) else str(one) for one in (here, there))
    percent = f" ({100.0 * (here / there - 1.0):+.3g} %)" if math.isfinite(_size(here, there)) else ""
    return "{} is {} instead of {}".format(what, *shown) + percent
