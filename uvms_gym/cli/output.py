"""Tables and files of all commands."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from uvms_gym._files import write
from uvms_gym.cli.common import console, fail, line, prepare, user_errors
from uvms_gym.studies import records

#: Blanks between columns, share of a line for the first columns beside numbers, and the longest unbroken cell.
_GAP, _SHARE, _CELL = 2, 0.5, 40


def table(title: str, header: Sequence[str], rows: Iterable[Sequence[Any]], text_columns: int = 1) -> None:
    """Print a table; all but the first columns contain numbers.

    No number is broken: columns that do not fit beside the others follow below, under the first columns again.
    """
    console.print(title, style="bold", markup=False)
    cells = [[str(cell) for cell in row] for row in rows]
    columns = [[row[i] for row in cells] for i in range(len(header))]
    first, numbers = range(text_columns), range(text_columns, len(header))
    whole = [max(map(len, [name, *column])) for name, column in zip(header, columns)]
    fits = sum(whole) + _GAP * (len(header) - 1) <= console.width
    # Headers are broken between words where that helps.
    widths = whole if fits else [max(map(len, [*c, *name.split()]), default=0) for name, c in zip(header, columns)]
    for i in numbers if not fits else ():
        words = [word for text in (header[i], *columns[i]) for word in text.split()]
        widths[i] = min(widths[i], max(_CELL, *map(len, words), 0))
    while numbers and not fits and sum(widths[i] + _GAP for i in first) > _SHARE * console.width:
        widths[max(first, key=lambda i: widths[i])] -= 1
    free = console.width - sum(widths[i] + _GAP for i in first) + _GAP
    blocks: list[list[int]] = [[]]
    for i in numbers:
        if blocks[-1] and sum(widths[k] + _GAP for k in (*blocks[-1], i)) > free:
            blocks.append([])
        blocks[-1].append(i)
    for block in blocks:
        drawn = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, collapse_padding=True)
        for i in (*first, *block):
            justify: Literal["left", "right"] = "left" if i < text_columns else "right"
            drawn.add_column(escape(header[i]), justify=justify, overflow="fold", width=widths[i] if block else None)
        for row in cells:
            drawn.add_row(*(escape(row[i]) for i in (*first, *block)))
        console.print(drawn)
        console.print()


def scientific(value: float, decimals: int = 1) -> str:
    """Write a number with its exponent, without zeros in the exponent; "diverged" where it is not finite."""
    if not math.isfinite(value):
        return "diverged"
    mantissa, exponent = f"{value:.{decimals}e}".split("e")
    return f"{mantissa}e{int(exponent)}" if value else "0"


def say(text: str) -> None:
    """Print a paragraph."""
    console.print(text, style="dim", markup=False)
    console.print()


def write_json(path: Path, data: dict[str, Any]) -> None:
    """Write data as JSON."""
    with user_errors(verb="write"):
        records.write_json(path, data)


def write_text(text: str, out: Path | None, force: bool, option: str = "--out") -> None:
    """Write a text to a file, whose option errors name, or to the terminal; an existing file only by `force`."""
    if out is None:
        print(text, end="")
        return
    if out.exists() and not force:
        raise fail(f"{out} exists: give another {option}, or --force to overwrite it")
    prepare(None, out)
    with user_errors(verb="write"):
        write(out, text)
    line(f"wrote {out}")


def write_results(out: Path, files: Sequence[str], json_file: Path | None, data: dict[str, Any]) -> None:
    """Write data to the first of `files` in `out` and to `json_file`.

    Numbers before pictures, pictures before tables: a terminal or a pipe that closes loses no file.
    """
    for path in {out / files[0], json_file or out / files[0]}:
        write_json(path, data)


def name_files(out: Path, files: Sequence[str], note: str = "") -> None:
    """Print the names of all files of the run."""
    line(f"{out}: {', '.join(files)}{note}")
