"""Style, legends, ticks and files of all figures. Agg only: no window, no global state of pyplot."""

import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uvms_gym._files import replacing

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
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

    `style` are settings of matplotlib in addition to `STYLE`, with "__" for each dot.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    settings: Any = {**STYLE, **{name.replace("__", "."): value for name, value in style.items()}}
    with mpl.rc_context(settings):
        figure = Figure(figsize=(width, height), dpi=dpi)
        yield figure
        with replacing(path) as file:
            figure.savefig(file, dpi=dpi, format=path.suffix.removeprefix(".").lower() or None)


def legend_above(axes: "Axes", lines: Sequence["Artist"] | None = None, columns: int = 8) -> None:
    """Legend of lines, or of all, above the axes at the right, where it covers no curve; the title is at the left.

    Where title and legend do not fit beside each other, the title is above.
    """
    lines = axes.get_legend_handles_labels()[0] if lines is None else lines
    style: Any = {
        "loc": "lower right",
        "bbox_to_anchor": (1.0, 1.0),
        "borderaxespad": 0.1,
        "borderpad": 0.1,
        "columnspacing": 1.2,
        "handlelength": 1.5,
    }
    # Of what the layout will give to the axes: all but an inch of labels.
    figure: Any = axes.get_figure(root=True)
    width = axes.get_window_extent().width / 0.775 - 0.95 * figure.dpi
    labels = [str(line.get_label()) for line in lines]
    for rows in range(-(-len(lines) // columns), len(lines) + 1):
        legend = axes.legend(lines, labels, ncols=-(-len(lines) // rows), **style)
        if legend.get_window_extent().width <= width:
            break
    text = axes.get_title(loc="left")
    room = width - legend.get_window_extent().width
    if text and axes.set_title(text).get_window_extent().width > room:
        height = legend.get_window_extent().height / figure.dpi
        axes.set_title(text, pad=72.0 * height + 5.0)


def legend_below(figure: "Figure", columns: int) -> None:
    """Legend of the lines of all axes, each label once, below the figure."""
    handles = {label: h for axes in figure.axes for h, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=columns)


def log_ticks(axis: "Axis") -> None:
    """Ticks of a logarithmic axis with its final limits: few enough not to collide, in plain numbers."""
    from matplotlib import ticker

    low, high = axis.get_view_interval()
    decades = math.log10(high / low)
    subs = (1.0,) if decades > 2.6 else (1.0, 2.0, 5.0) if decades > 1.0 else (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)
    axis.set_major_locator(ticker.LogLocator(subs=subs, numticks=12))
    plain = 1e-4 < low and high < 1e5
    axis.set_major_formatter(ticker.FormatStrFormatter("%g") if plain else ticker.LogFormatterSciNotation())
    axis.set_minor_formatter(ticker.NullFormatter())


def label_points(axes: "Axes", points: Sequence[tuple[float, float, str, str]], **text: Any) -> None:
    """Write names beside points (x, y, name, colour), where they cover neither each other nor lines nor points.

    Limits and layout of the figure must be final. Names that are moved away are joined to their points.
    """
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

    figure: Any = axes.get_figure(root=True)
    figure.draw_without_rendering()
    frame, em = axes.get_window_extent(), figure.dpi / 72.0
    taken = [axes.transData.transform(point[:2]) for point in points]
    for line in axes.lines:
        corners = axes.transData.transform(np.asarray(line.get_xydata(), float))
        # Lines across the axes have other coordinates along x.
        if len(corners) > 1 and line.get_transform() == axes.transData:
            taken += [a + t * (b - a) for a, b in itertools.pairwise(corners) for t in np.linspace(0.0, 1.0, 40)]
    places = np.array(taken)
    boxes: list[Any] = []

    def nearest(box: Any, at: Any) -> tuple[float, bool]:
        """Distance from the text to its point, and whether another point of `points` is about as near."""
        distances = [float(np.hypot(*(np.clip(p, box.min, box.max) - p))) for p in (at, *places[: len(points)])]
        near = [d < distances[0] + 5.0 * em for d in distances[1:]]
        return distances[0], sum(near) > 1

    for x, y, name, colour in sorted(points, key=lambda point: (point[1], point[0])):
        at = axes.transData.transform((x, y))
        arrow = {"arrowstyle": "-", "color": colour, "linewidth": 0.6, "shrinkA": 1.0, "shrinkB": 2.0}
        style: Any = {"color": colour, "ha": "center", "va": "center", "arrowprops": arrow, **text}
        note: Any = axes.annotate(name, (x, y), (0, 0), textcoords="offset points", **style)
        note.set_in_layout(False)
        size = Text.get_window_extent(note)
        best: tuple[float, Any, Any] | None = None
        for away, angle in itertools.product(
            (7.0, 10.0, 14.0, 20.0, 28.0, 38.0, 50.0), np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
        ):
            way = np.array([np.cos(angle), np.sin(angle)])
            # The nearest edge of the text is at this distance.
            middle = at + em * away * way + 0.5 * way * (size.width, size.height)
            half = 0.5 * np.array([size.width, size.height]) + 1.0 * em
            box = Bbox([middle - half, middle + half])
            inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
            hidden = int((np.abs(places - middle) < half).all(axis=1).sum())
            hidden += nearest(box, at)[1]
            cost = away + 8.0 * hidden + 1e6 * sum(box.overlaps(other) for other in boxes) + (0.0 if inside else 1e4)
            if best is None or cost < best[0]:
                best = cost, middle, box
        assert best is not None
        _, middle, box = best
        boxes.append(box)
        note.set_position(tuple((middle - at) / em))
        distance, mistaken = nearest(box, at)
        note.arrow_patch.set_visible(mistaken or distance > 6.5 * em)
