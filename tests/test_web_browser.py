"""The page of a run in a real browser: headless Chromium."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("uvicorn", reason="the extra 'web' is not installed")

from pipeline.checkpoint import NOTHING
from pipeline.live.map_saver import MapSaver
from pipeline.map_request import MapRequest
from pipeline.replay import Paced, count
from pipeline.web.run_page import RunPage
from pipeline.web.server import WebServer
from tests.browsers import CANVAS, PHONE
from tests.conftest import OFFICE

# A process of its own, that can be killed.
SERVER = """
import threading
from pipeline.web.run_page import RunPage
from pipeline.web.server import WebServer
with WebServer(RunPage("first", None, threading.Event()), None, 0, print) as server:
    print(server.url, flush=True)
    threading.Event().wait()
"""


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


def test_a_killed_server_is_noticed_and_found_again(tab):
    page, complaints = tab
    process = subprocess.Popen([sys.executable, "-c", SERVER], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    address = re.fullmatch(r"(\S+:(\d+)/)\n", process.stdout.readline())
    assert address is not None
    try:
        page.goto(address[1])
        page.locator("#name", has_text="first").wait_for()
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
