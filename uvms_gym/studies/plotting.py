"""Style and files of all figures. Agg only: no window, no global state of pyplot."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uvms_gym._files import replacing

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours of Okabe and Ito: distinct to colour-blind readers, too.
BLACK, ORANGE, BLUE, GREEN, VERMILION, PURPLE = "#000000", "#e69f00", "#0072b2", "#009e73", "#d55e00", "#cc79a7"
COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, BLACK)
GREY = "#777777"
STYLE: Any = {
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.6,
    "figure.constrained_layout.use": True,
}


@contextmanager
def picture(path: Path, width: float, height: float, dpi: float = 130, **style: Any) -> "Iterator[Figure]":
    """Give an empty figure of a size in inches in the common style, and write it to `path` at the end.

    Parameters
    ----------
    **style
        Settings of matplotlib over those of `STYLE`, with "__" for each dot.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    settings: Any = {**STYLE, **{name.replace("__", "."): value for name, value in style.items()}}
    with mpl.rc_context(settings):
        figure = Figure(figsize=(width, height))
        yield figure
        with replacing(path) as file:
            figure.savefig(file, dpi=dpi, format=path.suffix.removeprefix(".").lower() or None)


def legend_above(axes: "Axes", lines: Sequence["Artist"] | None = None, columns: int = 8) -> None:
    """Legend of lines, or of all, above the axes at the right, where it covers no curve; the title is at the left.

    Where title and legend do not fit beside each other, the title is above.
    """
    lines = axes.get_legend_handles_labels()[0] if lines is None else lines
    legend = axes.legend(
        lines,
        [str(line.get_label()) for line in lines],
        ncols=min(columns, len(lines)),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.1,
        borderpad=0.1,
        columnspacing=1.2,
        handlelength=1.5,
    )
    title = axes._left_title  # type: ignore[attr-defined]
    if title.get_window_extent().x1 > legend.get_window_extent().x0:
        axes.set_title(title.get_text(), pad=6.0 + 12.0 * -(-len(lines) // columns))
