"""Options that commands share.

Lists are given by repeating an option (`--scene a --scene b`); commas separate the entries of one vector (`X,Y,Z`).
"""

import math
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, CallbackParam, Option

from uvms_gym.cli.common import check_range, fail, held, user_errors
from uvms_gym.controllers.registry import policies_in


def several(text: str, default: str = "all", metavar: str = "NAME", **options: Any) -> Any:
    """Make an option that may be repeated, with its default in the help."""
    return Option(help=f"{text}; may be repeated. [default: {default}]", metavar=metavar, **options)


def within(minimum: float, most: float = math.inf) -> Any:
    """Make the callback of an option that checks the range of its number, or of each in a list."""

    def check(parameter: CallbackParam, value: Any) -> Any:
        for number in value if isinstance(value, list | tuple) else [value]:
            if number is not None:
                check_range(max(parameter.opts, key=len), number, minimum, most)
        return value

    return check


def ranged(text: str, minimum: float, most: float = math.inf, *names: str, **options: Any) -> Any:
    """Make an option for a number within a range."""
    return Option(*names, help=text, callback=within(minimum, most), **options)


def vector(option: str, text: str) -> list[float]:
    """Numbers of an option, separated by commas."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise fail(f'{option} "{text}" must be numbers separated by commas') from None


def placement(option: str, text: str, pose: str) -> dict[str, list[float]]:
    """Position, m, and roll, pitch, yaw, rad (default 0), behind the @ of an option's text."""
    numbers = vector(f"{option} {text}:", pose)
    if len(numbers) not in (3, 6):
        raise fail(f'{option} "{text}" needs 3 or 6 numbers after the @')
    return {"position": numbers[:3], "rpy": numbers[3:] or [0.0, 0.0, 0.0]}


def _search(folder: Path | None) -> Path | None:
    """Search a folder of policies until the command ends."""
    if folder is not None:
        with user_errors():
            held.enter_context(policies_in(folder))
    return folder


Out = Annotated[Path, Option("--out", metavar="DIR", help="Folder for pictures (PNG) and JSON.")]
Json = Annotated[Path | None, Option("--json", metavar="FILE", help="File for all numbers as JSON.")]
#: File of a command that prints a scene.
TextFile = Annotated[
    Path | None, Option("--out", metavar="FILE", help="File to write the TOML text to. [default: the terminal]")
]
Force = Annotated[bool, Option("--force", help="Overwrite an existing file.")]
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
