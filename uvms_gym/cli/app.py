"""Commands of `uvms`, exit statuses and error lines."""

import inspect
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

import typer
from typer import Option

from uvms_gym import __version__
from uvms_gym.cli import robots, ros2, scenes
from uvms_gym.cli.accuracy import accuracy
from uvms_gym.cli.ardupilot import ardupilot
from uvms_gym.cli.bench import bench
from uvms_gym.cli.common import console, held
from uvms_gym.cli.compare import compare, verify
from uvms_gym.cli.compose import compose
from uvms_gym.cli.controllers import controllers
from uvms_gym.cli.disturbances import disturbances
from uvms_gym.cli.explain import explain
from uvms_gym.cli.export import export
from uvms_gym.cli.export_policy import export as export_policy
from uvms_gym.cli.fit import fit
from uvms_gym.cli.hard_cases import hard_cases
from uvms_gym.cli.play import play
from uvms_gym.cli.reproduce import reproduce
from uvms_gym.cli.train import train
from uvms_gym.cli.validate import validate

#: Exit status of a command that was interrupted.
INTERRUPTED = 130

# Help as plain text: Rich reads [default: ...] as markup, and cuts words that are longer than its narrow column.
_PLAIN: dict[str, Any] = {"no_args_is_help": True, "rich_markup_mode": None}
app = typer.Typer(
    name="uvms",
    help="Simulate, reproduce, compare and measure: underwater vehicle-manipulator systems.\n\n"
    "Lists are given by repeating an option (--scene a --scene b); commas separate the entries of one vector (X,Y,Z).",
    add_completion=False,
    pretty_exceptions_enable=False,
    **_PLAIN,
)
scenes_app = typer.Typer(help="List, show, check and explain scenes.", **_PLAIN)
ros2_app = typer.Typer(help="Nodes of ROS 2: a simulated vehicle, a controller.", **_PLAIN)


def _register(group: typer.Typer, *commands: Callable[..., Any], **named: Callable[..., Any]) -> None:
    """Add commands; their lines in the group's help are whole first paragraphs, which Typer would cut."""
    for name, command in [*((None, command) for command in commands), *named.items()]:
        first = inspect.getdoc(command) or ""
        group.command(name, short_help=" ".join(first.split("\n\n")[0].split()))(command)


_register(app, reproduce, compare, verify, controllers, disturbances, play, train)
_register(app, export=export_policy)
_register(app, validate, fit, accuracy, hard_cases, bench)
_register(app, ardupilot)
_register(scenes_app, list=scenes.list_scenes)
_register(scenes_app, scenes.show, scenes.check, explain, robots.template, robots.estimate, export)
_register(scenes_app, compose, **{"import": robots.import_robot})
app.add_typer(scenes_app, name="scenes")
_register(ros2_app, ros2.simulate, ros2.control)
app.add_typer(ros2_app, name="ros2")


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"uvms {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def run(arguments: Sequence[str] | None = None, app: typer.Typer = app, name: str = "uvms") -> int:
    """Run a command; a user error is one line on stderr. Returns the exit status."""
    _open_outputs()
    try:
        with held, _terminable(), _short_warnings(name):
            status = app(args=arguments, prog_name=name, standalone_mode=False)
        sys.stdout.flush()
        if status == INTERRUPTED:
            # Typer's status for Ctrl-C.
            raise KeyboardInterrupt
    except typer.TyperException as error:
        # A bare `uvms` has printed its help already.
        if message := " ".join(error.format_message().split()):
            print(f"{name}: {message}", file=sys.stderr)
        return error.exit_code
    except (KeyboardInterrupt, typer.Abort):
        print(f"{name}: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        console.on_broken_pipe()
        return 0
    except OSError as error:
        # A full disk behind `> FILE`: all files are written before.
        print(f"{name}: {error.filename or 'output'}: {error.strerror or error}", file=sys.stderr)
        console.on_broken_pipe()
        return 2
    return status if isinstance(status, int) else 0


def _open_outputs() -> None:
    """Give a closed output a place, and replace characters that an output cannot show."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


@contextmanager
def _short_warnings(name: str) -> Iterator[None]:
    """Print each warning as one line, without the line of code that gave it."""

    def line(message: Warning | str, *_: Any, **__: Any) -> str:
        return f"{name}: warning: {' '.join(str(message).split())}\n"

    usual, warnings.formatwarning = warnings.formatwarning, line
    try:
        yield
    finally:
        warnings.formatwarning = usual


@contextmanager
def _terminable() -> Iterator[None]:
    """SIGTERM, which clusters and shells send, acts as Ctrl-C does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    usual = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, usual)
