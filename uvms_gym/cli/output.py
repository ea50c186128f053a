"""Tables and files of all commands."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table
from typer import Option

from uvms_gym.cli.common import console, line, user_errors
from uvms_gym.studies import records

Out = Annotated[Path, Option("--out", metavar="DIR", help="Folder for pictures (PNG) and JSON.")]
Json = Annotated[Path | None, Option("--json", metavar="FILE", help="File for all numbers as JSON.")]


def table(title: str, header: Sequence[str], rows: Iterable[Sequence[Any]], text_columns: int = 1) -> None:
    """Print a table; all but the first columns hold numbers."""
    console.print(title, style="bold", markup=False)
    drawn = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False)
    for i, name in enumerate(header):
        justify: Literal["left", "right"] = "left" if i < text_columns else "right"
        drawn.add_column(name, justify=justify, overflow="fold", no_wrap=i == 0 and text_columns == 1)
    for row in rows:
        drawn.add_row(*(escape(str(cell)) for cell in row))
    console.print(drawn)
    console.print()


def say(text: str) -> None:
    """Print a paragraph."""
    console.print(text, style="dim", markup=False)
    console.print()


def write_json(path: Path, data: dict[str, Any]) -> None:
    """Write data as JSON.

    Raises
    ------
    TyperException
        The file cannot be written.
    """
    with user_errors(verb="write"):
        records.write_json(path, data)


def write_results(
    out: Path, files: Sequence[str], json_file: Path | None, data: dict[str, Any], note: str = ""
) -> None:
    """Write data to the first of `files` in `out` and to `json_file`, and print the names of all files of the run."""
    for path in {out / files[0], json_file or out / files[0]}:
        write_json(path, data)
    line(f"{out}: {', '.join(files)}{note}")
