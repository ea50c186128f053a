"""Help of every command on a terminal of 80 columns."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
import typer

from uvms_gym.cli import main
from uvms_gym.cli.app import app


def commands(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[Any, list[str]]]:
    """Every command and group, with the words that call it."""
    yield command, [*path]
    for name, child in getattr(command, "commands", {}).items():
        yield from commands(child, (*path, name))


#: Options and arguments without which something is not done, or asked of others.
NOTHING_WITHOUT = (
    {"--json", "--out", "--plot", "--mcap", "--export", "--tensorboard-log"}
    | {"--env", "--base", "--start", "--env-kwargs", "--hyperparams", "--trained-agent"}
    | {"outline", "--box", "--cylinder", "--capsule", "--ellipsoid"}
)
COMMANDS = [pytest.param(*found, id=" ".join(["uvms", *found[1]])) for found in commands(typer.main.get_command(app))]


def unwrapped(text: str) -> str:
    """Text on one line; words are broken at their own hyphens alone."""
    return " ".join(re.sub(r"-\n +", "-", text).split())


@pytest.mark.parametrize(("command", "words"), COMMANDS)
def test_help_at_80_columns_has_every_word_and_every_default(
    command: Any, words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main([*words, "--help"]) == 0
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 80
    assert "…" not in printed
    assert "..." not in printed.replace("[ARGS]...", "")
    shown = unwrapped(printed)
    for parameter in command.params:
        assert unwrapped(parameter.help or "") in shown, parameter.name
        if parameter.secondary_opts:
            assert any(f"[default: {option.lstrip('-')}]" in shown for option in parameter.opts), parameter.name
        elif parameter.default not in (None, False, (), []):
            assert f"[default: {parameter.default}]" in shown, parameter.name
    for child in getattr(command, "commands", {}).values():
        assert unwrapped((child.help or "").split("\n\n")[0]) in shown


def test_every_option_without_a_value_says_what_then_holds() -> None:
    silent = {
        option
        for command, _ in commands(typer.main.get_command(app))
        for parameter in command.params
        for option in parameter.opts[-1:]
        if parameter.default is None and not parameter.required and "[default: " not in (parameter.help or "")
    }
    assert silent <= NOTHING_WITHOUT
