"""Directive `commands`: the commands of `uvms` with their arguments and options, from the parser itself."""

from typing import Any

import typer
from made_markdown import MarkdownDirective, table
from sphinx.application import Sphinx

from uvms_gym.cli.app import app as uvms


def _text(help: str | None) -> str:
    return " ".join((help or "").split()).replace("*", "\\*").replace("<", "&lt;")


def describe(command: Any, name: str) -> list[str]:
    """Sections of a command, or of the commands of a group."""
    if hasattr(command, "commands"):
        return [part for key, value in command.commands.items() for part in describe(value, f"{name} {key}")]
    rows = []
    for parameter in command.params:
        if "--help" in parameter.opts:
            continue
        if parameter.param_type_name == "argument":
            shown = f"`{parameter.name.upper()}`"
        else:
            shown = ", ".join(f"`{option}`" for option in [*parameter.opts, *parameter.secondary_opts])
        default = parameter.default
        given = (
            ""
            if default is None or default is False or default in ((), [], "") or callable(default)
            else f"`{_plain(default)}`"
        )
        rows.append((shown, _text(getattr(parameter, "help", "")), given))
    paragraphs = (command.help or "").split("\n\n")
    about = "\n\n".join(_text(paragraph) for paragraph in paragraphs)
    return [f"## {name}\n\n{about}\n\n" + (table(("Argument or option", "Meaning", "Default"), rows) if rows else "")]


def _plain(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(getattr(value, "value", value))


class Commands(MarkdownDirective):
    """All commands, one section each."""

    def markdown(self) -> str:
        """Sections in the order of `uvms --help`."""
        return "\n\n".join(describe(typer.main.get_command(uvms), "uvms"))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
