"""Headless Chromium over its DevTools protocol, for tests of pages."""

import base64
import contextlib
import itertools
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

#: Options of every start: no sandbox as root, WebGL in software.
_OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",
)


def chromium() -> str | None:
    """Path of an installed Chromium."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Session:
    """Connection to a browser, or to a page of it.

    Attributes
    ----------
    errors : list of str
        Exceptions that the page's scripts did not catch.
    """

    def __init__(self, address: str) -> None:
        self._socket = connect(address, max_size=None, compression=None, proxy=None)
        self._ids = itertools.count()
        self.errors: list[str] = []

    def call(self, method: str, **parameters: Any) -> Any:
        """Result of a command."""
        number = next(self._ids)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            reply = json.loads(self._socket.recv(timeout=240.0))
            if reply.get("method") == "Runtime.exceptionThrown":
                details = reply["params"]["exceptionDetails"]
                self.errors.append(details.get("exception", {}).get("description", details["text"]))
            if reply.get("id") == number:
                assert "error" not in reply, f"{method}: {reply['error']}"
                return reply["result"]


class Tab(Session):
    """One page of a browser."""

    def __init__(self, address: str) -> None:
        super().__init__(address)
        for domain in ("Page", "Runtime"):
            self.call(f"{domain}.enable")

    def run(self, script: str) -> Any:
        """Value of an expression in the page."""
        reply = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in reply, reply["exceptionDetails"]
        return reply["result"].get("value")

    def wait(self, script: str, seconds: float = 240.0) -> Any:
        """Value of an expression once it is true."""
        until = time.monotonic() + seconds
        while not (value := self.run(script)):
            assert time.monotonic() < until, f"not within {seconds:g} s: {script}; the page shows\n{self.text()}"
            time.sleep(0.05)
        return value

    def shows(self, text: str) -> None:
        """Wait until the page shows a text."""
        self.wait(f"document.body?.innerText.includes({json.dumps(text)})")

    def text(self) -> str:
        """Text that the page shows."""
        return str(self.run("document.body.innerText"))

    def open(self, address: str, width: int = 1280, height: int = 800, scale: float = 1.0) -> None:
        """Go to an address, in a window of this size, px, with `scale` pixels each way per px."""
        size = {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        self.call("Page.navigate", url=address)

    def click(self, script: str) -> None:
        """Press the mouse in the middle of the element that an expression names."""
        x, y = self.wait(
            f"(() => {{ const e = {script}; if (!e) return null; e.scrollIntoView({{block: 'center'}});"
            " const r = e.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def fill(self, script: str, text: str) -> None:
        """Replace the text of the input that an expression names, key by key."""
        self.click(script)
        self.run(f"{script}.select()")
        self.key("Backspace")
        for character in text:
            self.call("Input.dispatchKeyEvent", type="char", text=character)

    def key(self, name: str) -> None:
        """Press a key by its name."""
        code = {"Backspace": 8, "Tab": 9, "Enter": 13}[name]
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=name, code=name, windowsVirtualKeyCode=code)

    def picture(self, file: Path) -> None:
        """Write the page as PNG."""
        file.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))


class Browser:
    """Running Chromium with a profile of its own."""

    def __init__(self, folder: Path) -> None:
        program = chromium()
        assert program is not None
        with (folder / "chromium.log").open("wb") as log:
            self.process = subprocess.Popen(
                [program, *_OPTIONS, f"--user-data-dir={folder}", "about:blank"], stdout=log, stderr=log
            )
        file, until = folder / "DevToolsActivePort", time.monotonic() + 60.0
        while not (file.exists() and file.read_text().count("\n")):
            assert self.process.poll() is None and time.monotonic() < until, (folder / "chromium.log").read_text()
            time.sleep(0.05)
        port, path = file.read_text().split()
        self._host = f"ws://127.0.0.1:{port}"
        self._main = Session(self._host + path)
        self._targets: list[str] = []

    def tab(self) -> Tab:
        """Another page, with cookies and storage of its own."""
        context = self._main.call("Target.createBrowserContext")["browserContextId"]
        target = self._main.call("Target.createTarget", url="about:blank", browserContextId=context)["targetId"]
        self._targets.append(target)
        return Tab(f"{self._host}/devtools/page/{target}")

    def close_tabs(self) -> None:
        """Close all pages that `tab` made."""
        while self._targets:
            self._main.call("Target.closeTarget", targetId=self._targets.pop())

    def close(self) -> None:
        """End the browser."""
        self.process.terminate()
        self.process.wait(timeout=30.0)


@contextlib.contextmanager
def browser(folder: Path) -> Iterator[Browser]:
    """Chromium while the context lasts."""
    running = Browser(folder)
    try:
        yield running
    finally:
        running.close()
