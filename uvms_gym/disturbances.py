"""Disturbances by name."""

import json
from typing import Any, NamedTuple

from uvms_gym._core import disturbances as _levels


class Level(NamedTuple):
    """A named disturbance.

    Attributes
    ----------
    description : str
        One sentence.
    components : dict
        What `disturbance=` of an environment takes in place of the name.
    """

    description: str
    components: dict[str, Any]


def disturbances() -> dict[str, Level]:
    """Levels of disturbances by name, mild to wild; those with "-hard" are to be held out for evaluation."""
    return {name: Level(description, json.loads(components)) for name, description, components in _levels()}
