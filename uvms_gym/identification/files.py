"""What a fit leaves: scene, map of the logs, ranges for training, and all numbers."""

import copy
import re
from collections.abc import Mapping
from typing import Any

from uvms_gym._core import load_scene
from uvms_gym.identification import scene_keys
from uvms_gym.identification.fit import Fit
from uvms_gym.identification.parameters import MAP, Parameter

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
        Name of the scene; default that of the start.
    """
    scene = copy.deepcopy(fit.scene)
    intervals, values = fit.intervals, fit.values
    shares = dict(zip(fit.values, fit.uncertainty.shares.tolist()))
    for p in fit.parameters:
        if p.key.startswith(MAP):
            continue
        scene_keys.write(scene, p.key, [_rounded(n) for n in scene_keys.read(scene, p.key)])
        low, high = intervals[p.key]
        what = "factor" if p.factor else "value"
        text = f"measured: fitted to {len(fit.train)} trials of {source}; "
        text += f"{what} {values[p.key]:.4g}, 95 % interval {low:.4g} to {high:.4g}"
        if shares[p.key] > 0.5:
            text += f"; the data hardly determine it: {100 * shares[p.key]:.0f} % of the prior's variance remain"
        body, axis = _rotational(p)
        if body:
            scene.setdefault("provenance", {})[f"{body}.added_mass[{3 + axis}]"] = f"{text} of the sum with inertia"
        else:
            scene.setdefault("provenance", {})[p.key] = text
    if name is not None:
        scene["name"] = name
    loaded: dict[str, Any] = load_scene(scene)
    return loaded


def randomize(fit: Fit) -> dict[str, list[float]]:
    """Ranges of the scene's fitted numbers by key, [low, high]: what the data leave open, for `randomize=`."""
    found: dict[str, list[float]] = {}
    for p in fit.parameters:
        if p.key.startswith(MAP):
            continue
        low, high = fit.intervals[p.key]
        body, axis = _rotational(p)
        if body:
            # The added moment carries the interval of the sum.
            total, key = fit.values[p.key], f"{body}.added_mass[{3 + axis}]"
            added = scene_keys.read(fit.scene, key)[0]
            found[key] = [_rounded(max(added + low - total, 0.0)), _rounded(added + high - total)]
        elif p.factor:
            value = fit.values[p.key]
            for place, number in zip(scene_keys.places(fit.scene, p.key), scene_keys.read(fit.scene, p.key)):
                if number:
                    ends = sorted(number * end / value for end in (low, high))
                    found[_text(place)] = [_rounded(end) for end in ends]
        else:
            found[p.key] = [_rounded(low), _rounded(high)]
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
    """Tables of a map at a path; a missing name of an axis stands for all."""
    nodes = [root]
    for name in tables:
        if create:
            nodes = [node.setdefault(name, {}) for node in nodes]
        else:
            nodes = [node[name] for node in nodes if isinstance(node.get(name), dict)]
    if tables == ["thrusters", "axes"]:
        nodes = [axis for node in nodes for axis in node.values()]
    return nodes


def _rotational(p: Parameter) -> tuple[str, int]:
    """Body and axis of a rotational inertia; "" for other parameters."""
    match = re.fullmatch(rf"(.+)\.{scene_keys.ROTATIONAL_INERTIA}\[(\d)\]", p.key)
    return (match[1], int(match[2])) if match else ("", 0)


def _text(place: scene_keys.Steps) -> str:
    """Key of one place."""
    parts = [f"[{step}]" if isinstance(step, int) else f".{step}" for step in place]
    return "".join(parts).removeprefix(".")


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
