"""Frame of a film of `uvms play`: a title above the picture of the scene, and a chart of the errors so far below it."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from uvms_gym.viewer.curves import CURVES, Curve

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]

WHITE, GREY, GRID, PANEL = (255, 255, 255), (205, 222, 228), (52, 84, 98), (10, 44, 58)
#: Heights of title and chart in a picture of 480 lines, pixels; both grow with the picture.
_TITLE, _CHART = 30, 92
_BASE = 480


def _rgb(colour: str) -> Colour:
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


#: Colours of texts and curves, which a palette must contain.
COLOURS = (WHITE, GREY, GRID, PANEL, *(_rgb(curve.colour) for curve in CURVES))


class Overlay:
    """Composes the pictures of one episode.

    `title` is the text at the left, `disturbance` the level of disturbances; `size` and `view` are width and height,
    pixels, of the whole picture and of the part for the scene.
    """

    def __init__(
        self, title: str, disturbance: str, seconds: float, size: tuple[int, int], curves: Sequence[Curve]
    ) -> None:
        self._texts = (title, disturbance)
        self._seconds = seconds
        self._size, self._curves = size, curves
        self._scale = min(size[0] / (4 * _BASE / 3), size[1] / _BASE)
        self._bar, self._low = round(_TITLE * self._scale), round(_CHART * self._scale)
        self.view = (size[0], size[1] - self._bar - self._low)
        self._inks = [_rgb(curve.colour) for curve in curves]
        self._times: list[float] = []
        self._info: Mapping[str, float] = {}
        self._values: list[list[float]] = [[] for _ in curves]
        self._font, self._small = (ImageFont.load_default(max(9.0, x * self._scale)) for x in (15.0, 12.0))

    def note(self, time: float, info: Mapping[str, float]) -> None:
        """Append the errors at a time, s, to the chart."""
        self._times.append(time)
        self._info = info
        for values, curve in zip(self._values, self._curves, strict=True):
            values.append(curve.scale * info.get(curve.entry, math.nan))

    def draw(self, picture: Picture) -> Picture:
        """Compose the picture of the last time that was noted from the scene's picture."""
        image = Image.new("RGB", self._size, PANEL)
        image.paste(Image.fromarray(picture), (0, self._bar))
        pen = ImageDraw.Draw(image)
        self._head(pen)
        self._chart(pen)
        return np.asarray(image)

    def _pixels(self, length: float) -> int:
        return max(1, round(length * self._scale))

    def _head(self, pen: ImageDraw.ImageDraw) -> None:
        title, disturbance = self._texts
        speed = math.hypot(*(self._info.get(f"current_{axis}", 0.0) for axis in "xyz"))
        right = "    ".join(filter(None, (disturbance, f"current {speed:.2f} m/s", f"{self._times[-1]:5.1f} s")))
        margin, middle = self._pixels(10.0), self._bar // 2
        # The title is shortened.
        room = self._size[0] - 3 * margin - pen.textlength(right, self._font)
        while len(title) > 1 and pen.textlength(title, self._font) > room:
            title = title.removesuffix("…")[:-1] + "…"
        pen.text((margin, middle), title, WHITE, self._font, anchor="lm")
        pen.text((self._size[0] - margin, middle), right, WHITE, self._font, anchor="rm")

    def _chart(self, pen: ImageDraw.ImageDraw) -> None:
        (width, height), pixels = self._size, self._pixels
        top = height - self._low
        left, right, low, high = pixels(56.0), width - pixels(12.0), height - pixels(18.0), top + pixels(24.0)
        most = max((v for values in self._values for v in values if math.isfinite(v)), default=1.0)
        step = nice_step(most)
        ceiling = step * max(2, math.ceil(most / step))
        for k in range(round(ceiling / step) + 1):
            y = low - (low - high) * k * step / ceiling
            pen.line((left, y, right, y), fill=GRID)
            pen.text((left - pixels(6.0), y), f"{k * step:g}", GREY, self._small, anchor="rm")
        beat = nice_step(self._seconds, 6)
        for k in range(math.floor(self._seconds / beat + 1e-9) + 1):
            x = left + (right - left) * k * beat / self._seconds
            # The last one stays inside.
            anchor = "la" if k == 0 else "ra" if x > right - pixels(20.0) else "ma"
            pen.text((x, low + pixels(3.0)), f"{k * beat:g} s", GREY, self._small, anchor=anchor)
        column = (right - left) / len(self._curves)
        for k, (curve, ink, values) in enumerate(zip(self._curves, self._inks, self._values, strict=True)):
            label = f"{curve.title} {values[-1]:.1f} {curve.unit}"
            x, y = left + k * column, top + pixels(12.0)
            pen.line((x, y, x + pixels(14.0), y), fill=ink, width=pixels(3.0))
            pen.text((x + pixels(19.0), y), label, WHITE, self._small, anchor="lm")
            points = [
                (left + (right - left) * min(t / self._seconds, 1.0), low - (low - high) * v / ceiling)
                for t, v in zip(self._times, values, strict=True)
                if math.isfinite(v)
            ]
            if len(points) > 1:
                pen.line(points, fill=ink, width=pixels(2.0), joint="curve")


def nice_step(most: float, parts: int = 3) -> float:
    """Minimum step of 1, 2 or 5 times a power of ten with at most `parts` steps up to `most`."""
    minimum = max(most, 1e-6) / parts
    power: float = 10.0 ** math.floor(math.log10(minimum))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= minimum * (1.0 - 1e-9))
