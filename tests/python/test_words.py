"""Words that texts begin with: a noun of the field first, then its qualification."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PYTHON = ["uvms_gym", "training", "tests", "docs"]
OPENERS = re.compile(r"(What|Such|Those|Likewise|Of|Whether)\b")
#: Functions whose keyword `help` is shown to users.
COMMAND_LINE = {"Option", "Argument", "Typer", "command", "callback", "add_argument"}


def rust_texts(code: str) -> Iterator[tuple[int, str]]:
    """First lines of doc comments and texts of errors, with their line numbers."""
    inside = False
    for number, line in enumerate(code.splitlines(), 1):
        doc = re.match(r"\s*//[/!] ?(.*)", line)
        if doc and not inside:
            yield number, doc[1]
        inside = doc is not None
        for error in re.findall(r'#\[error\("([^"]*)', line):
            yield number, error


def python_texts(code: str) -> Iterator[tuple[int, str]]:
    """Docstrings, texts of errors that are raised, and help of commands, with their line numbers."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            if text := ast.get_docstring(node):
                yield node.body[0].lineno, text
        elif isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            for argument in node.exc.args[:1]:
                yield argument.lineno, literal(argument)
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in COMMAND_LINE:
            for keyword in node.keywords:
                if keyword.arg == "help":
                    yield keyword.value.lineno, literal(keyword.value)


def literal(node: ast.expr) -> str:
    """Text that an expression begins with; empty where it is no literal."""
    if isinstance(node, ast.JoinedStr) and node.values:
        return literal(node.values[0])
    if isinstance(node, ast.BinOp):
        return literal(node.left)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def offenders() -> list[str]:
    """Places whose text begins with a word that names nothing."""
    rust = [(path, rust_texts(path.read_text())) for path in sorted((ROOT / "src").rglob("*.rs"))]
    python = [
        (path, python_texts(path.read_text())) for folder in PYTHON for path in sorted((ROOT / folder).rglob("*.py"))
    ]
    return [
        f"{path.relative_to(ROOT)}:{number}: {text.splitlines()[0]}"
        for path, texts in rust + python
        for number, text in texts
        if OPENERS.match(text)
    ]


def test_texts_begin_with_a_noun() -> None:
    found = offenders()
    assert not found, "\n".join(found)


def test_other_texts_would_show() -> None:
    rust = ["/// What is done.", "/// Of what.", "fn f() {}", "//! Such as this.", '#[error("those of {0}")]']
    rust.append('#[error("Of {0}")]')
    assert [number for number, text in rust_texts("\n".join(rust)) if OPENERS.match(text)] == [1, 4, 6]
    python = ['"""What it is."""', "def f(x):", '    """Return x."""', '    raise ValueError(f"Likewise {x}")']
    python.append('Option(help="Of x")')
    assert [number for number, text in python_texts("\n".join(python)) if OPENERS.match(text)] == [1, 4, 5]


if __name__ == "__main__":
    print(*offenders(), sep="\n")
