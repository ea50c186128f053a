"""Named levels of disturbances."""

import json
from typing import Any, NamedTuple

from uvms_gym._core import disturbance_levels as _levels


class Level(NamedTuple):
    """Level of disturbances: description, and components by name as the option `disturbance` takes them."""

    description: str
    components: dict[str, Any]


def disturbance_levels() -> dict[str, Level]:
    """Levels of disturbances by name, from mild to strong; hold out those with "-hard" for evaluation."""
    return {name: Level(description, json.loads(components)) for name, description, components in _levels()}
