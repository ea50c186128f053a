"""Clients of the server of `uvms play --web`: strangers, forged messages, curves and camera of a browser."""

import itertools
import os
import random
import socket
import time
import urllib.request
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pytest

viser = pytest.importorskip("viser")

import msgspec  # noqa: E402
import websockets  # noqa: E402
from helpers import free_port  # noqa: E402
from viewer_guest import CAMERA, Guest, present  # noqa: E402

from uvms_gym.controllers import registry  # noqa: E402
from uvms_gym.viewer.episode import MOST_SEED  # noqa: E402
from uvms_gym.viewer.page import REST, SPAN  # noqa: E402
from uvms_gym.viewer.server import Viewer  # noqa: E402


def test_a_page_of_another_origin_does_not_connect(viewer: Viewer) -> None:
    port = viewer.url.rpartition(":")[2]
    for origin in ("http://evil.example", "null", "", f"https://127.0.0.1:{port}", "http://127.0.0.1:1"):
        with pytest.raises(websockets.InvalidStatus, match="403"):
            Guest(viewer, origin)
    # A page of the other name, and one that a name of its own leads here (DNS rebinding).
    with pytest.raises(websockets.InvalidStatus, match="403"):
        Guest(viewer, f"http://localhost:{port}")
    for host in (f"evil.example:{port}", "evil.example", f"127.0.0.1.evil.example:{port}", "localhost.evil.example"):
        assert status(viewer, host, f"http://{host}", upgrade=True) == 403
        assert status(viewer, host) == 403
    assert status(viewer, "localhost:9000", "http://localhost:9000", upgrade=True) == 101
    assert status(viewer, f"127.0.0.1:{port}", upgrade=True) == 403
    assert status(viewer, f"127.0.0.1:{port}") == 200
    assert Guest(viewer).uuid("Seed")


def status(viewer: Viewer, host: str, origin: str | None = None, upgrade: bool = False) -> int:
    """Status of the answer to a request with these headers."""
    lines = ["GET / HTTP/1.1", f"Host: {host}"] + ([f"Origin: {origin}"] if origin else [])
    if upgrade:
        lines += ["Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"]
        lines += ["Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", f"Sec-WebSocket-Protocol: viser-v{viser.__version__}"]
    with socket.create_connection(("127.0.0.1", int(viewer.url.rpartition(":")[2]))) as raw:
        raw.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        return int(raw.recv(4096).split()[1])


def test_other_pages_cannot_frame_the_page(viewer: Viewer) -> None:
    with urllib.request.urlopen(viewer.url, timeout=5.0) as page:
        assert page.headers["Content-Security-Policy"] == "frame-ancestors 'none'"


def test_a_viser_that_would_pass_by_the_gate_is_refused(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = SimpleNamespace(serve=websockets.asyncio.server.serve, ServerConnection=websockets.ServerConnection)
    passing = SimpleNamespace(asyncio=SimpleNamespace(server=plain), exceptions=websockets.exceptions)
    monkeypatch.setattr("viser.infra._infra.websockets", passing)
    port = free_port()
    with pytest.raises(RuntimeError, match=r"install viser 1\.1"):
        Viewer(viewer.episode, "title", port)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port))


#: Values that no control takes, by label; the first types are wrong everywhere.
WRONG: tuple[tuple[str, Any], ...] = (
    *itertools.product(("Controller", "Setting", "Episode"), (None, 1, True, [], {}, "mlp:/dev/zero")),
    *itertools.product(("Strength", "Payload (kg)"), (None, "1", True, [1.0], {}, b"1")),
    *(("Current (m/s)", value) for value in (float("nan"), float("inf"), -float("inf"))),
    *(("Seed", value) for value in (None, -1, 1e20, ["3"], "1" * 100)),
    *(("Speed", value) for value in ("1000x", "", 1.0)),
    *(("Follow vehicle", value) for value in (None, 1, "true", [])),
)


def test_values_of_wrong_type_are_notices(guest: Guest, monkeypatch: pytest.MonkeyPatch) -> None:
    viewer = guest.viewer
    monkeypatch.setattr("uvms_gym.viewer.gate._PAUSE", 0.0)
    monkeypatch.setattr("uvms_gym.viewer.page._NOTICE", 0.0)
    before = state(viewer)
    for label, value in WRONG:
        guest.set(label, value)
        text = guest.refusal()
        assert text.startswith(f"Refused: {label} is "), text
        assert state(viewer) == before
    guest.set("Payload (kg)", 1)
    guest.until(lambda: viewer.episode.conditions.payload == 1.0)


