"""Texts of the repository as pages of the site: links between them, and alternative texts of pictures.

Pages include files that lie outside of `docs`, such as training/README.md. Their links point to files of the
repository: they become links to the page that shows the file, or plain text where no page does.
"""

import os
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)
ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"

#: Page that shows a file of the repository, or a section of it.
PAGES = {
    "CHANGELOG.md": "changelog",
    "CONTRIBUTING.md": "contributing",
    "README.md": "index",
    "src/NOTATION.md": "notation",
    "tests/golden/README.md": "golden",
    "training/README.md": "training",
    "training/own_task.py": "examples",
    "training/ray_evaluate.py": "examples",
    "training/ray_train.py": "examples",
}
_LINK = re.compile(r"(?P<picture>!?)\[(?P<text>(?:[^\[\]]|\[[^\]]*\])*)\]\((?P<target>[^()\s]+)\)")


def rewrite(text: str, file: Path, page: Path) -> str:
    """Text of a file with its links as seen from a page.

    Parameters
    ----------
    text : str
        Markdown.
    file : Path
        File that the text is of.
    page : Path
        Page that shows it.
    """

    def link(match: re.Match[str]) -> str:
        target = match["target"]
        if re.match(r"[a-z]+:|#|/", target):
            return match[0]
        path, _, anchor = target.partition("#")
        absolute = (file.parent / path).resolve()
        if not absolute.exists():
            raise ExtensionError(f"{file.relative_to(ROOT)}: link to {target}, which does not exist")
        inside = absolute.relative_to(ROOT).as_posix()
        shown = PAGES.get(f"{inside}#{anchor}") or PAGES.get(inside)
        if match["picture"]:
            return f"![{match['text']}]({os.path.relpath(absolute, page.parent)})"
        if absolute.is_relative_to(DOCS) and absolute.suffix == ".md":
            return f"[{match['text']}]({os.path.relpath(absolute, page.parent)}{'#' + anchor if anchor else ''})"
        if shown:
            return f"[{match['text']}]({os.path.relpath(DOCS / shown, page.parent)}.md)"
        return match["text"]

    return "".join(
        part if part.startswith("```") else _LINK.sub(link, part) for part in re.split(r"(?ms)(^```.*?^```)", text)
    )


def _rewrite_page(app: Sphinx, docname: str, source: list[str]) -> None:
    page = Path(app.env.doc2path(docname))
    source[0] = rewrite(source[0], page, page)


def _rewrite_included(app: Sphinx, relative_path: Path, parent: str, content: list[str]) -> None:
    file = (Path(app.srcdir) / relative_path).resolve()
    # Pages that include anything lie directly in `docs`.
    content[0] = rewrite(content[0], file, DOCS / "page.md")


def _check_pictures(app: Sphinx, doctree: nodes.document, docname: str) -> None:
    for picture in doctree.findall(nodes.image):
        if not picture.get("alt", "").strip():
            LOGGER.warning("picture without alternative text: %s", picture["uri"], location=picture)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("source-read", _rewrite_page)
    app.connect("include-read", _rewrite_included)
    app.connect("doctree-resolved", _check_pictures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
