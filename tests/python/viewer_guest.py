"""Client of `uvms play --web` that speaks the page's protocol, for tests."""

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import msgspec
import numpy as np
import viser
import zstandard
from helpers import free_port
from websockets.sync.client import connect

from uvms_gym.viewer.episode import LiveEpisode
from uvms_gym.viewer.server import Viewer

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [3.0, 0.0, 0.0],
    "fov": 1.3,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 800,
    "image_width": 1280,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


class Guest:
    """Client that speaks the page's protocol.

    Attributes
    ----------
    seen : list of dict
        Messages received so far.
    """

    def __init__(self, viewer: Viewer, origin: str | None = None, camera: dict[str, Any] = CAMERA) -> None:
        self.viewer = viewer
        self.socket = connect(
            viewer.url.replace("http", "ws"),
            origin=viewer.url if origin is None else origin,  # type: ignore[arg-type]
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            compression=None,
            max_size=None,
            proxy=None,
        )
        self.seen: list[dict[str, Any]] = []
        self.send(camera)

    def send(self, message: Any) -> None:
        self.socket.send(message if isinstance(message, str | bytes) else msgspec.msgpack.encode(message))

    def until(self, done: Callable[[], Any], seconds: float = 10.0) -> Any:
        """Read, with pictures, until something is true."""
        end = time.monotonic() + seconds
        while not (value := done()):
            assert time.monotonic() < end, "not in time"
            self.viewer.picture(0.0)
            self.read()
        return value

    def read(self) -> None:
        """Take in what has come."""
        try:
            while True:
                raw = self.socket.recv(timeout=0.01)
                size = int.from_bytes(raw[8:16], "little")
                inner = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size]))
                arrays, at = [], 16 + size
                for length in inner["binaryBufferLengths"]:
                    at += -at % 8
                    arrays.append(raw[at : at + length])
                    at += length
                for message in inner["messages"]:
                    # Arrays of charts.
                    for part in (message.get("props"), message.get("updates")):
                        if isinstance(part, dict) and isinstance(part.get("data"), list):
                            part["data"] = [
                                np.frombuffer(arrays[x["__binary_index"]], x["dtype"]) for x in part["data"]
                            ]
                self.seen += inner["messages"]
        except TimeoutError:
            pass

    def uuid(self, label: str) -> str:
        """Identifier of the control with this label."""
        found = lambda: [m["uuid"] for m in self.seen if m.get("props", {}).get("label") == label]  # noqa: E731
        return str(self.until(found)[0])

    def set(self, label: str, value: Any) -> None:
        self.send({"type": "GuiUpdateMessage", "uuid": self.uuid(label), "updates": {"value": value}})

    def value(self, label: str) -> Any:
        """Last value that the server sent for a control, if it sent one."""
        uuid = self.uuid(label)
        values = [m["updates"]["value"] for m in self.seen if m.get("uuid") == uuid and "value" in m.get("updates", {})]
        return values[-1] if values else None

    def notices(self) -> list[str]:
        return [f"{m['props']['title']}: {m['props']['body']}" for m in self.seen if "NotificationShow" in m["type"]]

    def refusal(self) -> str:
        """Text of the next notice."""
        before = len(self.notices())
        return str(self.until(lambda: self.notices()[before:])[0])


@contextlib.contextmanager
def open_viewer() -> Iterator[Viewer]:
    """Server of an episode in the storm."""
    env = gymnasium.make("UVMS-StationKeep-Storm-v0", threads=1, disable_env_checker=True)
    shown = Viewer(LiveEpisode(env.unwrapped, "pd", 3), "title", free_port())  # type: ignore[arg-type]
    try:
        yield shown
    finally:
        shown.close()


def present(viewer: Viewer, **camera: Any) -> Guest:
    """Guest that the server knows, with another camera than the usual one."""
    before = len(viewer.server.get_clients())
    guest = Guest(viewer, camera={**CAMERA, **camera})
    guest.until(lambda: len(viewer.server.get_clients()) > before)
    return guest
