"""Progress of loops, which a command shows as bars."""

from collections.abc import Collection, Iterator
from contextvars import ContextVar
from typing import Any, TypeVar

T = TypeVar("T")

#: Bars of the running command (`rich.progress.Progress`); None: nothing is shown.
bars: ContextVar[Any] = ContextVar("bars", default=None)


def tracked(items: Collection[T], title: str) -> Iterator[T]:
    """Items of a loop; a bar with this title shows the share that is done."""
    shown = bars.get()
    task = shown.add_task(title, total=len(items)) if shown else None
    for item in items:
        yield item
        if shown:
            shown.advance(task)
    if shown:
        shown.remove_task(task)
