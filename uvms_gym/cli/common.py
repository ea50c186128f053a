"""Checks, user errors and progress bars of all commands. Checks raise what `fail` makes."""

import math
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import gymnasium
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

import uvms_gym
from uvms_gym._files import lock
from uvms_gym.studies.progress import bars

T = TypeVar("T")


class _Console(Console):
    """Output whose reader may leave: the command goes on in silence, as its files are worth more."""

    def on_broken_pipe(self) -> None:
        self.quiet = True
        # Python flushes once more at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())


console = _Console(highlight=False)
if not console.is_terminal:
    # Files and pipes have no width; the widest tables need this much.
    console.width = max(console.width, 120)


def fail(message: str) -> typer.TyperException:
    """Make a user error: one line on stderr, exit status 2."""
    error = typer.TyperException(message)
    error.exit_code = 2
    return error


def need(packages: Mapping[str, str], extra: str) -> None:
    """Refuse to go on without the packages of an extra, which are given by module."""
    if missing := sorted(package for module, package in packages.items() if find_spec(module) is None):
        raise fail(f"{', '.join(missing)} not installed; run: pip install 'uvms-gym[{extra}]'")


@contextmanager
def user_errors(place: str = "", verb: str = "read", *also: type[Exception]) -> Iterator[None]:
    """Turn errors of library calls into user errors.

    `place` is the start of the message, such as "UVMS-StationKeep-v0: "; `verb` ("read" or "write") describes access to
    files within the block; `also` are further errors to turn into user errors.
    """
    caught: tuple[type[Exception], ...] = (ValueError, TypeError, ImportError, gymnasium.error.Error, *also)
    try:
        yield
    except OSError as error:
        what = f"cannot {verb} {error.filename}: " if error.filename else place
        raise fail(f"{what}{error.strerror or error}") from None
    except RecursionError:
        raise fail(f"{place}the input is nested too deeply") from None
    except caught as error:
        # Gymnasium appends all arguments, whole scenes among them.
        reason = str(error).split(" was raised from the environment creator")[0]
        # Rust appends the number of the system's error.
        raise fail(place + re.sub(r" \(os error \d+\)", "", " ".join(reason.split()))) from None


def read_scene(scene: str) -> dict[str, Any]:
    """Read and check a scene, by name or from a TOML file."""
    with user_errors():
        loaded: dict[str, Any] = uvms_gym.load_scene(scene)
    return loaded


@contextmanager
def progress() -> Iterator[Progress]:
    """Show transient progress bars on stderr, if that is a terminal; loops of studies add their own (`tracked`)."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    terminal = _Console(stderr=True)
    with Progress(*columns, console=terminal, transient=True, disable=not terminal.is_terminal) as shown:
        token = bars.set(shown)
        try:
            yield shown
        finally:
            bars.reset(token)


def line(text: str) -> None:
    """Print one line, unwrapped."""
    console.print(text, markup=False, soft_wrap=True)


def check_range(option: str, value: float, minimum: float, most: float) -> None:
    """Refuse a number out of range, and NaN."""
    if not minimum <= value <= most:
        allowed = f"{minimum:g} to {most:.15g}" if most < math.inf else f"at least {minimum:g}"
        raise fail(f"{option} is {value}, but must be {allowed}")


def check_known(kind: str, names: Iterable[str], known: Collection[str]) -> None:
    """Refuse names that are not among those known."""
    for name in names:
        if name not in known:
            raise fail(f"unknown {kind} {name!r}; known: {', '.join(known)}")


def check_list(option: str, values: Sequence[T] | None, default: Sequence[T]) -> list[T]:
    """Values of a repeated option, or its default."""
    given = list(values or default)
    for value in given:
        if given.count(value) > 1:
            raise fail(f"{option} {value!r} is given twice")
    return given


#: Folders that this command has locked until it ends.
held = ExitStack()


def hold(folder: Path) -> None:
    """Lock a folder until the command ends."""
    try:
        held.enter_context(lock(folder))
    except BlockingIOError:
        raise fail(f"{folder} is in use by another run of uvms: wait for its end, or give another folder") from None


def prepare(out: Path | None, json_file: Path | None, names: Sequence[str] = ()) -> None:
    """Make the folders of a command's results, and check access to them; with `names` of its files lock `out`."""
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
    if out is not None and names:
        hold(out)
