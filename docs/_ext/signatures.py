"""Signatures as written, from the source text of Python functions and from the stubs of the native module.

Sphinx would print aliases such as `ArrayLike` as the unions that they stand for, and no annotations of native
methods. Docstrings become reStructuredText.
"""

import ast
import inspect
import re
import textwrap
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

import uvms_gym

Function = ast.FunctionDef | ast.AsyncFunctionDef


def _definitions(body: list[ast.stmt], prefix: str = "") -> dict[str, ast.stmt]:
    """Functions and classes by qualified name."""
    found: dict[str, ast.stmt] = {}
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[prefix + node.name] = node
        if isinstance(node, ast.ClassDef):
            found |= _definitions(node.body, f"{prefix}{node.name}.")
    return found


STUBS = _definitions(ast.parse((Path(uvms_gym.__file__).parent / "_core.pyi").read_text()).body)


def _definition(name: str, value: Any) -> Function | None:
    """Definition of a function, or of what makes an instance of a class."""
    qualified = name.removeprefix("uvms_gym._core.").removeprefix("uvms_gym.")
    if "__signature__" in vars(value) if inspect.isclass(value) else False:
        return None
    try:
        node = ast.parse(textwrap.dedent(inspect.getsource(value))).body[0]
    except (TypeError, OSError):
        found = STUBS.get(qualified)
        if isinstance(found, ast.ClassDef):
            found = STUBS.get(f"{qualified}.__new__")
        return found if isinstance(found, ast.FunctionDef) else None
    if isinstance(node, ast.ClassDef):
        # A dataclass, and a class that inherits its constructor, are left to Sphinx.
        return next((m for m in node.body if isinstance(m, ast.FunctionDef) and m.name == "__init__"), None)
    return node if isinstance(node, Function) else None


def _sign(
    app: Sphinx, what: str, name: str, value: Any, options: Any, arguments: str | None, returns: str | None
) -> tuple[str, str | None] | None:
    if what not in ("class", "function", "method") or (node := _definition(name, value)) is None:
        return None
    given = node.args
    static = any(isinstance(d, ast.Name) and d.id == "staticmethod" for d in node.decorator_list)
    if what != "function" and not static:
        (given.posonlyargs or given.args).pop(0)
    shown = ast.unparse(node.returns) if node.returns is not None and what != "class" else None
    return f"({ast.unparse(given)})".replace("_Rows", "ArrayLike | None").replace("_Floats", "NDArray"), (
        None if shown is None else shown.replace("_Floats", "NDArray")
    )


def _escape(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Escape characters that reStructuredText would take for markup, outside of code."""
    for i, line in enumerate(lines):
        head, *tail = re.split(r"(`[^`]*`)", line)
        parts = [part if part.startswith("`") else re.sub(r"(?<=\S)\*|\|", r"\\\g<0>", part) for part in (head, *tail)]
        lines[i] = "".join(parts)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("autodoc-process-signature", _sign)
    # Before napoleon.
    app.connect("autodoc-process-docstring", _escape, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
