"""Rule of the scoreboard (docs/scoreboard.md), and the entries of files that follow it."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from uvms_gym.controllers.families import CODE_PREFIX, CONTROLLERS, MLP_PREFIX
from uvms_gym.studies.comparison.conditions import DESIGN
from uvms_gym.studies.comparison.verification import read_results

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
#: Controllers of files, in characters that a table shows as they are.
_FILES = re.compile(rf"({MLP_PREFIX}|{CODE_PREFIX})[\w./:-]+", re.ASCII)


def read_entries(path: Path) -> list[tuple[str, str, dict[str, Any]]]:
    """Entries of a compare.json: environment, controller, and its statistics.

    Raises
    ------
    ValueError
        The file holds no results, or does not follow the rule; the message names key, value and the allowed one.
    OSError
        The file cannot be read.
    """
    data = read_results(path)
    try:
        return list(_entries(path, data))
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} holds no results of uvms compare: {type(error).__name__}: {error}") from None


def _entries(path: Path, data: Mapping[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    given = {"max_current": None, "env_kwargs": {}, **data["circumstances"]["arguments"]}
    for stored in data["results"]:
        if stored["env"] not in ENVS:
            raise ValueError(f"{path}: env is {stored['env']!r}, but must be one of {', '.join(ENVS)}")
        for name, entry in stored["controllers"].items():
            if name not in CONTROLLERS and _FILES.fullmatch(name) is None:
                raise ValueError(f"{path}: controller {name!a:.60} is unknown")
            found = given | {key: stored[key] for key in ("scene", "disturbance", "condition")}
            found["episodes"] = entry["episodes"]
            for key, allowed in RULE.items():
                if found[key] != allowed:
                    raise ValueError(f"{path}: {name}: {key} is {found[key]!r}, but the scoreboard has {allowed!r}")
            yield stored["env"], name, entry
