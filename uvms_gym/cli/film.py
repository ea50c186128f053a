"""Files of pictures: .mp4, .gif, .png."""

from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Picture = NDArray[np.uint8]

#: Suffixes of files, which select the format.
SUFFIXES = (".mp4", ".gif", ".png")
#: Greatest frame rate of a GIF, 1/s.
_GIF_RATE = 25.0


class Film(Protocol):
    """A file of pictures."""

    def add(self, picture: Picture) -> None:
        """Append a picture."""

    def close(self) -> None:
        """Complete the file."""


def film(path: Path, rate: float) -> Film:
    """Open a file for pictures at `rate` per second, by its suffix."""
    kinds: dict[str, Callable[[Path, float], Film]] = {".mp4": Mp4, ".gif": Gif, ".png": Png}
    return kinds[path.suffix.lower()](path, rate)


class Mp4:
    """A video (H.264), by imageio-ffmpeg."""

    def __init__(self, path: Path, rate: float) -> None:
        self._path, self._rate = path, rate
        self._writer: Generator[None, Any, None] | None = None

    def add(self, picture: Picture) -> None:
        """Append a picture."""
        if self._writer is None:
            import imageio_ffmpeg

            height, width, _ = picture.shape
            self._writer = imageio_ffmpeg.write_frames(
                str(self._path),
                (width, height),
                fps=self._rate,
                quality=8,
                macro_block_size=2,
                ffmpeg_log_level="error",
            )
            self._writer.send(None)
        self._writer.send(np.ascontiguousarray(picture))

    def close(self) -> None:
        """Complete the file."""
        if self._writer is not None:
            self._writer.close()


class Gif:
    """An animation, by Pillow: half the size, at most 25 pictures per second."""

    def __init__(self, path: Path, rate: float) -> None:
        self._path = path
        self._every = max(1, round(rate / _GIF_RATE + 0.49))
        self._duration = round(1000.0 * self._every / rate)
        self._images: list[Image.Image] = []
        self._count = 0

    def add(self, picture: Picture) -> None:
        """Append a picture."""
        if self._count % self._every == 0:
            image = Image.fromarray(picture)
            image = image.resize((image.width // 2, image.height // 2), Image.Resampling.LANCZOS)
            self._images.append(image.quantize(128, dither=Image.Dither.NONE))
        self._count += 1

    def close(self) -> None:
        """Complete the file."""
        if self._images:
            first, *rest = self._images
            first.save(self._path, save_all=True, append_images=rest, duration=self._duration, loop=0, optimize=True)


class Png:
    """The last picture only, by Pillow."""

    def __init__(self, path: Path, rate: float) -> None:
        del rate
        self._path = path
        self._picture: Picture | None = None

    def add(self, picture: Picture) -> None:
        """Append a picture."""
        self._picture = picture

    def close(self) -> None:
        """Complete the file."""
        if self._picture is not None:
            image = Image.fromarray(self._picture)
            # A dithered palette is small and looks like full colour.
            palette = image.quantize(256, Image.Quantize.MAXCOVERAGE)
            image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(self._path, optimize=True)
