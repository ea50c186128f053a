"""Tables of numbers: files of comma-separated values, and what tables and bags have in common."""

import csv
import re
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uvms_gym._files import read_text
from uvms_gym.logs.errors import LogError, reading
from uvms_gym.logs.units import Floats

#: Maximum size of a file, bytes.
MAX_BYTES = 2_000_000_000
#: Cells without a number, in lower case.
_LOST = {"", "nan", "+nan", "-nan", "nan(ind)", "-nan(ind)", "na", "n/a", "null", "none"}
#: Number with commas between thousands, or with a decimal comma and three decimals.
_AMBIGUOUS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")


@dataclass(frozen=True)
class TextFormat:
    """Format of a text file's lines."""

    #: Character between columns.
    delimiter: str = ","
    #: Decimal sign; None: a point, or a comma where numbers have one that cannot separate thousands.
    decimal: str | None = None
    #: Start of lines that are comments.
    comment: str = "#"
    #: Numbers of lines that are left out, from 1.
    skip: frozenset[int] = frozenset()


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
    #: Number of rows of the source, and how many of them were left out by reason.
    rows: int
    dropped: Mapping[str, int]
    #: Remarks on how the source was read.
    notes: tuple[str, ...]

    def take(self, index: NDArray[np.int64]) -> "Table":
        """Table of the rows with these indices."""
        where, values = self.where, {key: column[index] for key, column in self.values.items()}
        return replace(self, where=lambda row: where(int(index[row])), time=self.time[index], values=values)


def make_table(
    source: str,
    where: Callable[[int], str],
    columns: Mapping[str, Floats],
    time: str,
    names: Mapping[str, list[str]],
    rows: int,
    dropped: Mapping[str, int],
    notes: Sequence[str],
) -> Table:
    """Table of columns by their names; rows with NaN are left out.

    `rows` is the number of the source's rows, `dropped` how many of them the columns lack already, by reason.
    """
    stamps = columns[time]
    if len(stamps) == 0:
        raise LogError(f"{source}: no rows of numbers")
    for name, column in columns.items():
        if np.isinf(column).any():
            row = int(np.flatnonzero(np.isinf(column))[0])
            raise LogError(f"{where(row)}, {name}: {column[row]} is not a finite number")
    values = {key: np.stack([columns[name] for name in group], axis=-1) for key, group in names.items() if group}
    lost = np.any([np.isnan(column) for column in columns.values()], axis=0)
    if "attitude" in values and values["attitude"].shape[1] == 4:  # 0 0 0 0 is no quaternion
        lost |= np.all(values["attitude"] == 0.0, axis=1)
    dropped = {**dropped, "lost frames": int(np.sum(lost))}
    counts = {reason: count for reason, count in dropped.items() if count}
    table = Table(source, where, stamps, values, rows, counts, tuple(notes))
    return table.take(np.flatnonzero(~lost)) if lost.any() else table


def read_table(path: Path, form: TextFormat, time: str, names: Mapping[str, list[str]]) -> Table:
    """Read columns of a text file, whose first line names them; `names` are the columns of each quantity."""
    text, notes = _text(path)
    lines = text.split("\n")
    # A recorder that was killed leaves the start of a line.
    cut = len(lines) if lines[-1].strip() else 0
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise LogError(f"{path}: the file is empty")
    if "\0" in lines[0]:
        raise LogError(f"{path}: cannot be read: not a text file")
    needed = list(dict.fromkeys([time, *(name for group in names.values() for name in group)]))
    header, body = _divided(path, lines, form, needed, notes)
    for name in needed:
        if header.count(name) != 1:
            problem = "no such column" if name not in header else "a column of this name exists twice"
            raise LogError(f"{path}: {name}: {problem}; columns: {', '.join(header)}")
    cut_rows = body[-1:] if body and body[-1] == cut and lines[-1].count(form.delimiter) < len(header) - 1 else []
    body = body[: len(body) - len(cut_rows)]
    empty = [number for number in body if not lines[number - 1].strip()]
    body = [number for number in body if lines[number - 1].strip()]
    rows, columns = _numbers(path, {number: lines[number - 1] for number in body}, form, header, needed, notes)
    return make_table(
        str(path),
        lambda row: f"{path}, line {rows[row]}",
        dict(zip(needed, columns)),
        time,
        names,
        len(rows) + len(empty) + len(cut_rows),
        {"empty rows": len(empty), "cut rows": len(cut_rows)},
        notes,
    )


def _text(path: Path) -> tuple[str, list[str]]:
    """Text of a file in UTF-8, UTF-16 with its mark, or Latin-1, and notes on the encoding."""
    with reading(path):
        try:
            return read_text(path, MAX_BYTES, "utf-8-sig"), []
        except UnicodeDecodeError as error:
            encoding = "UTF-16" if error.object[:2] in (b"\xff\xfe", b"\xfe\xff") else "Latin-1"
        return read_text(path, MAX_BYTES, encoding), [f"read as {encoding}, as it is not UTF-8"]


