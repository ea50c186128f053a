"""Verification of stored comparisons: all that is stored is made again, and compared entry by entry.

Records of the run that made the file (time, versions, machine) are checked for their form. An entry that is neither
made again nor of a known form is a difference.
"""

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import uvms_gym
from uvms_gym.controllers import registry
from uvms_gym.controllers.families import CODE_PREFIX, MLP_PREFIX, compared, is_learned
from uvms_gym.studies import records
from uvms_gym.studies.comparison.conditions import Condition, make_conditions
from uvms_gym.studies.comparison.study import (
    NO_POLICY,
    STORED,
    Comparison,
    as_data,
    as_document,
    design,
    make_comparison,
    run_all,
    suits,
)
from uvms_gym.studies.comparison.summary import KEPT, summarise

#: Relative tolerance of stored numbers, which other machines reproduce; numbers below ABSOLUTE are 0.
TOLERANCE, ABSOLUTE = 1e-4, 1e-9
#: Maximum number of episodes of a run: a typing error must not exhaust the memory.
MAX_EPISODES = 100_000
#: Maximum speed of the current, m/s.
MAX_CURRENT = 10.0
#: Arguments of environments that have entries of their own, and the reward, which scores do not depend on.
_LISTED = {"envs", "scenes", "levels", "departures", "scene", "disturbance", "task", "reward", *STORED}
#: Statistics over all episodes.
_OF_RANKING = ("winner", "runner_up", "margin", "profiles")
_OVER_ALL = ("against", "baseline", *_OF_RANKING)


class Form(NamedTuple):
    """Allowed values of an entry that cannot be made again: in words, and as a test."""

    allowed: str
    holds: Callable[[Any], bool]


def _integer(minimum: int, maximum: int) -> Form:
    return Form(f"an integer from {minimum} to {maximum}", lambda x: type(x) is int and minimum <= x <= maximum)


def _number(maximum: float) -> Form:
    return Form(f"a number from 0 to {maximum:g}", lambda x: type(x) in (int, float) and 0 <= x <= maximum)


def _names(minimum: int) -> Form:
    def holds(x: Any) -> bool:
        return isinstance(x, list) and all(isinstance(name, str) for name in x) and len(set(x)) == len(x) >= minimum

    return Form(f"a list of at least {minimum} different names", holds)


def _text(allowed: str, pattern: str, null: bool = False) -> Form:
    def holds(value: Any) -> bool:
        return re.fullmatch(pattern, value) is not None if isinstance(value, str) else null and value is None

    return Form(allowed + " or null" * null, holds)


_ANY = Form("anything", lambda x: True)
_OBJECTS = Form("a list of objects", lambda x: type(x) is list and x != [] and all(type(one) is dict for one in x))
_VERSION = _text("a version", r"\d[\w.+!-]*")
_WORDS = _text("text in one line", r"[ -~]{0,200}")
#: Records of the run that made the file.
SECONDS = _number(1e9)
RECORDS: Mapping[str, Any] = {
    "command": "compare",
    "uvms_gym": _VERSION,
    "commit": _text("a commit", r"[0-9a-f]{40,64}\+?", null=True),
    "python": _VERSION,
    "numpy": _VERSION,
    "gymnasium": _VERSION,
    "matplotlib": _text("a version", r"\d[\w.+!-]*", null=True),
    "machine": {
        "system": _WORDS,
        "architecture": _WORDS,
        "processor": _WORDS,
        "cores": _integer(1, 1 << 20),
        "instruction_set": _WORDS,
    },
}
#: Arguments of `uvms compare`: they say what is made again.
ARGUMENTS: Mapping[str, Form] = {
    "env": _names(1),
    "scene": _names(1),
    "controllers": Form("null or a list of at least 1 name", lambda x: x is None or _names(1).holds(x)),
    "episodes": _integer(2, MAX_EPISODES),
    "seed": _integer(0, 2**64 - 1),
    "condition": _names(1),
    "disturbance": _names(0),
    "action": Form("wrench or thrusters", lambda x: x in ("wrench", "thrusters")),
}
OPTIONAL: Mapping[str, Form] = {
    "max_current": _number(MAX_CURRENT),
    "env_kwargs": Form("an object of further arguments", lambda x: isinstance(x, dict) and not _LISTED & x.keys()),
}


class Verification(NamedTuple):
    """Outcome of a verification: a line for each difference, and for each controller that is not checked in full."""

    differences: list[str]
    unchecked: list[str]


