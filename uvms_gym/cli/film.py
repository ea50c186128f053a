"""Films: pictures of an episode at a rate of their own, with a title and a chart, and files (.mp4, .gif, .png)."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, islice, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from uvms_gym import Renderer
from uvms_gym._files import replacing
from uvms_gym.cli.episode_plot import Instant
from uvms_gym.cli.pictures import Frame
from uvms_gym.envs.rendering import Shot, between, mix, shots
from uvms_gym.viewer.curves import CURVES, Curve, error_curves

Picture = NDArray[np.uint8]
#: Colours of an animation besides `COLOURS`; more make files larger without a visible difference.
_PICTURE_COLOURS = 112

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
    """Pictures of one episode: a title above the picture of the scene, and a chart of the errors so far below it.

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


def film(env: Any, moments: Iterator[Instant], frame: Frame, last: bool = False) -> Iterator[Picture]:
    """Pictures of an episode at a rate of their own: what is between control instants is interpolated.

    `env` is in the state of the instant that `moments` gave last. With `last`, only the picture of the last instant is
    drawn.
    """
    curves = error_curves(env)
    overlay = Overlay(frame.title, frame.disturbance, frame.seconds, frame.settings.size, curves)
    width, height = overlay.view
    renderer = Renderer(env._native.scene, width=width, height=height, **frame.settings.camera)

    def draw(shot: Shot) -> Picture:
        return overlay.draw(renderer.draw(**shot))

    instant, shot, count = next(moments), _shot(env), 0
    names = [*(curve.entry for curve in curves), *(f"current_{axis}" for axis in "xyz")]
    for later in moments:
        if last:
            overlay.note(instant.time, instant.info)
        else:
            following = _shot(env)
            while (time := count / frame.settings.rate) < later.time - 1e-9:
                share = (time - instant.time) / (later.time - instant.time)
                overlay.note(time, {name: mix(instant.info[name], later.info[name], share) for name in names})
                yield draw(between(shot, following, share))
                count += 1
            shot = following
        instant = later
    overlay.note(instant.time, instant.info)
    yield draw(_shot(env))


def _shot(env: Any) -> Shot:
    return {name: rows[0] for name, rows in shots(env._native).items()}


def write_film(path: Path, pictures: Iterable[Picture], rate: float) -> None:
    """Write pictures at `rate` per second as a video or an animation, or the last one, by the suffix of the file."""
    if path.suffix.lower() == ".mp4":
        _write_mp4(path, iter(pictures), rate)
    elif path.suffix.lower() == ".gif":
        _write_gif(path, iter(pictures), rate)
    else:
        *_, last = pictures
        with replacing(path) as file:
            Image.fromarray(last).save(file, "png", optimize=True)


def _write_mp4(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    import imageio_ffmpeg

    first = next(pictures)
    height, width, _ = first.shape
    # The new file gets its suffix at the end.
    options: dict[str, Any] = {"quality": 8, "macro_block_size": 2, "output_params": ["-f", "mp4"]}
    with replacing(path) as file:
        writer = imageio_ffmpeg.write_frames(file.name, (width, height), fps=rate, ffmpeg_log_level="error", **options)
        writer.send(None)
        count = 0
        try:
            for picture in chain([first], pictures):
                writer.send(np.ascontiguousarray(picture))
                count += 1
        finally:
            writer.close()
        # ffmpeg's status is not returned: a full disk at the end would be missed.
        try:
            whole = imageio_ffmpeg.count_frames_and_secs(file.name)[0] == count
        except RuntimeError:
            whole = False
        if not whole:
            raise OSError("ffmpeg could not write all pictures; is the disk full?")


def _write_gif(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    """All pictures in one palette without dithering, by Pillow: files are smaller, and nothing flickers."""
    first = list(islice(pictures, 64))
    palette = _palette(np.concatenate(first[::8]))
    images = [
        Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)
        for picture in chain(first, pictures)
    ]
    moving: dict[str, Any] = {"save_all": True, "append_images": images[1:], "duration": round(1000.0 / rate)}
    with replacing(path) as file:
        images[0].save(file, "gif", optimize=False, loop=0, **moving)


def _palette(picture: Picture) -> Image.Image:
    """Palette of the texts' and curves' colours as they are, a coarse cube of all colours, and a picture's."""
    kept = [*chain.from_iterable(chain(COLOURS, product((0, 128, 255), repeat=3)))]
    # By an octree: other methods lose shadows, or what is small.
    found = Image.fromarray(picture).quantize(_PICTURE_COLOURS, Image.Quantize.FASTOCTREE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*kept, *found[: 3 * _PICTURE_COLOURS]])
    return palette