def state(viewer: Viewer) -> Any:
    episode, controls = viewer.episode, [control.value for control in viewer.gate._controls.values()]
    target = tuple(episode.target[0]), tuple(episode.target[1])
    return episode.controller, episode.seed, episode.conditions, target, viewer.page.speed, controls


#: Values of the right type that are refused, by label, with the value that the control gets back.
OUTSIDE: tuple[tuple[str, Any, Any], ...] = (
    *(("Seed", text, "3") for text in ("-1", "1e20", "", "abc", "3.7", str(MOST_SEED + 1), "٣")),
    *(("Strength", value, 1.0) for value in (-1, 2.1, 1e20, 1e308, -1e-9)),
    *(("Current (m/s)", value, 0.2) for value in (-1.0, 1.01, 2**63)),
    *(("Payload (kg)", value, 0.0) for value in (-1, 5.1, 1e20)),
)


def test_values_out_of_range_are_notices_and_controls_keep_the_last(
    guest: Guest, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer = guest.viewer
    monkeypatch.setattr("uvms_gym.viewer.page._NOTICE", 0.0)
    # A text counts after a rest; here at once.
    monkeypatch.setattr("uvms_gym.viewer.page.time", SimpleNamespace(monotonic=lambda: time.monotonic() * 1e3))
    before = state(viewer)
    for label, value, kept in OUTSIDE:
        guest.set(label, value)
        text = guest.refusal()
        assert text.startswith(f"Refused: {label.split()[0].lower()} is "), text
        guest.until(lambda label=label, kept=kept: guest.value(label) == kept)
    assert state(viewer) == before
    assert viewer.episode.step()
    guest.set("Seed", str(MOST_SEED))
    guest.until(lambda: viewer.episode.seed == MOST_SEED)


def test_a_seed_counts_once_it_is_typed(guest: Guest) -> None:
    viewer, seeds = guest.viewer, []
    reset = viewer.episode.reset
    viewer.episode.reset = lambda seed, target: (seeds.append(seed), reset(seed, target))  # type: ignore[assignment,func-returns-value,misc]
    start = time.monotonic()
    for text in ("4", "", "-", "45"):
        guest.set("Seed", text)
    guest.until(lambda: viewer.episode.seed == 45)
    assert time.monotonic() - start >= REST
    assert (seeds, guest.notices()) == ([45], [])


def test_policies_come_only_from_the_command_line(guest: Guest, monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    made: list[str] = []
    monkeypatch.setattr(registry, "make_controller", lambda name, env: made.append(name))
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    texts = set()
    for file in ("/dev/zero", fifo, "/etc/passwd", "/nonexistent"):
        guest.viewer.page._said = ("", 0.0)
        monkeypatch.setattr("uvms_gym.viewer.gate._PAUSE", 0.0)
        guest.set("Controller", f"mlp:{file}")
        texts.add(guest.refusal().partition(", but ")[2])
    # No word of which files exist, and nothing is opened.
    assert len(texts) == 1 and made == []


TARGET = {"type": "TransformControlsUpdateMessage", "name": "/world/target", "wxyz": [1.0, 0.0, 0.0, 0.0], "owner": ""}
FORGED: tuple[Any, ...] = (
    "text",
    b"",
    b"\xc1",
    b"\x00" * 4000,
    [1, 2],
    {},
    {"type": "GuiUpdateMessage"},
    {"type": "GuiUpdateMessage", "uuid": "unknown", "updates": {"value": 1.0}},
    {"type": "ShareUrlRequest"},
    {"type": "FileTransferStartUpload", "source_component_uuid": "x", "transfer_uuid": "y", "filename": "z"},
    {"type": "RemoveSceneNodeMessage", "name": "/world/bodies/0"},
    {"type": "SetPositionMessage", "name": "/world/bodies/0", "position": [0.0, 0.0, 9.0]},
    {**CAMERA, "extra": 1.0},
    *({**CAMERA, name: value} for name in CAMERA for value in (None, "1", float("nan"), 1e300, [1e300] * 3, [])),
    {**TARGET, "position": [0.0, 0.0]},
    {**TARGET, "position": [float("nan"), 0.0, 0.0]},
    {**TARGET, "position": [1e20, 0.0, 0.0]},
    {**TARGET, "position": ["0", 0.0, 0.0]},
    {**TARGET, "position": [0.0, 0.0, 0.0], "name": "/world/bodies/0"},
    {**TARGET, "position": [0.0, 0.0, 0.0], "owner": "1"},
)


def test_forged_messages_change_nothing_and_end_nothing(
    guest: Guest, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    viewer = guest.viewer
    monkeypatch.setattr("uvms_gym.viewer.gate._PAUSE", 0.0)
    monkeypatch.setattr("uvms_gym.viewer.page._NOTICE", 0.0)
    refused: list[str] = []
    viewer.gate.refused = refused.append
    before = state(viewer)
    fields = [{"label": "x"}, {"value": 1.0, "label": "x"}, {"visible": False}, {"update_cb": []}, {"sync_cb": 1}, {}]
    messages = [*FORGED, *({"type": "GuiUpdateMessage", "uuid": guest.uuid("Strength"), "updates": x} for x in fields)]
    for message in messages:
        guest.send(message)
    guest.until(lambda: len(refused) >= len(messages))
    assert len(refused) == len(messages)
    assert all("\n" not in text for text in refused)
    assert state(viewer) == before
    # The connection still serves, and nothing was logged.
    guest.set("Payload (kg)", 1.0)
    guest.until(lambda: viewer.episode.conditions.payload == 1.0)
    assert "Traceback" not in capsys.readouterr().err + caplog.text


def test_a_message_that_is_too_long_ends_only_its_connection(guest: Guest) -> None:
    other = Guest(guest.viewer)
    other.uuid("Seed")
    with pytest.raises(websockets.ConnectionClosed, match="1009"):
        other.send(b"\x00" * 2**20)
        while True:
            other.socket.recv(timeout=5.0)
    guest.set("Payload (kg)", 1.0)
    guest.until(lambda: guest.viewer.episode.conditions.payload == 1.0)


def test_random_messages_end_nothing(guest: Guest) -> None:
    viewer, rng = guest.viewer, random.Random(1)
    before = viewer.episode.controller
    good = [msgspec.msgpack.encode(CAMERA), msgspec.msgpack.encode({**TARGET, "position": [0.1, 0.0, 0.0]})]
    good += [
        msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": guest.uuid(label), "updates": {"value": value}})
        for label, value in (("Strength", 0.5), ("Seed", "12"), ("Controller", "pid"))
    ]
    for _ in range(int(os.environ.get("UVMS_FUZZ", "300"))):
        raw = bytearray(rng.choice(good))
        for _ in range(rng.randint(1, 4)):
            raw[rng.randrange(len(raw))] = rng.randrange(256)
        guest.send(bytes(raw))
    guest.set("Payload (kg)", 1.0)
    guest.until(lambda: viewer.episode.conditions.payload == 1.0)
    assert viewer.episode.controller in (before, "pid")
    assert np.isfinite(viewer.episode.after["poses"]).all()


def test_any_error_is_a_notice(guest: Guest) -> None:
    viewer = guest.viewer

    class Panic(BaseException):
        pass

    with mock.patch.object(viewer.episode, "choose", side_effect=ZeroDivisionError("of the\ncontroller")):
        guest.set("Controller", "pid")
        assert guest.refusal() == "Refused: of the controller"
        guest.until(lambda: guest.value("Controller") == "pd")
    for error in (RuntimeError("of the step"), Panic("of the step")):
        with mock.patch.object(viewer.episode, "step", side_effect=error):
            viewer.page._said = ("", 0.0)
            viewer.picture(0.2)
            assert guest.refusal() == "Stopped: of the step"
            assert not viewer.page.running
        guest.set("Episode", "Run")
        guest.until(lambda: viewer.page.running)
        viewer.picture(0.2)
        assert viewer.episode.time > 0.0
    with mock.patch.object(viewer.episode, "step", side_effect=KeyboardInterrupt), pytest.raises(KeyboardInterrupt):
        viewer.picture(0.2)


def test_fifty_browsers_share_an_episode(viewer: Viewer) -> None:
    guests = [Guest(viewer) for _ in range(50)]
    guests[0].until(lambda: len(viewer.server.get_clients()) == 50, 20.0)
    start = viewer.episode.time
    for _ in range(10):
        viewer.picture(1.0 / 30.0)
    assert viewer.episode.time > start
    guests[-1].set("Payload (kg)", 9.0)
    for guest in guests:
        guest.until(lambda guest=guest: guest.notices() and guest.value("Payload (kg)") == 0.0)
        assert guest.notices() == ["Refused: payload is 9, but must be 0 to 5"]
        guest.socket.close()


# Curves and camera


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
