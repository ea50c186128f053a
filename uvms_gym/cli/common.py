"""What the commands share: options, tables, progress, folders, JSON and the circumstances of a run."""

import json
import math
import os
import platform
import subprocess
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium
import numpy as np
import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

import uvms_gym

Out = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for pictures (PNG) and JSON.")]
Json = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="File for all numbers as JSON.")]

console = Console(highlight=False)
if not console.is_terminal:
    # Files and pipes have no width; the widest tables need this much.
    console.width = max(console.width, 120)


def fail(message: str) -> typer.TyperException:
    """Make an error of the user's: one line, exit status 2."""
    error = typer.TyperException(message)
    error.exit_code = 2
    return error


def progress() -> Progress:
    """Make a bar on stderr that leaves nothing behind; none where stderr is no terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    terminal = Console(stderr=True)
    return Progress(*columns, console=terminal, transient=True, disable=not terminal.is_terminal)


def table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]], text_columns: int = 1) -> None:
    """Print a table; all but the first columns hold numbers."""
    console.print(title, style="bold", markup=False)
    drawn = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False)
    for i, name in enumerate(header):
        justify: Literal["left", "right"] = "left" if i < text_columns else "right"
        drawn.add_column(name, justify=justify, overflow="fold", no_wrap=i == 0 and text_columns == 1)
    for row in rows:
        drawn.add_row(*(escape(cell) for cell in row))
    console.print(drawn)
    console.print()


def say(text: str) -> None:
    """Print a paragraph."""
    console.print(text, style="dim", markup=False)
    console.print()


def check_range(option: str, value: float, least: float, most: float) -> None:
    """Refuse a value that is out of range or no number.

    Raises
    ------
    TyperException
        It is; the message names option and value.
    """
    if not least <= value <= most:
        raise fail(f"{option} is {value}, but must be {least:g} to {most:.15g}")


def prepare(out: Path | None, json_file: Path | None, names: Iterable[str] = ()) -> None:
    """Make the folders that a command is to write to, and check them and the files `names` in `out`.

    Raises
    ------
    TyperException
        One of them cannot be made or written to.
    """
    for folder in {folder for folder in (out, json_file and json_file.absolute().parent) if folder is not None}:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise fail(f"cannot make the folder {folder}: {error.strerror}") from None
        if not os.access(folder, os.W_OK | os.X_OK):
            raise fail(f"cannot write to the folder {folder}: permission denied")
    files = [json_file] if json_file is not None else []
    if out is not None:
        files += [out / name for name in names]
    for file in files:
        if file.is_dir():
            raise fail(f"cannot write {file}: it is a folder")
        if file.exists() and not os.access(file, os.W_OK):
            raise fail(f"cannot write {file}: permission denied")


def write_json(path: Path, data: dict[str, Any]) -> None:
    """Write numbers for machines; NaN and infinity, which JSON lacks, become null."""
    try:
        path.write_text(json.dumps(_plain(data), indent=1, allow_nan=False) + "\n")
    except OSError as error:
        raise fail(f"cannot write {path}: {error.strerror}") from None


def circumstances(command: str, arguments: dict[str, Any]) -> dict[str, Any]:
    """Tell what a result depends on: command, arguments, versions, commit and machine."""
    return {
        "command": command,
        "arguments": arguments,
        "uvms_gym": uvms_gym.__version__,
        "commit": _commit(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "gymnasium": gymnasium.__version__,
        "matplotlib": version("matplotlib"),
        "machine": {
            "system": platform.platform(),
            "architecture": platform.machine(),
            "processor": _processor(),
            "cores": os.cpu_count(),
            "lanes": uvms_gym.Simulator("free-body", 2).instruction_set,
        },
    }


def _plain(value: Any) -> Any:
    """Turn data into what JSON has."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if hasattr(value, "_asdict"):
        return _plain(value._asdict())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value


def _commit() -> str | None:
    """Commit of the sources that run, if they are a checkout; "+" where they differ from it."""
    package = Path(__file__).parents[1]

    def git(*arguments: str) -> str:
        command = ["git", "-C", os.fspath(package), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        # A package that is installed below some checkout is no part of it.
        git("ls-files", "--error-unmatch", "__init__.py")
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")
