"""Scores of an unfinished comparison, which goes on where it was stopped."""

import hashlib
import json
import shutil
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uvms_gym._files import replacing
from uvms_gym.studies.comparison.contenders import EpisodeScores
from uvms_gym.studies.comparison.study import Comparison
from uvms_gym.studies.records import circumstances, write_json

#: Folder beside the results, and the file of its settings.
FOLDER, SETTINGS = "unfinished", "settings.json"


class Unfinished:
    """Scores of finished controllers in a folder beside the results, with the settings that they depend on.

    Parameters
    ----------
    out : Path
        Folder of the results.
    arguments : dict
        Arguments of the command that decide the results.
    comparisons : sequence of Comparison
        All of the run.

    Raises
    ------
    ValueError
        The folder holds scores of other settings; the message names the difference.
    OSError
        A file cannot be read or written.
    """

    def __init__(self, out: Path, arguments: dict[str, Any], comparisons: Sequence[Comparison]) -> None:
        self._folder = out / FOLDER
        file = self._folder / SETTINGS
        settings = json.loads(json.dumps(_settings(arguments, comparisons)))
        try:
            stored = json.loads(file.read_text(encoding="utf-8"))
        except (FileNotFoundError, ValueError):
            stored = None
        if stored != settings:
            if isinstance(stored, dict) and any(self._folder.glob("*.npz")):
                raise ValueError(
                    f"{self._folder} holds finished controllers of another run: {_difference(stored, settings)}; "
                    "give the same settings, another --out, or remove that folder"
                )
            self.remove()
            self._folder.mkdir(parents=True)
            write_json(file, settings)

    def of(self, number: int, comparison: Comparison) -> "Scores":
        """Scores of the comparison with a number."""
        return Scores({name: self._folder / f"{number}-{i}.npz" for i, name in enumerate(comparison.contenders)})

    @property
    def notice(self) -> str:
        """Notice for the user that finished controllers are kept; empty where there are none."""
        count = len(list(self._folder.glob("*.npz")))
        return f"{count} finished controllers are kept in {self._folder}: the same command goes on" if count else ""

    def remove(self) -> None:
        """Remove the folder: the results are written."""
        if self._folder.exists():
            # First, as scores without settings are never read.
            (self._folder / SETTINGS).unlink(missing_ok=True)
            shutil.rmtree(self._folder)


class Scores:
    """Scores by controller, each in a file."""

    def __init__(self, files: dict[str, Path]) -> None:
        self._files = files

    def get(self, name: str) -> EpisodeScores | None:
        """Scores of a finished controller; None of another."""
        try:
            with np.load(self._files[name], allow_pickle=False) as stored:
                scores = {key: stored[key] for key in stored.files if key != "seconds"}
                return EpisodeScores(scores, float(stored["seconds"]))
        except (OSError, ValueError, LookupError, EOFError, zipfile.BadZipFile):
            return None

    def __setitem__(self, name: str, found: EpisodeScores) -> None:
        arrays: dict[str, Any] = {"seconds": found.seconds, **found.scores}
        with replacing(self._files[name]) as file:
            np.savez(file, **arrays)


def _settings(arguments: dict[str, Any], comparisons: Sequence[Comparison]) -> dict[str, Any]:
    """Everything that decides scores; scenes, options and controllers as digests of their content."""
    here = circumstances("compare", {})
    content: dict[str, Any] = {}
    for comparison in comparisons:
        condition = comparison.condition
        content[f"scene or options of {condition.name}"] = _digest(condition.options)
        for name, contender in comparison.contenders.items():
            content[f"{condition.name}, {name}"] = _digest(contender.origin)
    return {**arguments, **content, "uvms_gym": here["uvms_gym"], "commit": here["commit"]}


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()


def _difference(stored: dict[str, Any], ours: dict[str, Any]) -> str:
    """Names of the different settings, with their values where these are short."""
    found = []
    for key in dict.fromkeys([*ours, *stored]):
        old, new = stored.get(key), ours.get(key)
        if old != new:
            short = max(len(str(old)), len(str(new))) < 60
            found.append(f"{key} is {old} there, {new} here" if short else f"{key} differs")
    return ", ".join(found[:3]) + (f" and {len(found) - 3} more" if len(found) > 3 else "")
