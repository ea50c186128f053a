"""Error of logs and of their maps."""

import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager


class LogError(ValueError):
    """Log or map that cannot be read: one line with file, line or key, the value and what is allowed."""


@contextmanager
def reading(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn the errors of reading a file into a LogError."""
    try:
        yield
    except FileNotFoundError:
        raise LogError(f"{os.fspath(path)}: no such file") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise LogError(f"{os.fspath(path)}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
