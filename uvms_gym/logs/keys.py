"""Keys of a TOML table: typed reading, with errors that name file and key."""

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from uvms_gym.logs.errors import LogError


class Keys:
    """Table of a TOML file, whose keys are read one by one; `finish` refuses those that nothing has asked for.

    `path` are the keys that lead to the table.
    """

    def __init__(self, data: Mapping[str, Any], file: str, path: tuple[str, ...] = ()) -> None:
        self.data = data
        self._file = file
        self._path = path
        self._known: list[str] = []

    @property
    def folder(self) -> Path:
        """Folder of the file."""
        return Path(self._file).parent

    def __iter__(self) -> Iterator[str]:
        return iter(self.data)

    def error(self, key: str | None, text: str) -> LogError:
        """Error at a key of the table, or at the table itself."""
        place = ".".join(self._path if key is None else (*self._path, key))
        return LogError(f"{self._file}: {place}: {text}" if place else f"{self._file}: {text}")

    def has(self, key: str) -> bool:
        """True where the table has the key."""
        self._known.append(key)
        return key in self.data

    def require(self, *keys: str) -> None:
        """Refuse a table without any of the keys."""
        given = [self.has(key) for key in keys]
        if not any(given):
            raise self.error(None, f"{' or '.join(keys)} is missing")

    def number(self, key: str, default: float, *, above: float = -math.inf, finite: bool = True) -> float:
        """Number above a limit."""
        if not self.has(key):
            return default
        value = self.data[key]
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise self.error(key, f"{value!r} is not a number")
        if math.isnan(value) or (finite and math.isinf(value)):
            raise self.error(key, f"{value} is not a finite number")
        if value <= above:
            raise self.error(key, f"{value} must be > {above:g}")
        return float(value)

    def count(self, key: str) -> int | None:
        """Whole number from 0 on; None without the key."""
        value = self.value(key)
        if value is not None and (not isinstance(value, int) or isinstance(value, bool) or value < 0):
            raise self.error(key, f"{value!r} is not a whole number from 0 on")
        return value

    def text(self, key: str) -> str:
        """Text that is not empty; required."""
        self.require(key)
        value = self.data[key]
        if not isinstance(value, str) or not value:
            raise self.error(key, f"{value!r} is not a text")
        return value

    def choice(self, key: str, allowed: Iterable[str], default: str | None = None) -> str:
        """One of the allowed words; required without default."""
        if default is not None and not self.has(key):
            return default
        value = self.text(key)
        if value not in allowed:
            raise self.error(key, f"{value!r} is none of {', '.join(allowed)}")
        return value

    def texts(self, key: str, count: int) -> tuple[str, ...] | None:
        """List of different texts; None without the key."""
        if not self.has(key):
            return None
        value = self.data[key]
        if not isinstance(value, list) or not all(isinstance(text, str) and text for text in value):
            raise self.error(key, f"{value!r} is not a list of texts")
        if len(value) != count:
            raise self.error(key, f"{len(value)} columns, but must be {count}")
        if len(set(value)) < len(value):
            raise self.error(key, f"{value!r} has a column twice")
        return tuple(value)

    def table(self, key: str) -> "Keys":
        """Table of a key; empty without the key."""
        self.has(key)
        value = self.data.get(key, {})
        if not isinstance(value, Mapping):
            raise self.error(key, f"{value!r} is not a table")
        return Keys(value, self._file, (*self._path, key))

    def value(self, key: str) -> Any:
        """Value of any type; None without the key."""
        return self.data[key] if self.has(key) else None

    def finish(self) -> None:
        """Refuse keys that nothing has asked for."""
        for key in self.data:
            if key not in self._known:
                known = ", ".join(dict.fromkeys(self._known))
                raise self.error(key, f"unknown key; known: {known}")
