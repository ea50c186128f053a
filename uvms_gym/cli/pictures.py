"""Size, rate and camera of the pictures of `uvms play`."""

import math
from typing import Any, NamedTuple

from uvms_gym.cli.common import check_range, fail

#: Default sizes and rates, 1/s, of videos and of animations, and bounds.
SIZE, GIF_SIZE = "960x720", "640x480"
RATE, GIF_RATE = 30.0, 20.0
MIN_SIZE, MOST_SIZE, MOST_RATE = "160x120", "3840x2160", 60.0


class Settings(NamedTuple):
    """Width and height, pixels; pictures per second; and arguments of the renderer."""

    size: tuple[int, int]
    rate: float
    camera: dict[str, Any]


class Frame(NamedTuple):
    """Texts of a film, its duration, s, and the settings of its pictures."""

    title: str
    disturbance: str
    seconds: float
    settings: Settings


def read_settings(size: str | None, fps: float | None, camera: str | None, suffix: str) -> Settings:
    """Read the options, with the defaults of a file of this suffix."""
    animated = suffix == ".gif"
    rate = fps if fps is not None else GIF_RATE if animated else RATE
    check_range("--fps", rate, 1.0, MOST_RATE)
    if animated:
        # Delays of animations are whole hundredths of a second.
        rate = 100.0 / max(2, round(100.0 / rate))
    return Settings(_size(size or (GIF_SIZE if animated else SIZE)), rate, _camera(camera))


def _size(text: str) -> tuple[int, int]:
    minimum, most = (tuple(map(int, bound.split("x"))) for bound in (MIN_SIZE, MOST_SIZE))
    try:
        width, height = map(int, text.split("x"))
    except ValueError:
        raise fail(f"--size is {text!r}, but must be WIDTHxHEIGHT, such as {SIZE}") from None
    if not (minimum[0] <= width <= most[0] and minimum[1] <= height <= most[1]) or width % 2 or height % 2:
        raise fail(f"--size is {text!r}, but must be even numbers, {MIN_SIZE} to {MOST_SIZE}")
    return width, height


def _camera(text: str | None) -> dict[str, Any]:
    if text is None:
        return {}
    try:
        azimuth, elevation, *rest = map(float, text.split(","))
        (distance,) = rest or (None,)
    except ValueError:
        raise fail(f"--camera is {text!r}, but must be AZIMUTH,ELEVATION or AZIMUTH,ELEVATION,DISTANCE") from None
    check_range("azimuth of --camera", azimuth, -360.0, 360.0)
    check_range("elevation of --camera", elevation, -85.0, 85.0)
    if distance is not None:
        check_range("distance of --camera", distance, 0.1, 1000.0)
    return {"azimuth": math.radians(azimuth), "elevation": math.radians(elevation), "distance": distance}
