"""Page of `uvms play --web` in headless Chromium, driven over its DevTools protocol."""

import base64
import contextlib
import http.server
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("viser")

import viser
from helpers import free_port
from websockets.sync.client import connect


def chromium() -> str | None:
    """Path of an installed Chromium."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(chromium() is None, reason="there is no chromium (apt-get install chromium)"),
]

#: Options of every start: no sandbox as root, WebGL in software.
OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",
)
#: The control after a label, by kind of element.
CONTROL = """(() => {{
  const labels = [...document.querySelectorAll("label")].filter(e => e.innerText.trim() === {label!r});
  let box = labels[0];
  while (box && !box.querySelector({kind!r})) box = box.parentElement;
  return box && [...box.querySelectorAll({kind!r})].at(-1);
}})()"""
#: Time between two changes, s: of those within 50 ms the page sends the last alone.
PAUSE = 1.0
#: Times and number of points of the curves.
CURVES = """Object.values(window.__viserTestpoints?.uplots ?? {}).map(u => [
  u.chart.scales.x.min, u.chart.scales.x.max, u.chart.data[0][0], u.chart.data[0].at(-1), u.chart.data[0].length])"""


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
                [program, *OPTIONS, f"--user-data-dir={folder}", "about:blank"], stdout=log, stderr=log
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
def served(*arguments: str) -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    """Address and process of a running `uvms play --web`."""
    port = free_port()
    command = [sys.executable, "-P", "-m", "uvms_gym", "play", "--web", "--port", str(port), *arguments]
    running = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        assert running.stdout is not None
        assert running.stdout.readline().startswith(f"http://127.0.0.1:{port} ")
        yield f"http://127.0.0.1:{port}", running
        assert running.poll() is None, running.communicate()[0]
        running.send_signal(signal.SIGINT)
        rest = running.communicate(timeout=30.0)[0]
        assert running.returncode == 0 and "ended\n" in rest and "Traceback" not in rest, rest
    finally:
        running.kill()
        running.wait()


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    started = Browser(tmp_path_factory.mktemp("chromium"))
    yield started
    started.close()


@pytest.fixture
def chrome(running: Browser) -> Iterator[Browser]:
    yield running
    running.close_tabs()


def visit(chrome: Browser, address: str, width: int = 900, height: int = 600, scale: float = 0.2) -> Tab:
    """Page with the first curves; coarse, as pixels are drawn in software."""
    tab = chrome.tab()
    tab.open(address, width, height, scale)
    tab.shows("pictures/s")
    return tab


def box(label: str, kind: str = "input") -> str:
    return CONTROL.format(label=label, kind=kind)


def value(tab: Tab, label: str) -> Any:
    return tab.run(f"{box(label)}.value")


def press(tab: Tab, name: str) -> None:
    tab.click(f"[...document.querySelectorAll('button')].find(e => e.innerText.trim() === {name!r})")
    time.sleep(PAUSE)


def test_start_and_controls(chrome: Browser) -> None:
    with served() as (address, _):
        tab = visit(chrome, address)
        assert [value(tab, label) for label in ("Controller", "Speed", "Seed", "Strength")] == ["pd", "1x", "0", "1"]
        press(tab, "Pause")
        tab.shows("paused")
        press(tab, "Reset")
        tab.shows("paused, 0.0 s")
        press(tab, "Step")
        tab.shows("paused, 0.1 s")
        tab.fill(box("Payload (kg)"), "2.5")
        time.sleep(PAUSE)
        tab.fill(box("Seed"), "12")
        tab.shows("paused, 0.0 s")
        press(tab, "Run")
        tab.shows("running")
        tab.click(box("Follow vehicle"))
        time.sleep(PAUSE)
        press(tab, "Home")
        # No message of an honest page is refused.
        assert "Refused" not in tab.text()
        # Two pages at once are more than drawing in software does.
        tab.call("Page.setWebLifecycleState", state="frozen")
        other = visit(chrome, address)
        assert [value(other, label) for label in ("Seed", "Payload (kg)")] == ["12", "2.5"]
        assert other.run(f"{box('Follow vehicle')}.checked")
        assert tab.errors == other.errors == []
        assert "Refused" not in other.text()
        # A frozen page would hold the server's end up.
        chrome.close_tabs()


def test_curves_survive_a_reload_and_reach_a_second_browser(chrome: Browser) -> None:
    with served("--controller", "pid") as (address, _):
        tab = visit(chrome, address)
        tab.wait(f"{CURVES}[0]?.[4] > 60")
        tab.call("Page.reload")
        tab.shows("pictures/s")
        for again in (False, True):
            if again:
                chrome.close_tabs()
            shown = visit(chrome, address) if again else tab
            shown.wait(f"{CURVES}.length === 2 && {CURVES}[0][4] > 60")
            count = shown.run(CURVES)[0][4]
            # It goes on, and the axis with it.
            shown.wait(f"{CURVES}[0][4] > {count + 20}")
            for low, high, first, last, _ in shown.run(CURVES):
                assert (low, high, last) == (-30.0, 0.0, 0.0)
                assert -30.0 <= first < -6.0
            assert shown.errors == []


def test_bad_values_are_notices_and_boxes_keep_the_last(chrome: Browser, shared: str) -> None:
    tab = visit(chrome, shared)
    for text in ("-1", "1e20", "100000000000000000000", "", "abc", "3.7"):
        paste(tab, "Seed", text)
        tab.shows(f"seed is {text!r}, but must be a whole number")
        tab.wait(f"{box('Seed')}.value === '3'")
    for label, kept in (("Strength", "1"), ("Current (m/s)", "0.2"), ("Payload (kg)", "0")):
        for text, shown in (("-1", "-1"), ("1" + 20 * "0", "1e+20"), ("99", "99")):
            paste(tab, label, text)
            tab.shows(f"{label.split()[0].lower()} is {shown}, but must be 0 to ")
            tab.wait(f"{box(label)}.value === {kept!r}")
    tab.shows("running")
    assert tab.errors == []


def paste(tab: Tab, label: str, text: str) -> None:
    """Replace a text at once; typed digits are numbers of their own."""
    tab.click(box(label))
    tab.run(f"{box(label)}.select()")
    tab.key("Backspace")
    tab.call("Input.insertText", text=text)


@pytest.fixture(scope="module")
def shared() -> Iterator[str]:
    with served("--seed", "3") as (address, _):
        yield address


def test_a_foreign_page_cannot_connect(chrome: Browser, shared: str) -> None:
    class Page(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"<body>another page</body>")

        def log_message(self, *_: Any) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page) as foreign:
        threading.Thread(target=foreign.serve_forever, daemon=True).start()
        tab = chrome.tab()
        tab.open(f"http://127.0.0.1:{foreign.server_port}")
        tab.shows("another page")
        script = f"""new Promise(done => {{
          const socket = new WebSocket({shared.replace("http", "ws")!r}, ["viser-v{viser.__version__}"]);
          socket.onopen = () => done("open"); socket.onerror = () => done("refused"); }})"""
        assert tab.run(script) == "refused"
        foreign.shutdown()


def test_a_narrow_window_has_vehicle_and_controls(chrome: Browser, shared: str, tmp_path: Path) -> None:
    tab = visit(chrome, shared, 390, 844, 0.5)
    assert value(tab, "Seed") == "3"
    time.sleep(2.0)
    # Yellow of the vehicle, above the controls.
    tab.picture(tmp_path / "narrow.png")
    pixels = np.asarray(Image.open(tmp_path / "narrow.png").convert("RGB"))[:165].astype(int)
    assert ((pixels[..., 0] > 120) & (pixels[..., 1] > 90) & (pixels[..., 2] < 60)).sum() > 250
