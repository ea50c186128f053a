"""Rule of the scoreboard (docs/scoreboard.md), and the entries of files that follow it."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from uvms_gym.studies.comparison.conditions import DESIGN

#: Environments of the scoreboard, and all else that entries have in common.
ENVS = ("UVMS-StationKeep-Storm-v0", "UVMS-EETrack-Storm-v0")
RULE: Mapping[str, Any] = {
    "scene": "petasus-pum",
    "disturbance": None,
    "condition": DESIGN,
    "action": "wrench",
    "max_current": None,
    "env_kwargs": {},
    "seed": 0,
    "episodes": 1024,
}


def read_entries(path: Path) -> list[tuple[str, str, dict[str, Any]]]:
    """Entries of a compare.json: environment, controller, and its statistics.

    Raises
    ------
    ValueError
        The file holds no results, or does not follow the rule; the message names key, value and the allowed one.
    OSError
        The file cannot be read.
    """
    try:
        return list(_entries(path))
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} holds no results of uvms compare: {type(error).__name__}: {error}") from None


def _entries(path: Path) -> Iterator[tuple[str, str, dict[str, Any]]]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} holds no results of uvms compare: {error}") from None
    given = {"action": "wrench", "max_current": None, "env_kwargs": {}, **data["circumstances"]["arguments"]}
    for stored in data["results"]:
        if stored["env"] not in ENVS:
            raise ValueError(f"{path}: env is {stored['env']!r}, but must be one of {', '.join(ENVS)}")
        for name, entry in stored["controllers"].items():
            found = given | {key: stored[key] for key in ("scene", "disturbance", "condition")}
            found["episodes"] = entry["episodes"]
            for key, allowed in RULE.items():
                if found[key] != allowed:
                    raise ValueError(f"{path}: {name}: {key} is {found[key]!r}, but the scoreboard has {allowed!r}")
            yield stored["env"], name, entry
