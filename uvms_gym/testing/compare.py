"""Nested results: their arrays, and where two of them differ."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Names of the parts of what `reset` and `step` give.
PARTS = {2: ("observations", "infos"), 5: ("observations", "rewards", "terminations", "truncations", "infos")}


def arrays(result: tuple[Any, ...]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Every array of a call's result with its place."""
    for name, part in zip(PARTS[len(result)], result, strict=True):
        yield from _arrays(part, name)


def _arrays(tree: Any, path: str) -> Iterator[tuple[str, NDArray[Any]]]:
    if isinstance(tree, Mapping):
        for key, value in tree.items():
            yield from _arrays(value, f"{path}[{key!r}]")
    elif isinstance(tree, tuple | list):
        for i, value in enumerate(tree):
            yield from _arrays(value, f"{path}[{i}]")
    elif isinstance(tree, np.ndarray):
        yield path, tree
        if tree.dtype == object:
            yield from _arrays(tree.tolist(), path)


def difference(got: tuple[Any, ...], expected: tuple[Any, ...]) -> str | None:
    """Where two results of a call differ, bit for bit, types and all; None if they do not."""
    for name, a, b in zip(PARTS[len(expected)], got, expected, strict=True):
        if found := unlike(a, b, name):
            return found
    return None


def unlike(got: Any, expected: Any, path: str) -> str | None:
    """Where two trees differ, as a sentence; None if they do not."""
    if isinstance(got, Mapping) and isinstance(expected, Mapping):
        for key in [*expected, *got]:
            if key not in got:
                return f"{path} lacks {key!r}"
            if key not in expected:
                return f"{path} has {key!r}, which is not expected"
            if found := unlike(got[key], expected[key], f"{path}[{key!r}]"):
                return found
        return None
    if type(got) is not type(expected):
        return f"{path} is {_brief(got)} of {type(got).__name__}, not {_brief(expected)} of {type(expected).__name__}"
    if isinstance(got, tuple | list):
        if len(got) != len(expected):
            return f"{path} has {len(got)} entries, not {len(expected)}"
        pairs = enumerate(zip(got, expected, strict=True))
        return next((found for i, (a, b) in pairs if (found := unlike(a, b, f"{path}[{i}]"))), None)
    if isinstance(got, np.ndarray):
        return _unlike_arrays(got, expected, path)
    return None if got == expected or (got != got and expected != expected) else f"{path} is {got!r}, not {expected!r}"


def _unlike_arrays(got: NDArray[Any], expected: NDArray[Any], path: str) -> str | None:
    if got.shape != expected.shape:
        return f"{path} has shape {got.shape}, not {expected.shape}"
    if got.dtype != expected.dtype:
        return f"{path} has dtype {got.dtype}, not {expected.dtype}"
    if got.dtype == object:
        return unlike(got.tolist(), expected.tolist(), path)
    if got.tobytes() == expected.tobytes():
        return None
    size = got.dtype.itemsize
    a = np.frombuffer(got.tobytes(), dtype=(np.void, size))
    b = np.frombuffer(expected.tobytes(), dtype=(np.void, size))
    place = tuple(int(i) for i in np.unravel_index(int(np.flatnonzero(a != b)[0]), got.shape))
    return f"{path}{list(place)} is {got[place]!r}, not {expected[place]!r}"


def _brief(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
