"""The page of a run in a real browser: headless Chromium."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("uvicorn", reason="the extra 'web' is not installed")
pytest.importorskip("playwright", reason="playwright is not installed")

from playwright import sync_api

from pipeline.checkpoint import NOTHING
from pipeline.live.map_saver import MapSaver
from pipeline.map_request import MapRequest
from pipeline.replay import Paced, count
from pipeline.web.run_page import RunPage
from pipeline.web.server import WebServer
from tests.conftest import OFFICE

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
CHROMIUM = next((path for name in NAMES if (path := shutil.which(name))), None)
OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip
PHONE = {"width": 360, "height": 740}
# How much of a canvas has its commonest colour, and a sum of all that it shows.
CANVAS = """(id) => {
  const canvas = document.getElementById(id);
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let sum = 0;
  const counts = new Map();
  for (let i = 0; i < data.length; i += 4) {
    const colour = data[i] * 65536 + data[i + 1] * 256 + data[i + 2];
    sum = (31 * sum + colour) % 1000003;
    counts.set(colour, (counts.get(colour) ?? 0) + 1);
  }
  return [4 * Math.max(...counts.values()) / data.length, sum];
}"""

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason=f"no browser: none of {', '.join(NAMES)} is installed"
)


@pytest.fixture(scope="module")
def browser(tmp_path_factory) -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        context = playwright.chromium.launch_persistent_context(
            tmp_path_factory.mktemp("profile"),
            executable_path=CHROMIUM,
            args=list(OPTIONS),
            headless=True,
            viewport={"width": 1100, "height": 800},
        )
        context.set_default_timeout(15_000)
        yield context
        context.close()


@pytest.fixture
def tab(browser) -> Iterator[tuple[Any, list[str]]]:
    """A page, and what it complained about."""
    complaints: list[str] = []
    page = browser.new_page()
    page.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    yield page, complaints
    page.close()


class Run(threading.Thread):
    """A replay in this process, whose page is `page`."""

    def __init__(self, recording: Path, output: Path) -> None:
        super().__init__()
        output.mkdir()
        self.stop = threading.Event()
        self.partial = False
        self.page = RunPage(recording.name, output, self.stop)
        settings = ("mapping.particles=20",)
        self._job, _ = MapRequest(str(recording)).prepare(None, settings, threads=1)
        self._saver = MapSaver(output, self.page.state.saved)

    def run(self) -> None:
        paced = Paced(self.page.state, 8.0, count(self._job), self.stop, self._saver)
        run = self._job.run(lambda done, total: None, self.stop.is_set, NOTHING, paced)
        self._saver.close()
        self.partial = run.partial
        self.page.state.ended(run)


def test_a_run_is_watched_from_its_first_picture_to_its_last(tmp_path, tab):
    page, complaints = tab
    run = Run(OFFICE, tmp_path / "run")  # long enough for any browser
    with WebServer(run.page, None, 0, print) as server:
        page.goto(server.url)
        page.get_by_text("waiting for the robot").wait_for()
        run.start()

        page.set_viewport_size(PHONE)
        page.locator("#maps", has_text="local map").wait_for()
        maps = page.inner_text("#maps")
        first = {name: page.evaluate(CANVAS, name) for name in ("map", "camera", "depth", "local")}
        for name, (plain, _) in first.items():
            assert plain < 0.95, name  # something is drawn
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= PHONE["width"]

        page.click("#mark")
        page.fill("#place", "coffee machine")
        page.press("#place", "Enter")
        page.locator("#answer", has_text="'coffee machine' is where the robot is now").wait_for()
        page.click("#save")
        page.locator("#notes", has_text="map saved").wait_for()
        assert (tmp_path / "run" / "map.yaml").is_file()
        assert "coffee machine" in (tmp_path / "run" / "places.json").read_text()

        grown = "(before) => document.getElementById('maps').textContent !== before"
        page.wait_for_function(grown, arg=maps)
        for name, (_, before) in first.items():
            assert page.evaluate(CANVAS, name)[1] != before, name
        metres = [measured(page, pixels) for pixels in (50, 100)]
        assert metres[1] == pytest.approx(2 * metres[0], abs=0.03)
        light = page.evaluate(CANVAS, "map")[1]
        page.emulate_media(color_scheme="dark")
        page.wait_for_function(f"(before) => ({CANVAS})('map')[1] !== before", arg=light)

        page.click("#stop")
        page.click("text=Stop the run")
        page.locator("#banner", has_text="The run is over. Its map is in").wait_for()
    assert run.partial  # it was stopped on the page
    assert complaints == []


def measured(page: Any, pixels: int) -> float:
    """What the ruler says between two points so far apart."""
    if page.get_attribute("#ruler", "aria-pressed") == "false":
        page.click("#ruler")
    for x in (100, 100 + pixels):
        page.click("#map", position={"x": x, "y": 120})
    text = page.locator("#measured").inner_text()
    found = re.fullmatch(r"(\d+\.\d\d) m", text)
    assert found, text
    return float(found[1])


def test_a_killed_server_is_noticed_and_found_again(office_piece, tab):
    page, complaints = tab
    words = ("replay", office_piece, "--web", "--port", 0, "--set", "mapping.particles=20")
    process = subprocess.Popen(
        [sys.executable, "-m", "pipeline.cli", *map(str, words)], stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    address = next(m for line in process.stderr if (m := re.match(r"page: (\S+:(\d+)/)", line)))
    try:
        page.goto(address[1])
        page.locator("#line", has_text="live").wait_for()
    finally:
        process.kill()
        process.wait()
    page.locator("#line", has_text="connection lost").wait_for()
    assert page.locator("#banner").is_visible()
    assert page.is_disabled("#save")
    with WebServer(RunPage("next", None, threading.Event()), None, int(address[2]), print):
        page.locator("#line", has_text="waiting for the robot").wait_for()
        assert page.locator("#banner").is_hidden()
        assert page.inner_text("#name") == "next"
    assert all("net::ERR_" in text for text in complaints), complaints
    # Where a token is asked for now, to try again is of no use.
    with WebServer(RunPage("x", None, threading.Event()), "127.0.0.1", int(address[2]), print):
        page.locator("#line", has_text="not let in").wait_for()
