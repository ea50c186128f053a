"""Named levels of disturbances."""

import json
from dataclasses import dataclass
from typing import Any

from uvms_gym._core import disturbance_levels as _levels


@dataclass(frozen=True)
class Level:
    """Level of disturbances.

    Attributes
    ----------
    description : str
        Purpose of the level.
    components : dict
        Components by name, as the option `disturbance` takes them.
    """

    description: str
    components: dict[str, Any]


def disturbance_levels() -> dict[str, Level]:
    """Levels of disturbances by name, from mild to strong; hold out those with "-hard" for evaluation."""
    return {name: Level(description, json.loads(components)) for name, description, components in _levels()}
