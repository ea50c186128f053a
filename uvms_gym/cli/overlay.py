"""Overlay of `uvms play`: time, errors, disturbance, and a chart of the errors so far."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Picture = NDArray[np.uint8]

_WHITE, _GREY = (255, 255, 255, 255), (205, 222, 228, 255)
_PANEL = (6, 28, 40, 165)
_GRID = (255, 255, 255, 45)
#: Height of the chart with its margins, and the margins, pixels.
_CHART, _MARGIN, _LEFT = 92, 8, 56


class Curve(NamedTuple):
    """A charted entry of `info`."""

    entry: str
    title: str
    unit: str
    scale: float
    colour: tuple[int, int, int, int]


#: Errors, in readable units.
CURVES = (
    Curve("position_error", "position", "cm", 100.0, (120, 235, 160, 255)),
    Curve("end_effector_position_error", "end effector", "cm", 100.0, (255, 120, 215, 255)),
    Curve("attitude_error", "attitude", "°", 180.0 / math.pi, (255, 205, 90, 255)),
)


class Overlay:
    """Draws on the pictures of one episode; `seconds` is its duration, the width of the chart."""

    def __init__(self, title: str, disturbance: str, seconds: float) -> None:
        self._title = title
        self._disturbance = disturbance
        self._seconds = seconds
        self._times: list[float] = []
        self._values: dict[str, list[float]] = {curve.entry: [] for curve in CURVES}
        self._font, self._small = ImageFont.load_default(15), ImageFont.load_default(12)

    def note(self, time: float, info: Mapping[str, float]) -> None:
        """Append charted entries at a time, s."""
        self._times.append(time)
        for curve in CURVES:
            self._values[curve.entry].append(curve.scale * info.get(curve.entry, math.nan))

    def draw(self, picture: Picture, info: Mapping[str, float]) -> Picture:
        """Copy of a picture with the overlay."""
        image = Image.fromarray(picture).convert("RGBA")
        layer = Image.new("RGBA", image.size)
        pen = ImageDraw.Draw(layer)
        self._text(pen, image.width, info)
        self._chart(pen, image.width, image.height)
        return np.asarray(Image.alpha_composite(image, layer).convert("RGB"))

    def _text(self, pen: ImageDraw.ImageDraw, width: int, info: Mapping[str, float]) -> None:
        pen.rectangle((0, 0, width, 30), fill=_PANEL)
        pen.text((10, 6), self._title, _WHITE, self._font)
        now = self._times[-1] if self._times else 0.0
        speed = math.hypot(*(info.get(f"current_{axis}", 0.0) for axis in "xyz"))
        right = f"current {speed:.2f} m/s    {now:5.1f} s"
        if self._disturbance:
            right = f"{self._disturbance}    {right}"
        pen.text((width - 10, 6), right, _WHITE, self._font, anchor="ra")

    def _chart(self, pen: ImageDraw.ImageDraw, width: int, height: int) -> None:
        top = height - _CHART
        pen.rectangle((0, top, width, height), fill=_PANEL)
        left, right, low, high = _LEFT, width - 12, height - 18, top + 24
        shown = [curve for curve in CURVES if any(map(math.isfinite, self._values[curve.entry]))]
        most = max((v for c in shown for v in self._values[c.entry] if math.isfinite(v)), default=1.0)
        step = nice_step(most)
        ceiling = step * max(2, math.ceil(most / step))
        for k in range(int(ceiling / step) + 1):
            y = low - (low - high) * k * step / ceiling
            pen.line((left, y, right, y), fill=_GRID)
            pen.text((left - 6, y), f"{k * step:g}", _GREY, self._small, anchor="rm")
        beat = nice_step(self._seconds, 6)
        for k in range(int(self._seconds / beat) + 1):
            x = left + (right - left) * k * beat / self._seconds
            pen.text((x, low + 3), f"{k * beat:g} s", _GREY, self._small, anchor="ma" if k else "la")
        x = left
        for curve in shown:
            values = self._values[curve.entry]
            label = f"{curve.title} {values[-1]:.1f} {curve.unit}"
            pen.line((x, top + 12, x + 14, top + 12), fill=curve.colour, width=3)
            pen.text((x + 19, top + 12), label, _WHITE, self._small, anchor="lm")
            x += 195
            points = [
                (left + (right - left) * min(t / self._seconds, 1.0), low - (low - high) * v / ceiling)
                for t, v in zip(self._times, values, strict=True)
                if math.isfinite(v)
            ]
            if len(points) > 1:
                pen.line(points, fill=curve.colour, width=2, joint="curve")


def nice_step(most: float, parts: int = 3) -> float:
    """Least step of 1, 2 or 5 times a power of ten with at most `parts` steps up to `most`."""
    least = max(most, 1e-6) / parts
    power: float = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least * (1.0 - 1e-9))
