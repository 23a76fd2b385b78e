"""Pairs of a board taken from cameras, with and without a page that shows where to hold it."""

from __future__ import annotations

import contextlib
import io
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

pytest.importorskip("uvicorn", reason="the extra 'web' is not installed")

from calibration.rig import load_rig
from calibration.verdict import LIMITS
from pipeline import signals
from pipeline.cli import cli
from pipeline.web.capture_page import CapturePage
from pipeline.web.capture_state import CaptureState
from pipeline.web.hub import RefusedError
from pipeline.web.messages import Message
from pipeline.web.server import WebServer
from stereo.camera import CapturedPair, Frame
from stereo.pair import StereoPair
from stereo.stereo_camera import StereoCamera
from tests.board_cameras import board_cameras, jpeg
from tests.board_person import NEAR_RIG, follow
from tests.browsers import CANVAS, PHONE
from tests.calibration_views import BOARD, Photograph, render
from tests.conftest import Outcome

VIEWS = 6


@dataclass(frozen=True)
class Captured:
    """What became of a capture in a folder of its own, and what the cameras sent."""

    outcome: Outcome
    place: Path
    sent: list[tuple[bytes, bytes]]

    def rig(self) -> bytes:
        """The rig file, but for the ports of its cameras."""
        text = (self.place / "rig.yaml").read_text()
        devices = load_rig(self.place / "rig.yaml").sections["devices"]
        for side in ("left", "right"):
            text = text.replace(devices[side], side)
        return text.encode()


def capture(place: Path, *options: object) -> Outcome:
    """`beemap calibrate capture` in a folder, in any thread."""
    words = ["calibrate", "capture", place / "rig.yaml", "-o", place / "shots"]
    words += ["--board", BOARD.name, "--square", "25mm", *options]
    code, out, err = 0, io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            cli.main([str(word) for word in words], standalone_mode=False)
        except SystemExit as end:
            code = int(end.code or 0)
    return Outcome(code, out.getvalue(), err.getvalue())


