"""Tables of numbers: files of comma-separated values, and what tables and bags have in common."""

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uvms_gym._files import read_text
from uvms_gym.logs.errors import LogError, reading
from uvms_gym.logs.units import Floats

#: Maximum size of a file, bytes.
_MOST = 2_000_000_000


@dataclass(frozen=True)
class Table:
    """Numbers of one source, in its own units and axes; finite."""

    #: File or topic, for errors.
    source: str
    #: Place of a row by its index, for errors.
    where: Callable[[int], str]
    #: (n,) stamps.
    time: Floats
    #: (n, k) columns of each quantity.
    values: Mapping[str, Floats]


def make_table(
    source: str, where: Callable[[int], str], columns: Mapping[str, Floats], time: str, names: Mapping[str, list[str]]
) -> Table:
    """Table of columns by their names, once they are seen to be finite."""
    if len(columns[time]) == 0:
        raise LogError(f"{source}: no rows of numbers")
    for name, column in columns.items():
        if not np.isfinite(column).all():
            row = int(np.flatnonzero(~np.isfinite(column))[0])
            raise LogError(f"{where(row)}, {name}: {column[row]} is not a finite number")
    values = {key: np.stack([columns[name] for name in group], axis=-1) for key, group in names.items() if group}
    return Table(source, where, columns[time], values)


def read_table(path: Path, delimiter: str, time: str, names: Mapping[str, list[str]]) -> Table:
    """Read columns of a text file, whose first line names them.

    `delimiter` separates columns; `names` are the columns of each quantity.
    """
    with reading(path):
        text = read_text(path, _MOST, "utf-8-sig")
    lines = text.split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise LogError(f"{path}: the file is empty")
    _, header = next(_cells(path, lines[:1], delimiter))
    header = [name.strip() for name in header]
    needed = list(dict.fromkeys([time, *(name for group in names.values() for name in group)]))
    for name in needed:
        if header.count(name) != 1:
            problem = "no such column" if name not in header else "a column of this name exists twice"
            raise LogError(f"{path}: {name}: {problem}; columns: {', '.join(header)}")
    rows = _numbers(path, lines, delimiter, header, needed)
    return make_table(str(path), lambda row: f"{path}, line {row + 2}", dict(zip(needed, rows)), time, names)


def _numbers(path: Path, lines: list[str], delimiter: str, header: list[str], needed: list[str]) -> Floats:
    """Needed columns of the lines below the header, (columns, n)."""
    if len(lines) == 1:
        return np.empty((len(needed), 0))
    if all(line.count(delimiter) == len(header) - 1 and line.strip() for line in lines[1:]):
        try:
            usecols = [header.index(name) for name in needed]
            return np.loadtxt(lines[1:], delimiter=delimiter, usecols=usecols, comments=None, ndmin=2).T
        except ValueError:
            pass
    # Quoted cells, or an error: cell by cell.
    columns: list[list[float]] = [[] for _ in needed]
    for number, cells in _cells(path, lines[1:], delimiter, 2):
        if len(cells) != len(header):
            raise LogError(f"{path}, line {number}: {len(cells)} columns, but the first line has {len(header)}")
        for column, name in zip(columns, needed):
            cell = cells[header.index(name)].strip()
            try:
                column.append(float(cell.replace("_", "?")))  # Python's 1_000 is no number of a log
            except ValueError:
                raise LogError(f"{path}, line {number}, {name}: {cell!r} is not a number") from None
    return np.array(columns)


def _cells(path: Path, lines: list[str], delimiter: str, first: int = 1) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of each line; of several with a quoted cell across them, the first number."""
    # With their ends, which belong to such a cell.
    reader = csv.reader((line + "\n" for line in lines), delimiter=delimiter)
    try:
        number = first
        for cells in reader:
            yield number, cells
            number = first + reader.line_num
    except csv.Error as error:
        raise LogError(f"{path}: cannot be read: {error}") from None
