"""Directive `scoreboard`: entries of an environment, shipped and submitted, from their files, minimum error first."""

from pathlib import Path
from typing import Any

from made_markdown import MarkdownDirective, table
from sphinx.application import Sphinx

from uvms_gym.controllers.families import is_bound, is_learned
from uvms_gym.controllers.registry import PRETRAINED
from uvms_gym.studies.comparison.catalogue import figures
from uvms_gym.studies.comparison.scoreboard import read_entries

SUBMITTED = Path(__file__).parents[1] / "scoreboard"


def _cells(metrics: dict[str, Any]) -> list[str]:
    return [*figures(metrics), f"{1e2 * metrics['diverged']['whole']['mean']['value']:.1f}"]


class Scoreboard(MarkdownDirective):
    """Table of one environment."""

    required_arguments = 1

    def markdown(self) -> str:
        """Entries by the pose error."""
        files = [(path, "shipped") for path in PRETRAINED.glob("*/*/*/results.json")]
        files += [(path, path.parent.name) for path in SUBMITTED.glob("*/compare.json")]
        found = []
        for path, by in files:
            self.env.note_dependency(str(path))
            for env, name, entry in read_entries(path):
                if env == self.arguments[0] and name != "none" and not is_bound(name):
                    kind = "learned" if is_learned(name) else "classical"
                    cells = (f"`{name}`", kind if by == "shipped" else f"submitted: {by}", *_cells(entry["metrics"]))
                    found.append((entry["metrics"]["pose"]["whole"]["iqm"]["value"], cells))
        rows = [(rank, *cells) for rank, (_, cells) in enumerate(sorted(found), 1)]
        errors = ("pose, mm", "95th percentile", "99.9th", "worst")
        header = ("", "controller", "kind", *errors, "power, %", "variation, 1e-3", "diverged, %")
        return table(header, rows)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_directive("scoreboard", Scoreboard)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
