"""Editing of a scene's TOML file: the table `integration`, with all else as it stands."""

import re
import tomllib
from pathlib import Path

from uvms_gym._files import read_text, write
from uvms_gym.cli.common import fail, user_errors

#: Start of the comment above the table.
_MARK = "# Recommended by `uvms scenes check --write`"
_HEADER = re.compile(r"^[ \t]*\[[ \t]*integration[ \t]*\].*$", re.M)
_ANY_HEADER = re.compile(r"^[ \t]*\[", re.M)


def write_integration(path: Path, integrator: str, step: float, reason: str) -> None:
    """State integrator and step in a scene's file; comments and all other tables stay as they are."""
    with user_errors():
        text = read_text(path)
    edited = with_integration(text, integrator, step, reason)
    expected = {**tomllib.loads(text), "integration": {"integrator": integrator, "step": step}}
    try:
        same = tomllib.loads(edited) == expected
    except tomllib.TOMLDecodeError:
        same = False
    if not same:
        wanted = f'integrator = "{integrator}", step = {step!r}'
        raise fail(f"{path}: integration is not stated as a table of its own: write {wanted} there by hand")
    with user_errors(verb="write"):
        write(path, edited)


def with_integration(text: str, integrator: str, step: float, reason: str) -> str:
    """Text of a scene with the table `integration`, at its place or at the end."""
    lines = {"integrator": f'integrator = "{integrator}"', "step": f"step = {step!r}"}
    note = f"{_MARK}: {reason}."
    header = _HEADER.search(text)
    if header is None:
        return "\n".join([text.rstrip("\n"), "", note, "[integration]", *lines.values(), ""])
    after = _ANY_HEADER.search(text, header.end())
    end = after.start() if after else len(text)
    before, table = text[: header.start()], text[header.end() : end]
    for key, line in lines.items():
        value = re.compile(rf"^[ \t]*{key}[ \t]*=[ \t]*(\"[^\"\n]*\"|'[^'\n]*'|[^#\n]*?)(?=[ \t]*(#.*)?$)", re.M)
        table, found = value.subn(line, table, count=1)
        if not found:
            table = f"\n{line}{table}"
    *above, last = before.rstrip("\n").rpartition("\n")
    before = "".join(above) + note + "\n" if last.startswith(_MARK) else before + note + "\n"
    return before + text[header.start() : header.end()] + table + text[end:]
