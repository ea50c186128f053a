"""Curves and camera of the page of `uvms play --web`."""

from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser")

from viewer_guest import Guest, present

from uvms_gym.viewer.page import SPAN


def test_a_later_browser_has_all_of_the_curves(guest: Guest) -> None:
    viewer = guest.viewer
    for _ in range(40):
        viewer.picture(0.1)
    guest.socket.close()
    later = Guest(viewer)
    for steps in (0, 5):
        for _ in range(steps):
            viewer.picture(0.1)
        viewer.page.draw_curves(30.0)
        now = viewer.episode.time
        for title, count in (("Errors", 3), ("Thrust (N)", 6)):
            chart = later.until(
                lambda title=title: [m for m in later.seen if m.get("props", {}).get("title") == title]
            )[0]
            # Time runs to the present over a constant axis: viser's charts lose others in browsers that come later.
            assert chart["props"]["scales"]["x"]["range"] == [-SPAN, 0.0]
            later.until(lambda chart=chart, now=now: curves(later, chart)[0][0] == -now)
            times, *values = curves(later, chart)
            np.testing.assert_allclose(np.diff(times), viewer.episode.period)
            assert (times[-1], len(values)) == (0.0, count)


def curves(guest: Guest, chart: dict[str, Any]) -> list[Any]:
    """Last data of a chart."""
    updates = [
        m["updates"]["data"] for m in guest.seen if m.get("uuid") == chart["uuid"] and "data" in m.get("updates", {})
    ]
    return list((updates or [chart["props"]["data"]])[-1])


def test_a_lost_vehicle_is_followed_and_found(guest: Guest) -> None:
    viewer = guest.viewer
    world, episode = viewer.world, viewer.episode
    far = np.array([4.0, -3.0, 1.0])
    episode.after["poses"][:, :3, 3] += far
    episode.before = episode.after
    place = episode.after["poses"][0, :3, 3]
    camera = next(iter(viewer.server.get_clients().values())).camera
    viewer.picture(0.0)
    start = camera.look_at
    guest.set("View", "Home")
    guest.until(lambda: np.linalg.norm(camera.look_at - start) > 4.0)
    assert np.linalg.norm(camera.look_at - place) < 1.5
    sent = lambda: [m["look_at"] for m in guest.seen if m["type"] == "SetCameraLookAtMessage"][-1]  # noqa: E731
    guest.until(lambda: sent() == list(camera.look_at))
    assert not world._world.position.any()
    guest.set("Follow vehicle", True)
    guest.until(lambda: np.allclose(world._world.position, -place, atol=1e-6))
    assert np.linalg.norm(camera.look_at) < 1.5
    guest.set("Follow vehicle", False)
    guest.until(lambda: not world._world.position.any())
    assert np.linalg.norm(camera.look_at - place) < 1.5
    guest.set("Target handles", False)
    guest.until(lambda: not world.gizmo.visible)


def test_a_narrow_window_shows_the_vehicle_above_the_controls(viewer: Any) -> None:
    windows = ((1280, 800, (0.3, 0.6), (0.35, 0.6)), (390, 844, (0.4, 0.6), (0.1, 0.3)))
    for width, height, columns, rows in windows:
        guest = present(viewer, image_width=width, image_height=height)
        camera = max(viewer.server.get_clients().items())[1].camera
        guest.until(lambda camera=camera: camera.look_at.any())
        x, y = seen_at(camera, viewer.episode.after["poses"][0, :3, 3])
        assert columns[0] < x < columns[1]
        assert rows[0] < y < rows[1]


def seen_at(camera: Any, point: Any) -> tuple[float, float]:
    """Place of a point in the picture, from the upper left, in widths and heights."""
    eye = camera.position
    ahead = (camera.look_at - eye) / np.linalg.norm(camera.look_at - eye)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    scale = 2.0 * np.tan(0.5 * camera.fov) * ((point - eye) @ ahead)
    aspect = camera.image_width / camera.image_height
    return 0.5 + (point - eye) @ right / (scale * aspect), 0.5 - (point - eye) @ np.cross(right, ahead) / scale
