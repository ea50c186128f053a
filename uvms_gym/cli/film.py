"""Files of pictures: .mp4, .gif, .png."""

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Picture = NDArray[np.uint8]

#: Greatest frame rate of a GIF, 1/s.
_GIF_RATE = 25.0


def write_film(path: Path, pictures: Iterable[Picture], rate: float) -> None:
    """Write pictures at `rate` per second as a video or an animation, or the last one, by the suffix of the file.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    {".mp4": _write_mp4, ".gif": _write_gif, ".png": _write_png}[path.suffix.lower()](path, iter(pictures), rate)


def _write_mp4(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    """H.264, by imageio-ffmpeg."""
    import imageio_ffmpeg

    first = next(pictures)
    height, width, _ = first.shape
    options = {"quality": 8, "macro_block_size": 2, "ffmpeg_log_level": "error"}
    writer = imageio_ffmpeg.write_frames(str(path), (width, height), fps=rate, **options)
    writer.send(None)
    try:
        for picture in chain([first], pictures):
            writer.send(np.ascontiguousarray(picture))
    finally:
        writer.close()


def _write_gif(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    """Half the size, at most 25 pictures per second, by Pillow."""
    every = max(1, round(rate / _GIF_RATE + 0.49))
    images = []
    for count, picture in enumerate(pictures):
        if count % every == 0:
            image = Image.fromarray(picture)
            image = image.resize((image.width // 2, image.height // 2), Image.Resampling.LANCZOS)
            images.append(image.quantize(128, dither=Image.Dither.NONE))
    duration = round(1000.0 * every / rate)
    images[0].save(path, save_all=True, append_images=images[1:], duration=duration, loop=0, optimize=True)


def _write_png(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    """The last picture, by Pillow."""
    *_, last = pictures
    image = Image.fromarray(last)
    # A dithered palette is small and looks like full colour.
    palette = image.quantize(256, Image.Quantize.MAXCOVERAGE)
    image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)
