"""Files of a fit: scene, map of the logs, ranges for training, and all numbers."""

import copy
import json
import re
from collections.abc import Mapping
from typing import Any

from uvms_gym._core import load_scene
from uvms_gym.identification import scene_keys
from uvms_gym.identification.fit import Fit
from uvms_gym.identification.intervals import UNDETERMINED
from uvms_gym.identification.parameters import MAP, Parameter
from uvms_gym.logs.log import Scene

#: Significant digits of fitted numbers.
DIGITS = 6


def fitted_scene(fit: Fit, source: str, name: str | None = None) -> dict[str, Any]:
    """Fitted scene with the provenance of its numbers: from what, and their 95 % intervals.

    Parameters
    ----------
    fit : Fit
        Result.
    source : str
        Name of the logs, for the provenance.
    name : str, optional
        Name of the scene; by default the name of the start.
    """
    scene = copy.deepcopy(fit.scene)
    provenance = scene.setdefault("provenance", {})
    for p, share in zip(fit.parameters, fit.uncertainty.shares.tolist()):
        if p.key.startswith(MAP):
            continue
        scene_keys.write(scene, p.key, [_rounded(n) for n in scene_keys.read(scene, p.key)])
        note = f"; {100 * share:.0f} % of the prior's variance remain" if share > UNDETERMINED else ""
        note += "; observed: its sum with the rigid moment of inertia" if scene_keys.rotational(p.key) else ""
        for key, (low, high) in _ranges(fit, p).items():
            trials = f"to {len(fit.train)} trials of {source}"
            provenance[key] = f"fitted: {trials}, 95 % interval {low:.6g} to {high:.6g}{note}"
    if name is not None:
        scene |= {"name": name, "summary": f"{fit.start['name']}, fitted to {len(fit.train)} trials of {source}."}
    loaded: dict[str, Any] = load_scene(scene)
    return loaded


def ranges(scene: Scene) -> dict[str, list[float]]:
    """Ranges of a scene's fitted numbers by key, [low, high], for `randomize=`: the 95 % intervals of its provenance.

    Parameters
    ----------
    scene : str, os.PathLike or dict
        Scene that `uvms fit` has written, or a shipped one that was fitted.
    """
    provenance: dict[str, str] = load_scene(scene).get("provenance", {})
    found = {}
    for key, text in provenance.items():
        if match := re.search(r"fitted: .*, 95 % interval (\S+) to ([^\s;]+)", text):
            found[key] = [float(match[1]), float(match[2])]
    return found


def _ranges(fit: Fit, p: Parameter) -> dict[str, tuple[float, float]]:
    """Intervals of the numbers of a parameter by their own keys."""
    low, high = fit.intervals[p.key]
    if rotational := scene_keys.rotational(p.key):
        body, axis = rotational
        # The added moment carries the interval of the sum.
        key = f"{body}.added_mass[{3 + axis}]"
        rest = scene_keys.read(fit.scene, key)[0] - fit.values[p.key]
        return {key: (max(low + rest, 0.0), high + rest)}
    if not p.factor:
        return {p.key: (low, high)}
    value, found = fit.values[p.key], {}
    for place, number in zip(scene_keys.places(fit.scene, p.key), scene_keys.read(fit.scene, p.key)):
        if number:
            ends = sorted((number * low / value, number * high / value))
            text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in place)
            found[text.removeprefix(".")] = (ends[0], ends[1])
    return found


def fitted_map(fit: Fit, data: Mapping[str, Any]) -> dict[str, Any]:
    """Data of the map with the fitted zeros, lags and scales, in the tables of single trials as well."""
    found: dict[str, Any] = copy.deepcopy(dict(data))
    for p in fit.parameters:
        if not p.key.startswith(MAP):
            continue
        *tables, last = p.key.removeprefix(MAP).split(".")
        trials = found.get("trial", {})
        for root in (found, *trials.values()):
            for node in _nodes(root, tables, create=root is found):
                if last in node or root is found:
                    node[last] = _rounded(_corrected(p, node.get(last), fit.values[p.key]))
    return found


def as_data(fit: Fit) -> dict[str, Any]:
    """All numbers of a fit."""
    parameters = {
        p.key: {
            "start": p.start,
            "value": fit.values[p.key],
            "deviation": fit.deviations[p.key],
            "interval": list(fit.intervals[p.key]),
            "prior_deviation": p.deviation,
            "logarithmic": p.logarithmic,
            "share_of_prior_variance": float(fit.uncertainty.shares[k]),
            "naive_deviation": float(fit.uncertainty.naive[k]) * (fit.values[p.key] if p.logarithmic else 1.0),
            "at_bound": p.key in fit.at_bounds,
        }
        for k, p in enumerate(fit.parameters)
    }
    tables = {"train": fit.table.of(fit.train).as_data()}
    if fit.held_out:
        tables["held out"] = fit.table.of(fit.held_out).as_data()
    return {
        "converged": fit.solution.converged,
        "iterations": fit.solution.iterations,
        "cost": fit.solution.cost,
        "channels": list(fit.channels),
        "train": list(fit.train),
        "held_out": list(fit.held_out),
        "parameters": parameters,
        "correlations": fit.uncertainty.correlations,
        "undetermined": [{"share": share, "direction": keys} for share, keys in fit.undetermined],
        "errors": tables,
    }


def _corrected(p: Parameter, old: Any, value: float) -> float:
    """Value of a key of the map: a scale is a factor on the old one, others move by the same amount everywhere."""
    if p.logarithmic:
        return (1.0 if old is None else float(old)) * value
    return (p.start if old is None else float(old)) + value - p.start


def _nodes(root: Any, tables: list[str], create: bool) -> list[Any]:
    """Tables of a map at a path; a missing name of an axis means all axes."""
    nodes = [root]
    for name in tables:
        if create:
            nodes = [node.setdefault(name, {}) for node in nodes]
        else:
            nodes = [node[name] for node in nodes if isinstance(node.get(name), dict)]
    if tables == ["thrusters", "axes"]:
        nodes = [axis for node in nodes for axis in node.values()]
    return nodes


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def to_toml(data: Mapping[str, Any]) -> str:
    """TOML text of a table of numbers, texts, lists and tables."""
    return "\n".join(_lines(data, ())) + "\n"


def _lines(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    """Lines of a table: values, then tables of plain values in one line, as `time = { column = "t" }`, then others."""
    tables = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    sections = {k: v for k, v in tables.items() if not path or any(isinstance(one, Mapping) for one in v.values())}
    keys = [*(key for key in table if key not in tables), *(key for key in tables if key not in sections)]
    lines = [f"{_key(key)} = {_value(table[key])}" for key in keys]
    for key, value in sections.items():
        inner = (*path, key)
        lines += ["", f"[{'.'.join(map(_key, inner))}]", *_lines(value, inner)]
    return lines


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key, ensure_ascii=False)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(entry)}" for key, entry in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(entry) for entry in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(value)
