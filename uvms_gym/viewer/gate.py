"""Gate of the page's server: who may connect, and which messages a browser may send."""

import http
import inspect
import math
import time
from collections.abc import Callable
from typing import Annotated, Any, Literal

import msgspec
import viser
import websockets.asyncio.server as sockets

#: Names of this machine in the address of a page. The port is free: it may be forwarded.
_NAMES = ("127.0.0.1", "localhost")
#: Bytes of the longest message, and characters of the longest text.
_LONGEST_MESSAGE, _LONGEST_TEXT = 4096, 32
#: Minimum time between two notices of refused messages, s.
_PAUSE = 1.0

_Number = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
_Pixels = Annotated[int, msgspec.Meta(ge=1, le=100_000)]
_Vector = tuple[_Number, _Number, _Number]
_Quaternion = tuple[_Number, _Number, _Number, _Number]


class _Message(msgspec.Struct, tag_field="type", forbid_unknown_fields=True):
    """Message of a browser; the fields are viser's."""


class _Camera(_Message, tag="ViewerCameraMessage"):
    wxyz: _Quaternion
    position: _Vector
    fov: _Number
    near: _Number
    far: _Number
    image_height: _Pixels
    image_width: _Pixels
    look_at: _Vector
    up_direction: _Vector


class _Value(_Message, tag="GuiUpdateMessage"):
    uuid: str
    updates: dict[Literal["value"], Any]


class _Handles(_Message, tag="TransformControlsUpdateMessage"):
    name: str
    wxyz: _Quaternion
    position: _Vector
    owner: str = ""


class _HandlesTaken(_Message, tag="TransformControlsDragStartMessage"):
    name: str
    owner: str = ""


class _HandlesReleased(_Message, tag="TransformControlsDragEndMessage"):
    name: str
    owner: str = ""


_DECODER = msgspec.msgpack.Decoder(_Camera | _Value | _Handles | _HandlesTaken | _HandlesReleased)


class Gate:
    """Checks of connections and messages, before viser sees them.

    Only a page of this machine, in its own name, connects: a foreign page would give its own origin, a foreign name
    that leads here its own host. Of messages those pass that the controls can send, with values of their types and
    options; ranges are checked by the episode, whose refusal gives the control its last value back.

    `refused` is called with a line, at most once a second, when a message is refused; `handles` is the name of the
    target's handles, which may be dragged.
    """

    def __init__(self) -> None:
        self.refused: Callable[[str], None] = lambda reason: None
        self._controls: dict[str, Any] = {}
        self.handles = ""
        self._last_notice = -math.inf

    def admit(self, control: Any) -> None:
        """Admit the values of a control."""
        self._controls[control._impl.uuid] = control

    def serve(self, host: str, port: int, kind: type[viser.ViserServer]) -> viser.ViserServer:
        """Start a viser server of this kind behind the gate.

        viser has no hook for this, so it is given another `serve` while it starts.
        """
        calls: list[Any] = []

        def serve(handler: Any, *arguments: Any, process_request: Any, **options: Any) -> Any:
            calls.append(handler)
            options |= {"create_connection": self._connection(), "max_size": _LONGEST_MESSAGE, "close_timeout": 0.5}
            return plain(handler, *arguments, process_request=self._request(process_request), **options)

        plain = sockets.serve
        sockets.serve = serve  # type: ignore[assignment,misc]
        try:
            server = kind(host=host, port=port, verbose=False)
        finally:
            sockets.serve = plain  # type: ignore[misc]
        if not calls:
            server.stop()
            raise RuntimeError(f"viser {viser.__version__} starts a server that cannot be checked; install viser 1.1")
        return server

    def _request(self, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """Answer of requests that refuses strangers, and frames of other pages."""

        async def checked(connection: Any, request: Any) -> Any:
            if reason := _stranger(request.headers):
                return connection.respond(http.HTTPStatus.FORBIDDEN, f"{reason}\n")
            response = answer(connection, request)
            response = await response if inspect.isawaitable(response) else response
            if response is not None:
                response.headers["Content-Security-Policy"] = "frame-ancestors 'none'"
            return response

        return checked

    def _connection(self) -> type[sockets.ServerConnection]:
        """Connection that passes on what the gate admits."""
        gate = self

        class Connection(sockets.ServerConnection):  # type: ignore[misc,unused-ignore]
            async def recv(self, decode: bool | None = None) -> Any:
                while True:
                    message = await super().recv(decode)
                    if gate._admits(message):
                        return message

        return Connection

    def _admits(self, message: Any) -> bool:
        try:
            self._check(_DECODER.decode(message))
        except Exception as error:
            if (now := time.monotonic()) - self._last_notice >= _PAUSE:
                self._last_notice = now
                self.refused(" ".join(str(error).split())[:200])
            return False
        return True

    def _check(self, message: _Message) -> None:
        if isinstance(message, _Value):
            control = self._controls.get(message.uuid)
            if control is None:
                raise ValueError("there is no such control")
            _check_value(control, message.updates.get("value"))
        elif not isinstance(message, _Camera) and (message.name, message.owner) != (self.handles, ""):  # type: ignore[attr-defined]
            raise ValueError("there are no such handles")


def _check_value(control: Any, value: Any) -> None:
    """Refuse a value of another type than the control's, and one that is not among its options."""
    options = getattr(control, "options", None)
    shown = repr(value)[:_LONGEST_TEXT]
    if options is not None:
        if not (isinstance(value, str) and value in options):
            raise ValueError(f"{control.label} is {shown}, but must be one of its options")
    elif isinstance(control.value, bool):
        if not isinstance(value, bool):
            raise ValueError(f"{control.label} is {shown}, but must be true or false")
    elif isinstance(control.value, str):
        if not isinstance(value, str) or len(value) > _LONGEST_TEXT:
            raise ValueError(f"{control.label} is {shown}, but must be at most {_LONGEST_TEXT} characters")
    elif isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{control.label} is {shown}, but must be a finite number")


def _stranger(headers: Any) -> str | None:
    """Reason to refuse a request; None for a page of this machine."""
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    name = hosts[0].rpartition(":")[0] or hosts[0] if len(hosts) == 1 else ""
    if name not in _NAMES:
        return f"this page is served to http://{' and http://'.join(_NAMES)} only"
    # Browsers send the origin with every websocket.
    if (origins or "Upgrade" in headers) and origins != [f"http://{hosts[0]}"]:
        return "this page accepts no connections from other pages"
    return None