@pytest.fixture(scope="module")
def views() -> list[StereoPair]:
    poses = follow(NEAR_RIG, BOARD, VIEWS).poses
    return [StereoPair(0, *render(NEAR_RIG, pose, how=Photograph(blur=0.6))) for pose in poses]


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> Iterator[None]:
    """What was found in images is kept by this file's tests alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def plain(views, cache, tmp_path_factory) -> Captured:
    """A capture without a page, of all the views."""
    place = tmp_path_factory.mktemp("plain")
    with board_cameras(views, place / "shots", place / "rig.yaml") as sent:
        return Captured(capture(place, "--pairs", VIEWS), place, sent)


def images(place: Path) -> list[bytes]:
    return [file.read_bytes() for file in sorted((place / "shots").rglob("*.jpg"))]


def test_pairs_are_taken_from_the_cameras_and_calibrated(plain):
    outcome = plain.outcome
    assert outcome.code == 0, outcome
    assert images(plain.place) == [left for left, _ in plain.sent] + [r for _, r in plain.sent]
    found = load_rig(plain.place / "rig.yaml")
    assert found.sections["devices"]["fps"] == 20
    assert found.left.fx == pytest.approx(NEAR_RIG.left.fx, rel=0.02)
    assert found.baseline == pytest.approx(NEAR_RIG.baseline, rel=0.02)
    assert outcome.err.count("| kept") == VIEWS
    assert "now: " in outcome.err
    assert "page" not in outcome.err
    assert f"{VIEWS} pairs in {plain.place / 'shots'}; still missing: " in outcome.out
    assert "verdict: " in outcome.out


class Watched(threading.Thread):
    """A capture with a page, in a thread of its own, where no signal ends it: `end` does."""

    def __init__(self, place: Path, port: int, patch: pytest.MonkeyPatch) -> None:
        super().__init__(daemon=True)
        self.words = (place, "--web", "--port", port)
        self.outcome: Outcome | None = None
        self._events: list[threading.Event] = []
        patch.setattr(signals, "until_interrupted", self._uninterrupted)

    def run(self) -> None:
        self.outcome = capture(*self.words)

    def end(self) -> None:
        while self.is_alive():
            for event in self._events:
                event.set()
            self.join(0.1)

    @contextmanager
    def _uninterrupted(self) -> Iterator[threading.Event]:
        self._events.append(threading.Event())
        yield self._events[-1]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def opened(page: Any, port: int) -> None:
    """Open the page as soon as it is served."""
    for _ in range(200):
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
            break
        time.sleep(0.05)
    page.goto(f"http://127.0.0.1:{port}/")


def test_a_person_is_guided_to_the_verdict(plain, views, tmp_path, tab, monkeypatch):
    page, complaints = tab
    page.set_viewport_size(PHONE)
    begin, port = threading.Event(), free_port()
    running = Watched(tmp_path, port, monkeypatch)
    with (
        board_cameras(views, tmp_path / "shots", tmp_path / "rig.yaml", begin) as sent,
        ExitStack() as stack,
    ):
        running.start()
        stack.callback(running.end)
        opened(page, port)
        page.get_by_text("Neither camera sees the board").wait_for()
        page.get_by_text("Show the whole board to both cameras").wait_for()
        assert page.inner_text("#count") == "0"
        pictures = ("left", "right", "left-map")
        nobody = {name: page.evaluate(CANVAS, name)[1] for name in pictures}

        begin.set()
        count = "(n) => Number(document.getElementById('count').textContent) >= n"
        page.wait_for_function(count, arg=2)
        page.locator("#target", has_text="edge nearer").wait_for()
        assert page.locator("#flash").is_visible()
        early = [covered(page), page.locator("#tilts .done").count()]
        page.wait_for_function(count, arg=VIEWS)
        for name, before in nobody.items():
            assert page.evaluate(CANVAS, name)[1] != before, name
        late = [covered(page), page.locator("#tilts .done").count()]
        assert late > early
        page.locator("#now", has_text="Move it to the outline").wait_for()
        page.wait_for_function(
            "(n) => document.querySelectorAll('#thumbnails canvas').length === n", arg=VIEWS
        )
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]

        page.click("#stop")
        page.locator("#question", has_text=f"{VIEWS} views so far").wait_for()
        page.click("#confirm")
        page.locator("#verdict").wait_for(timeout=60_000)
        assert page.text_content("#verdict") in [word for word, _ in LIMITS]
        assert "px RMS" in page.inner_text("#facts")
        assert page.inner_text("#next")
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
        with page.expect_popup() as popup:
            page.click("#report")
        report = popup.value
        assert "Where the boards stood" in report.inner_text("body")
        report.close()
        assert complaints == []
        page.click("#stop")
        page.locator("#banner", has_text="beemap has ended").wait_for()
        running.join(20.0)
        assert running.outcome is not None
    assert running.outcome.code == plain.outcome.code
    web = Captured(running.outcome, tmp_path, sent)
    assert images(web.place) == images(plain.place)
    assert web.rig() == plain.rig()


def covered(page: Any) -> int:
    """Per cent of the left image."""
    return int(page.inner_text("#left-share").split()[0])


WORDS = """async () => {
  const { asked, became } = await import("/static/capture_words.js");
  const ghost = { place: "upper left", edge: "right", words: "" };
  return [asked(ghost, ["?"], false), asked(ghost, ["?"], true), asked(null, [], true),
    asked({ place: "top", edge: "", words: "farther away" }, ["?"], true),
    became("hold it still", true)[0], became("no board in the right image", false)[0]];
}"""
FITS = """async (moved) => {
  const { BoardView } = await import("/static/board_view.js");
  const view = new BoardView(document.getElementById("left"), () => true);
  const outline = [[0.2, 0.2], [0.5, 0.25], [0.5, 0.6], [0.2, 0.7]];
  view.ghost = { outline, lines: [], edge: "left" };
  view.outline = outline.toReversed().map(([u, v]) => [u + moved, v]);  // held upside down
  return view.fits;
}"""


def test_the_words_are_those_of_a_mirror_and_the_outline_tells_what_fits(tmp_path, tab):
    page, complaints = tab
    with WebServer(CapturePage(CaptureState(BOARD), Path("x"), tmp_path), None, 0, print) as server:
        page.goto(server.url)
        assert page.evaluate(WORDS) == [
            "Hold it in the upper left, its right edge nearer",
            "Hold it in the upper right, its left edge nearer",
            "Enough: put the board down",
            "Hold it at the top, farther away",
            "That is the place: hold it still",
            "The right camera does not see the board",
        ]
        assert page.evaluate(FITS, 0.02)
        assert not page.evaluate(FITS, 0.1)
        assert complaints == []


def told(page: CapturePage) -> dict[str, Message]:
    return {message.topic: message for message in page.news()}


def test_what_is_told_of_a_capture_that_fails(tmp_path):
    """From pairs that never come to the word why; damaged images are left out."""
    state = CaptureState(BOARD)
    page = CapturePage(state, Path("rig.yaml"), tmp_path)
    assert told(page)["capture"].values["phase"] == "connecting"
    assert told(page) == {}  # nothing changed
    for name in ("enough", "close", "shout"):
        with pytest.raises(RefusedError):
            page.command(name, "")
    camera = cast(StereoCamera, SimpleNamespace(newest=None))
    state.begins(camera)
    assert [*told(page)] == ["capture"]
    image = jpeg(np.full((48, 64), 90, np.uint8))
    camera.newest = CapturedPair(Frame(1, image), Frame(1, image[:200]))
    assert told(page) == {}
    camera.newest = CapturedPair(Frame(2, image), None)  # both halves
    (message,) = told(page).values()
    assert message.values["sizes"] == [0, 0, len(image)]
    assert message.blob == image
    page.command("enough", "")
    assert state.button.is_set()
    state.ended("no pair for 5 s: are both cameras running?")
    assert told(page)["capture"].values["said"].startswith("no pair for 5 s")
    assert page.report() is None


def test_a_camera_that_is_missing_ends_the_page_and_leaves_the_folder_free(tmp_path, beemap):
    rig = tmp_path / "rig.yaml"
    rig.write_text("beemap_rig: 1\ndevices: {left: /dev/video70, right: /dev/video71}\n")
    words = ("calibrate", "capture", rig, "-o", tmp_path / "shots", "--board", BOARD.name)
    for _ in range(2):
        outcome = beemap(*words, "--square", "25mm", "--web", "--port", 0)
        assert outcome.code == 2
        page, error = outcome.err.splitlines()
        assert page.startswith("page: http://127.0.0.1:")
        assert error.startswith("beemap: left camera: /dev/video70: no such camera")
