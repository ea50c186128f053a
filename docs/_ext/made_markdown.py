"""Directives whose content is Markdown that is made when the site is built."""

from collections.abc import Sequence

from docutils import nodes
from sphinx.util.docutils import SphinxDirective


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


class MarkdownDirective(SphinxDirective):
    """Directive that is replaced by the Markdown that `markdown` returns."""

    def markdown(self) -> str:
        """Text in place of the directive; sections begin at level 2."""
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        """Parse the text in place."""
        # As MyST's own `include`: sections become sections of the page.
        self.state._renderer.nested_render_text(self.markdown(), self.lineno)
        return []
