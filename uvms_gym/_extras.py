"""Imports of packages that an extra of this one brings."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Name the extra where a package is missing.

    Raises
    ------
    ModuleNotFoundError
        The message says how to install the package.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if str(error.name).startswith("uvms_gym"):
            raise
        missing = str(error.name)
    else:
        return
    raise ModuleNotFoundError(f"{missing} is not installed; run: pip install 'uvms-gym[{name}]'", name=missing)