def verify(path: Path, full: bool = False, run_code: bool = False) -> Verification:
    """Make a stored comparison again, but for policies that are missing here.

    Parameters
    ----------
    path : Path
        A compare.json, or the results.json of shipped policies.
    full : bool
        Compare all statistics over all episodes, not only the stored scores of the first episodes.
    run_code : bool
        Run the Python code that the file names (`py:FILE.py:NAME`).

    Raises
    ------
    ValueError
        The file holds no results, names Python code without `run_code`, or a controller does not exist any more.
    OSError
        A file cannot be read.
    """
    data = read_results(path)
    results, arguments = data["results"], data["circumstances"]["arguments"]
    try:
        parts = [
            _comparison(condition, stored, arguments["controllers"], run_code)
            for condition, stored in zip(_conditions(arguments, len(results)), results, strict=True)
        ]
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from None
    data["results"] = [_without(stored, *part) for stored, part in zip(results, parts, strict=True)]
    unchecked = [
        f"{comparison.condition.name}: {name}: not checked for training seeds "
        f"{', '.join(map(str, seeds))}, as their policies are missing (--policies DIR)"
        for comparison, absent in parts
        for name, seeds in absent.items()
    ]
    # No run is needed for a file that names another.
    if found := list(_heads(data, [comparison for comparison, _ in parts])):
        return Verification(found, unchecked)
    for stored, (comparison, absent) in zip(data["results"], parts, strict=True):
        expected = expect(comparison, arguments["episodes"], arguments["seed"], full)
        found += differences(f"{comparison.condition.name}: ", stored, _without(expected, comparison, absent))
    return Verification(found, unchecked)


def read_results(path: Path) -> dict[str, Any]:
    """Read stored results, with their frame and arguments checked.

    Raises
    ------
    ValueError
        The file holds no results of `uvms compare`; the message says where.
    OSError
        The file cannot be read.
    """
    try:
        data = records.read_json(path)
        frame = {"circumstances": _ANY, "statistics": _ANY, "results": _OBJECTS}
        faults = list(differences("", data, frame))
        if not faults:
            given = data["circumstances"].get("arguments") if isinstance(data["circumstances"], dict) else None
            optional = {name: form for name, form in OPTIONAL.items() if isinstance(given, dict) and name in given}
            faults = list(differences("circumstances.arguments", given, {**ARGUMENTS, **optional}))
    except ValueError as error:
        faults = [str(error)]
    if faults:
        raise ValueError(f"{path} holds no results of uvms compare: {faults[0]}")
    return dict(data)


def _conditions(arguments: Mapping[str, Any], count: int) -> list[Condition]:
    """Conditions of the arguments, as many as there are results."""
    lists = [arguments[name] for name in ("env", "scene", "disturbance", "condition")]
    if (asked := math.prod(max(1, len(values)) for values in lists)) != count:
        raise ValueError(f"results: {count} are stored, but circumstances.arguments name {asked} conditions")
    envs, scenes, levels, departures = lists
    options = {name: arguments[name] for name in STORED if name in arguments} | arguments.get("env_kwargs", {})
    return make_conditions(envs, {name: uvms_gym.load_scene(name) for name in scenes}, levels, departures, **options)


def _comparison(
    condition: Condition, stored: Mapping[str, Any], named: list[str] | None, run_code: bool
) -> tuple[Comparison, dict[str, tuple[int, ...]]]:
    """Comparison of the named controllers, and the training seeds whose policies are missing by controller.

    Without names: all controllers of the task, also along the frontier if they are stored.
    """
    task = condition.designed["task"]
    if named is None:
        entries = [part for key in ("controllers", "missing") if isinstance(part := stored.get(key), dict)]
        frontier = {name for part in entries for name in part} == set(compared(task, frontier=True))
        named = list(compared(task, frontier))
    named = [name for name in named if suits(name, condition)]
    if not run_code and (code := [name for name in named if name.startswith(CODE_PREFIX)]):
        raise ValueError(f"{code[0]} is Python code; read it, then run it with --run-code")
    there, absent, files = {}, {}, registry.policies(**condition.designed)
    for name in (name for name in named if is_learned(name) and not name.startswith(MLP_PREFIX)):
        seeds, ours = _seeds(stored, name), files.get(name, {})
        there[name] = tuple(seed for seed in seeds if seed in ours)
        if others := tuple(seed for seed in seeds if seed not in ours):
            absent[name] = others
    lacking = [name for name in absent if not there[name]]
    # The run had no policy either.
    without = [name for name in there if name in (stored.get("missing") or ()) and not _seeds(stored, name)]
    made = make_comparison(condition, [name for name in named if name not in (*lacking, *without)], seeds=there)
    return made._replace(missing=made.missing | dict.fromkeys(without, NO_POLICY)), absent


def _seeds(stored: Mapping[str, Any], name: str) -> tuple[int, ...]:
    """Training seeds of a stored controller; none where the entry is broken."""
    entries = stored.get("controllers")
    entry = entries.get(name) if isinstance(entries, dict) else None
    seeds = entry.get("training_seeds") if isinstance(entry, dict) else None
    return tuple(seeds) if isinstance(seeds, list) and all(type(seed) is int for seed in seeds) else ()


