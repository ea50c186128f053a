"""Dotted keys into scenes and log maps: `vehicle.body.mass`, `arm.links[wrist].body.volume`, `vehicle.thrusters.lag`.

A key without an element of a list of tables stands for all of them, with all numbers below; an index of a matrix stands
for its diagonal.
`BODY.rotational_inertia[k]` is the sum of the rigid and the added moment of inertia about axis k of a body.
"""

import re
from collections.abc import Sequence
from functools import reduce
from operator import getitem
from typing import Any

#: Key of the sum of rigid and added moments of inertia.
ROTATIONAL_INERTIA = "rotational_inertia"
#: Maximum share of the rigid moments in the sum of rigid and added ones, where the sum limits them.
_RIGID_SHARE = 0.9

Steps = tuple[str | int, ...]


def parse(key: str) -> Steps:
    """Steps of a key: keys of tables (str), elements of lists by index (int) or name (str, in brackets "[name]")."""
    if not re.fullmatch(r"[^\[\].]+(\.[^\[\].]+|\[[^\[\]]+\])*", key):
        raise ValueError(f"{key!r} is not a key such as 'vehicle.body.damping.linear[3]'")
    steps: list[str | int] = []
    for name, element in re.findall(r"([^\[\].]+)|\[([^\[\]]+)\]", key):
        steps.append(name if name else int(element) if element.isdecimal() else f"[{element}]")
    return tuple(steps)


def places(root: Any, key: str) -> list[Steps]:
    """Places of the numbers that a key stands for, each as the steps to it.

    Raises
    ------
    ValueError
        The key leads to nothing, or to no number.
    """
    found = [leaf for place in _places(root, parse(key), ()) for leaf in _leaves(_get(root, place), place)]
    if not found:
        raise ValueError(f"{key!r} leads to no number of the scene")
    return found


def expand(root: Any, key: str) -> list[str]:
    """Keys of single parameters: `[0:3]` for entries of a list, and a list of numbers for all of its entries."""
    if match := re.fullmatch(r"(.+)\[(\d+):(\d+)\]", key):
        return [f"{match[1]}[{k}]" for k in range(int(match[2]), int(match[3]))]
    if key.endswith(f".{ROTATIONAL_INERTIA}"):
        return [f"{key}[{k}]" for k in range(3)]
    found = _places(root, parse(key), ())
    value = _get(root, found[0]) if len(found) == 1 else None
    return [f"{key}[{k}]" for k in range(len(value))] if isinstance(value, list) else [key]


def read(root: Any, key: str) -> list[float]:
    """Numbers at all places of a key."""
    if body := rotational(key):
        return [_moments(root, body[0])[body[1]]]
    return [float(_get(root, place)) for place in places(root, key)]


def write(root: Any, key: str, values: Sequence[float]) -> None:
    """Set the numbers at all places of a key."""
    if body := rotational(key):
        _set_moment(root, *body, values[0])
        return
    for place, value in zip(places(root, key), values, strict=True):
        _get(root, place[:-1])[place[-1]] = value


def rotational(key: str) -> tuple[str, int] | None:
    """Body and axis of a key of rotational inertia; None for other keys."""
    match = re.fullmatch(rf"(.+)\.{ROTATIONAL_INERTIA}\[([012])\]", key)
    return (match[1], int(match[2])) if match else None


def _table(root: Any, key: str) -> Any:
    """Table at a key that stands for one place."""
    found = _places(root, parse(key), ())
    if len(found) != 1 or not isinstance(_get(root, found[0]), dict):
        raise ValueError(f"{key!r} is not one body of the scene")
    return _get(root, found[0])


def _moments(root: Any, key: str) -> list[float]:
    """Sums of the rigid and added moments of inertia of a body, kg m2."""
    body = _table(root, key)
    if any(body.get("hydrodynamic_frame", {}).get("rpy", ())):
        raise ValueError(f"{key}.{ROTATIONAL_INERTIA}: the hydrodynamic frame must not be turned")
    added = body.get("added_mass", [0.0] * 6)
    return [_diagonal(body["inertia"], k) + _diagonal(added, 3 + k) for k in range(3)]


def _set_moment(root: Any, key: str, axis: int, value: float) -> None:
    """Set a sum of moments by the added one.

    Only the sum can be observed. The rigid tensor, which no body could have were one moment changed alone, is
    scaled as a whole where it would exceed the sum.
    """
    body, moments = _table(root, key), _moments(root, key)
    moments[axis] = value
    share = min(1.0, *(_RIGID_SHARE * moments[k] / _diagonal(body["inertia"], k) for k in range(3)))
    body["inertia"] = [
        [share * entry for entry in row] if isinstance(row, list) else share * row for row in body["inertia"]
    ]
    added = body.setdefault("added_mass", [0.0] * 6)
    for k in range(3):
        rest = moments[k] - _diagonal(body["inertia"], k)
        if isinstance(added[3 + k], list):
            added[3 + k][3 + k] = rest
        else:
            added[3 + k] = rest


def _diagonal(matrix: Any, k: int) -> float:
    """Entry of a diagonal, given as a list or as a matrix."""
    return float(matrix[k][k] if isinstance(matrix[k], list) else matrix[k])


def _places(node: Any, steps: Steps, done: Steps) -> list[Steps]:
    if not steps:
        return [done]
    step, rest = steps[0], steps[1:]
    if isinstance(node, dict):
        return _places(node[step], rest, (*done, step)) if step in node else []
    if not isinstance(node, list):
        return []
    if isinstance(step, int):
        if step >= len(node):
            return []
        # (One index of a matrix: its diagonal.)
        twice = not rest and isinstance(node[step], list)
        return [(*done, step, step)] if twice else _places(node[step], rest, (*done, step))
    if step.startswith("["):
        named = [k for k, element in enumerate(node) if isinstance(element, dict) and element.get("name") == step[1:-1]]
        return [place for k in named for place in _places(node[k], rest, (*done, k))]
    return [place for k, element in enumerate(node) for place in _places(element, steps, (*done, k))]


def _leaves(node: Any, place: Steps) -> list[Steps]:
    """Places of the numbers in nested lists."""
    if isinstance(node, list):
        return [leaf for k, element in enumerate(node) for leaf in _leaves(element, (*place, k))]
    return [place] if isinstance(node, int | float) and not isinstance(node, bool) else []


def _get(root: Any, place: Steps) -> Any:
    return reduce(getitem, place, root)
