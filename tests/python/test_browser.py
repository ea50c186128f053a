"""Page of `uvms play --web` in headless Chromium."""

import contextlib
import http.server
import os
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
from browser import Browser, Tab, browser, chromium
from helpers import free_port

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(chromium() is None, reason="there is no chromium (apt-get install chromium)"),
]

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
    with browser(tmp_path_factory.mktemp("chromium")) as started:
        yield started


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