def _without(result: dict[str, Any], comparison: Comparison, absent: Mapping[str, tuple[int, ...]]) -> dict[str, Any]:
    """Entries of a result that do not depend on missing policies."""
    if not absent:
        return result
    result = {key: part for key, part in result.items() if key not in _OF_RANKING}
    result["controllers"] = {
        name: entry if name not in absent else _of_seeds(entry, comparison.contenders[name].seeds)
        for name, entry in result["controllers"].items()
        if name not in absent or name in comparison.contenders
    }
    if isinstance(against := result.get("against"), dict) and all(isinstance(part, dict) for part in against.values()):
        result["against"] = {
            name: {other: part for other, part in ratios.items() if other not in absent}
            for name, ratios in against.items()
        }
    return result


def _of_seeds(entry: Mapping[str, Any], seeds: tuple[int, ...]) -> dict[str, Any]:
    """Entry of a controller without the statistics over all training seeds, for some of them; broken ones unchanged."""
    try:
        rows = [entry["training_seeds"].index(seed) for seed in seeds]
        files = [entry["origin"]["files"][row] for row in rows]
        kept = {metric: [scores[row] for row in rows] for metric, scores in entry["kept"].items()}
    except (LookupError, TypeError, ValueError, AttributeError):
        return dict(entry)
    rest = {key: part for key, part in entry.items() if key != "metrics"}
    return rest | {"training_seeds": list(seeds), "origin": {"files": files}, "kept": kept}


def _heads(data: Mapping[str, Any], comparisons: list[Comparison]) -> Iterator[str]:
    """Differences that are seen without a run."""
    arguments = data["circumstances"]["arguments"]
    expected = as_document({**RECORDS, "arguments": arguments}, arguments["seed"], [])
    for key in ("circumstances", "statistics"):
        yield from differences(key, data[key], expected[key])
    for stored, comparison in zip(data["results"], comparisons, strict=True):
        place, known = f"{comparison.condition.name}: ", records.plain(design(comparison))
        yield from differences(place, {key: stored[key] for key in known if key in stored}, known)
        entries = stored["controllers"] if isinstance(stored.get("controllers"), dict) else {}
        counts = {name: {"episodes": one.get("episodes")} for name, one in entries.items() if isinstance(one, dict)}
        asked = {name: {"episodes": arguments["episodes"]} for name in comparison.contenders}
        yield from differences(f"{place}controllers", counts, asked)


def expect(comparison: Comparison, episodes: int, seed: int, full: bool = True) -> dict[str, Any]:
    """Run a comparison: the entries to be stored, with forms in place of those that no other run makes again.

    Parameters
    ----------
    comparison : Comparison
    episodes, seed : int
    full : bool
        False: run the individually stored episodes only; statistics over all are not compared.
    """
    runs = run_all(comparison, episodes if full else min(episodes, KEPT), seed)
    expected: dict[str, Any] = records.plain(as_data(comparison, summarise(comparison.contenders, runs, seed)))
    for entry in expected["controllers"].values():
        entry["seconds"] = SECONDS
        if not full:
            entry |= {"episodes": episodes, "metrics": _ANY}
    return expected if full else expected | dict.fromkeys(_OVER_ALL, _ANY)


def differences(place: str, stored: Any, expected: Any) -> Iterator[str]:
    """Lines for all entries that differ; each names the place, the stored value and the expected one."""
    if isinstance(expected, Form):
        if not expected.holds(stored):
            yield f"{place} is {_brief(stored)}, but must be {expected.allowed}"
    elif isinstance(expected, Mapping) and isinstance(stored, dict):
        yield from (f"{_below(place, key)} is stored, but unknown" for key in stored if key not in expected)
        for key, value in expected.items():
            if key in stored:
                yield from differences(_below(place, key), stored[key], value)
            else:
                yield f"{_below(place, key)} is not stored"
    elif isinstance(expected, list) and isinstance(stored, list) and len(expected) == len(stored):
        for i, (old, new) in enumerate(zip(stored, expected)):
            yield from differences(f"{place}[{i}]", old, new)
    elif not _same(stored, expected):
        yield f"{place}: {_brief(stored)} is stored, {_brief(expected)} found"


def _same(stored: Any, expected: Any) -> bool:
    """Equality; of numbers to the tolerances, of integers exactly."""
    if type(expected) is float and type(stored) in (int, float):
        return math.isclose(stored, expected, rel_tol=TOLERANCE, abs_tol=ABSOLUTE)
    return type(stored) is type(expected) and not isinstance(stored, (dict, list)) and bool(stored == expected)


def _below(place: str, key: str) -> str:
    """Place of a key, in one line whatever the key."""
    if re.fullmatch(r"[\w-]{1,60}", key, re.ASCII) is None:
        return f"{place}[{_brief(key)}]"
    return f"{place}.{key}" if place and not place.endswith(" ") else place + key


def _brief(value: Any) -> str:
    """A value in one short line."""
    if isinstance(value, (dict, Mapping)):
        return f"an object of {len(value)}"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, float):
        return f"{value:.9g}"
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
