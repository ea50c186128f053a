"""Blocks of entries in observations, actions and privileged information."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Block:
    """Named run of entries in a row of observations, actions or privileged information.

    Attributes
    ----------
    name : str
        Name of the quantity.
    offset, length : int
        First entry and number of entries; `row[..., block.slice]` are the entries.
    scale : tuple of float (length,)
        Physical value of an entry of 1. An action's entry of -1 asks for `low`, which may differ from `-scale`.
    low, high : tuple of float (length,)
        Physical values at the least and at the greatest entry; infinite where there is no bound.
    unit : str
        Unit of the physical value.
    description : str
        Meaning, with the axes.
    """

    name: str
    offset: int
    length: int
    scale: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    unit: str
    description: str

    @property
    def slice(self) -> slice:
        """Entries of the block in a row."""
        return slice(self.offset, self.offset + self.length)


def blocks(given: Iterable[Mapping[str, Any]]) -> tuple[Block, ...]:
    """Blocks of a native layout."""
    return tuple(Block(**block) for block in given)
