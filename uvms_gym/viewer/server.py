"""Server of the page, on the loopback address only, and the loop that steps the episode for it."""

import contextlib
import io
import socket
import time
from collections.abc import Callable
from functools import partial

import viser

from uvms_gym.viewer.episode import LiveEpisode
from uvms_gym.viewer.gate import Gate
from uvms_gym.viewer.page import Page
from uvms_gym.viewer.world import World

HOST = "127.0.0.1"
#: Pictures per second, and curves per second.
PICTURES, CURVES = 30.0, 5.0
#: Longest time between two pictures that the episode makes up for, s.
_LONGEST = 0.2


class _LocalServer(viser.ViserServer):  # type: ignore[misc,unused-ignore]
    """Server that refuses the tunnel to a public address, which any browser could ask for."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Do nothing."""


class Viewer:
    """Browser view of one episode.

    `title` is the first line of the page, `port` from 1 to 65535; `say` is called with a line when a browser connects
    or leaves.
    """

    def __init__(
        self, episode: LiveEpisode, title: str, port: int, say: Callable[[str], None] = lambda _: None
    ) -> None:
        # viser would go on to the next free port.
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((HOST, port))
        self.gate = Gate()
        # Without viser's own lines.
        with contextlib.redirect_stdout(io.StringIO()):
            self.server = self.gate.serve(HOST, port, _LocalServer)
        if (bound := self.server.get_port()) != port:
            self.close()
            raise OSError(f"port {port} is taken; {bound} would be free")
        self.episode = episode
        self.world = World(self.server, episode.env.snapshot(), episode.target, episode.env.task == "dock")
        self.page = Page(self.server, self.gate, episode, self.world, title)
        self.server.on_client_connect(self.page.home)
        self.server.on_client_connect(lambda _: say("browser connected"))
        self.server.on_client_disconnect(lambda _: say("browser closed"))
        self._shown = episode.time
        self._interval, self._next_curves = 1.0 / PICTURES, 0.0
        self.world.show(episode.before, episode.after, 1.0)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.server.get_port()}"

    def picture(self, elapsed: float) -> None:
        """Run the page's commands, go on by the time since the last picture, s, and send a picture.

        An error is a notice in the page, which pauses.
        """
        page = self.page
        page.run_commands()
        page.attempt(partial(self._go_on, elapsed), "Stopped", page.pause)
        page.attempt(partial(self._send, elapsed), "Stopped", page.pause)

    def _go_on(self, elapsed: float) -> None:
        page, episode = self.page, self.episode
        # A reset begins at time 0.
        self._shown = min(self._shown, episode.time)
        if page.stepped:
            page.stepped = False
            self._step()
            self._shown = episode.time
        elif page.running:
            self._shown += page.speed * min(elapsed, _LONGEST)
            while episode.time < self._shown:
                if not self._step():
                    self._shown = episode.time

    def _send(self, elapsed: float) -> None:
        page, episode = self.page, self.episode
        share = 1.0 - (episode.time - self._shown) / episode.period
        with self.server.atomic():
            self.world.show(episode.before, episode.after, min(max(share, 0.0), 1.0))
            if elapsed > 0.0:
                self._interval += 0.1 * (elapsed - self._interval)
            if (now := time.monotonic()) >= self._next_curves:
                self._next_curves = now + 1.0 / CURVES
                page.draw_curves(1.0 / self._interval)

    def run(self) -> None:
        """Send pictures until interrupted; without a browser the episode waits."""
        last = due = time.monotonic()
        while True:
            now = time.monotonic()
            if self.server.get_clients():
                self.picture(now - last)
            last = now
            due = max(due + 1.0 / PICTURES, now)
            time.sleep(max(0.0, due - time.monotonic()))

    def close(self) -> None:
        """Stop the server."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

    def _step(self) -> bool:
        """One control period; False where the run diverged and began anew."""
        went_on = self.episode.step()
        if not went_on:
            self.page.say("Diverged", "The run left the task's bounds; the episode began anew.")
            self.page.clear()
        self.page.note()
        return went_on
