"""Films: pictures of an episode at a rate of their own, and files of them (.mp4, .gif, .png)."""

from collections.abc import Iterable, Iterator
from itertools import chain, islice, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from uvms_gym import Renderer
from uvms_gym._files import replacing
from uvms_gym.cli.episode_plot import Instant
from uvms_gym.cli.overlay import COLOURS, Overlay
from uvms_gym.cli.pictures import Frame
from uvms_gym.envs.rendering import Shot, between, mix, shots
from uvms_gym.viewer.curves import error_curves

Picture = NDArray[np.uint8]
#: Colours of an animation besides `COLOURS`; more make files larger without a visible difference.
_PICTURE_COLOURS = 112


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
    if last:
        overlay.note(instant.time, instant.info)
    for later in moments:
        if last:
            overlay.note(later.time, later.info)
        else:
            following = _shot(env)
            while (time := count / frame.settings.rate) < later.time - 1e-9:
                share = (time - instant.time) / (later.time - instant.time)
                names = [*(curve.entry for curve in curves), *(f"current_{axis}" for axis in "xyz")]
                overlay.note(time, {name: mix(instant.info[name], later.info[name], share) for name in names})
                yield draw(between(shot, following, share))
                count += 1
            shot = following
        instant = later
    if not last:
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
    moving: dict[str, Any] = {
        "save_all": True,
        "append_images": images[1:],
        "duration": round(1000.0 / rate),
        "loop": 0,
    }
    with replacing(path) as file:
        images[0].save(file, "gif", optimize=False, **moving)


def _palette(picture: Picture) -> Image.Image:
    """Palette of the texts' and curves' colours as they are, a coarse cube of all colours, and a picture's."""
    kept = [*chain.from_iterable(chain(COLOURS, product((0, 128, 255), repeat=3)))]
    # By an octree: other methods lose shadows, or what is small.
    found = Image.fromarray(picture).quantize(_PICTURE_COLOURS, Image.Quantize.FASTOCTREE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*kept, *found[: 3 * _PICTURE_COLOURS]])
    return palette
