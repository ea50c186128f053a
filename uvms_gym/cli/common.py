"""Options, checks, user errors and progress bars of all commands. Checks raise what `fail` makes.

Lists are given by repeating an option (`--scene a --scene b`); commas separate the entries of one vector (`X,Y,Z`).
"""

import math
import os
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import gymnasium
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from typer import Argument, Option

import uvms_gym
from uvms_gym._files import lock
from uvms_gym.controllers.registry import policies_in
from uvms_gym.studies.progress import bars

T = TypeVar("T")


def several(text: str, default: str = "all", metavar: str = "NAME", **options: Any) -> Any:
    """Make an option that may be repeated, with its default in the help."""
    return Option(help=f"{text}; may be repeated. [default: {default}]", metavar=metavar, **options)


def _search(folder: Path | None) -> Path | None:
    """Search a folder of policies until the command ends."""
    if folder is not None:
        with user_errors():
            held.enter_context(policies_in(folder))
    return folder


#: Folder of policies; commands need not look at the value.
Policies = Annotated[
    Path | None,
    Option(
        metavar="DIR",
        callback=_search,
        help="Search policies here, too: training/policies of a checkout has all training seeds. "
        "[default: the package's, and the checkout's that it is run from]",
    ),
]
#: Names of controllers, in help texts.
CONTROLLER_HELP = "Controller: FAMILY or FAMILY/SETTING (`uvms controllers` lists them), mlp:FILE, or py:FILE.py:NAME"
#: Scene as the first argument of a command.
SceneArgument = Annotated[str, Argument(metavar="SCENE", help="Name of a shipped scene, or path of a TOML file.")]
#: Options of an environment. `train`, `play`, `compare` and `accuracy` share them; see `environment_arguments`.
Scene = Annotated[
    str | None, Option(metavar="SCENE", help="Scene: name or TOML file. [default: the environment's, petasus-pum]")
]
EnvKwargs = Annotated[
    list[str] | None,
    Option(
        metavar="KEY:VALUE",
        help="Argument of the environment, such as substeps:5, scene:FILE.toml or disturbance:storm; may be repeated.",
    ),
]


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


def environment_arguments(pairs: Sequence[str] | None, **options: Any) -> dict[str, Any]:
    """Arguments of an environment, from --env-kwargs and from the options that have a name of their own.

    `pairs` are `KEY:VALUE`, where values other than Python literals are strings; `options` are values of options by the
    argument that each sets, None or empty where an option is not given.
    """
    from uvms_gym.training.hyperparameters import parse_pairs

    with user_errors("--env-kwargs: "):
        arguments = parse_pairs(pairs or ())
    for name, value in options.items():
        if value is None or value == []:
            continue
        if name in arguments:
            raise fail(f"{name} is given twice: by --env-kwargs {name}:{arguments[name]} and by an option of its own")
        arguments[name] = value
    if not isinstance(given := arguments.get("scene", []), str | list):
        raise fail(f"scene is {given!r}, but must be the name of a scene or of a TOML file")
    return arguments


def check_environment(env: str) -> None:
    """Refuse an id that Gymnasium does not know."""
    known = ", ".join(name for name in gymnasium.registry if name.startswith("UVMS-"))
    try:
        gymnasium.spec(env)
    except (gymnasium.error.Error, ImportError) as error:
        raise fail(f"unknown environment {env!r}; known: {known} ({' '.join(str(error).split())})") from None


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


def prepare(out: Path | None, json_file: Path | None, names: Iterable[str] = ()) -> None:
    """Make the folders of a command's results, and check access to them and to the files `names` in `out`."""
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
