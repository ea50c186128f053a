"""Files of pictures: .mp4, .gif, .png."""

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from uvms_gym._files import replacing

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
    options: dict[str, Any] = {"quality": 8, "macro_block_size": 2, "ffmpeg_log_level": "error"}
    # The new file gets its suffix at the end.
    options["output_params"] = ["-f", "mp4"]
    with replacing(path) as file:
        writer = imageio_ffmpeg.write_frames(file.name, (width, height), fps=rate, **options)
        writer.send(None)
        count = 0
        try:
            for picture in chain([first], pictures):
                writer.send(np.ascontiguousarray(picture))
                count += 1
        finally:
            writer.close()
        # ffmpeg's status is not told: a full disk at the end would be missed.
        try:
            whole = imageio_ffmpeg.count_frames_and_secs(file.name)[0] == count
        except RuntimeError:
            whole = False
        if not whole:
            raise OSError("ffmpeg could not write all pictures; is the disk full?")


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
    moving: dict[str, Any] = {"save_all": True, "append_images": images[1:], "duration": duration, "loop": 0}
    with replacing(path) as file:
        images[0].save(file, "gif", optimize=True, **moving)


def _write_png(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    """The last picture, by Pillow."""
    *_, last = pictures
    image = Image.fromarray(last)
    # A dithered palette is small and looks like full colour.
    palette = image.quantize(256, Image.Quantize.MAXCOVERAGE)
    with replacing(path) as file:
        image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(file, "png", optimize=True)
