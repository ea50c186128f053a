"""Directives `controllers` and `ranking`: families of controllers, and the rivals of a task, from the one list."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from made_markdown import MarkdownDirective, table
from sphinx.application import Sphinx

from uvms_gym.controllers.families import CONTROLLERS, FAMILIES, TASKS, names, split
from uvms_gym.controllers.registry import PRETRAINED
from uvms_gym.studies.comparison.catalogue import SETTINGS, Stored, gain_texts, places, settings_table, stored


def _table(found: list[Stored]) -> str:
    return table(SETTINGS, [(f"`{name}`", *cells) for name, *cells in settings_table(found)])


def _title(place: Path) -> str:
    task, scene, period = place.parts
    return f"{task} on `{scene}`, every {period.removesuffix('s')} s"


class Controllers(MarkdownDirective):
    """All families, one section each."""

    def markdown(self) -> str:
        """Purpose, settings with stored results, and gains."""
        return "\n\n".join(part for key in FAMILIES for part in self._family(key))

    def _family(self, key: str) -> Iterator[str]:
        family = FAMILIES[key]
        yield f"## {key}\n\n{family.about} *Use:* {family.use[0].lower()}{family.use[1:]}"
        made = f" Class: [`uvms_gym.{family.kind.__name__}`](api/controllers.md)." if family.kind else ""
        default = f" Default setting: `{family.default}`." if len(family.settings) > 1 else ""
        yield f"Tasks: {', '.join(TASKS[task] for task in family.tasks)}.{default}{made}"
        for place in places():
            if found := stored([name for name in CONTROLLERS if split(name)[0] == key], place):
                yield f"{_title(place)}:\n\n{_table(found)}"
        if family.kind is not None and (gains := gain_texts(family.kind)):
            yield table(("gain", "meaning"), [(f"`{name}`", text) for name, text in gains.items()])


class Ranking(MarkdownDirective):
    """Rivals of all tasks, minimum error first."""

    def markdown(self) -> str:
        """One table for each place with stored results."""
        parts = []
        for place in places():
            self.env.note_dependency(str(PRETRAINED / place / "results.json"))
            found = [one for one in stored(names(rivals=True), place) if one.metrics]
            found.sort(key=lambda one: one.metrics["pose"]["whole"]["iqm"]["value"])
            parts.append(f"{_title(place)}:\n\n{_table(found)}")
        return "\n\n".join(parts)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_directive("controllers", Controllers)
    app.add_directive("ranking", Ranking)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