def _divided(
    path: Path, lines: list[str], form: TextFormat, needed: list[str], notes: list[str]
) -> tuple[list[str], list[int]]:
    """Names of the columns, and numbers of the lines below them that are no comments."""
    found = [number for number in range(1, len(lines) + 1) if number not in form.skip]
    if skipped := len(lines) - len(found):
        notes.append(f"lines skipped: {skipped}")
    comments = [number for number in found if lines[number - 1].startswith(form.comment)]
    names: list[str] = []
    for number in comments[:1] if comments[:1] == found[:1] else []:
        # The names themselves may be in a comment.
        names = _names(path, lines[number - 1].removeprefix(form.comment), form)
    if names and set(needed) <= set(names):
        first = comments.pop(0)
    else:
        commented = set(comments)
        first = next((n for n in found if n not in commented and lines[n - 1].strip()), 0)
        if not first:
            raise LogError(f"{path}: no line names the columns: all are comments, skipped or empty")
        names = _names(path, lines[first - 1], form)
    if comments:
        notes.append(f"lines of comments: {len(comments)}")
    left_out = set(comments)
    return names, [number for number in found if number > first and number not in left_out]


def _names(path: Path, line: str, form: TextFormat) -> list[str]:
    return [name.strip() for _, cells in _cells(path, [line], form.delimiter) for name in cells]


def _numbers(
    path: Path, lines: Mapping[int, str], form: TextFormat, header: list[str], needed: list[str], notes: list[str]
) -> tuple[Sequence[int], Floats]:
    """Numbers of the lines of rows, and their needed columns, (columns, n)."""
    numbers, texts = list(lines), list(lines.values())
    if not lines:
        return [], np.empty((len(needed), 0))
    if form.decimal != "," and all(line.count(form.delimiter) == len(header) - 1 for line in texts):
        try:
            usecols = [header.index(name) for name in needed]
            return numbers, np.loadtxt(texts, delimiter=form.delimiter, usecols=usecols, comments=None, ndmin=2).T
        except ValueError:
            pass
    # Quoted cells, lost numbers, decimal commas, or an error: cell by cell, and without a list of all cells.
    usecols = [header.index(name) for name in needed]

    def rows() -> Iterator[tuple[int, list[str]]]:
        for index, row in _cells(path, texts, form.delimiter):
            if len(row) != len(header):
                problem = f"{len(row)} columns, but the first line has {len(header)}"
                raise LogError(f"{path}, line {numbers[index]}: {problem}")
            yield numbers[index], [row[k].strip() for k in usecols]

    decimal = form.decimal or _decimal(path, (row for _, row in rows()), notes)
    found, values = array("q"), array("d")
    for number, row in rows():
        found.append(number)
        values.extend(_row(f"{path}, line {number}", row, needed, decimal))
    return found, np.frombuffer(values).reshape(-1, len(needed)).T


def _decimal(path: Path, rows: Iterable[list[str]], notes: list[str]) -> str:
    """Decimal sign that the numbers have."""
    ambiguous = None
    for cell in (cell for row in rows for cell in row if "," in cell):
        if not _AMBIGUOUS.fullmatch(cell):
            notes.append("decimal commas")
            return ","
        ambiguous = ambiguous or cell
    if ambiguous is None:
        return "."
    what = f"{ambiguous!r} has a decimal comma or a comma between thousands"
    raise LogError(f'{path}: {what}: decimal = "," in the map says the former, the latter are not read')


def _row(place: str, cells: list[str], names: list[str], decimal: str) -> list[float]:
    numbers = []
    for name, cell in zip(names, cells):
        # (Python's 1_000 is no number of a log; a point beside decimal commas separates thousands.)
        bad = "_" if decimal == "." else "_."
        text = cell if decimal == "." else cell.replace(",", ".")
        try:
            lost = cell.lower() in _LOST
            numbers.append(np.nan if lost else float("?" if any(c in cell for c in bad) else text))
        except ValueError:
            raise LogError(f"{place}, {name}: {cell!r} is not a number") from None
    return numbers


def _cells(path: Path, lines: list[str], delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Index and cells of each line; of several with a quoted cell across them, the first index."""
    # With their ends, which belong to such a cell.
    reader = csv.reader((line + "\n" for line in lines), delimiter=delimiter)
    try:
        index = 0
        for cells in reader:
            yield index, cells
            index = reader.line_num
    except csv.Error as error:
        raise LogError(f"{path}: cannot be read: {error}") from None
