"""CapturePage: pairs of a board being taken, then their calibration, as a page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pipeline.web.capture_news import CaptureNews
from pipeline.web.capture_state import SOLVED, TAKING, CaptureState
from pipeline.web.hub import RefusedError
from pipeline.web.messages import Message


class CapturePage:
    """state: what the command tells; rig_file: what is calibrated; folder: of the pairs."""

    index = "capture.html"

    def __init__(self, state: CaptureState, rig_file: Path, folder: Path) -> None:
        self._state = state
        self._news = CaptureNews(state, rig_file, folder)

    def news(self) -> Iterator[Message]:
        """What changed since the last call."""
        return iter(self._news)

    def command(self, name: str, value: str) -> str:
        """enough: take no more pairs; close: end the command, which shows its verdict."""
        phases = {"enough": TAKING, "close": SOLVED}
        if name not in phases:
            raise RefusedError(f"cannot {name}")
        if self._state.phase != phases[name]:
            raise RefusedError("it is too late for that, or too early")
        self._state.button.set()
        return ""

    def report(self) -> bytes | None:
        """That of the calibration, once it stands."""
        solved = self._state.solved
        return None if solved is None else solved.report.read_bytes()
