"""CaptureState: where the command that takes pairs of a board leaves what its page shows.

References only, each set whole: nothing is computed, copied or waited for.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from pathlib import Path

from calibration.board import Board
from calibration.calibrate import CalibrationResult
from pipeline.board_capture import BoardCapture, Look
from pipeline.board_views import BoardViews
from pipeline.pair_taking import CaptureWatcher
from stereo.camera import CapturedPair
from stereo.stereo_camera import StereoCamera

CONNECTING, TAKING, SOLVING, SOLVED, ENDED = "connecting", "taking", "solving", "solved", "ended"


@dataclass(frozen=True, eq=False)
class Solved:
    """A calibration, and the page of its report."""

    result: CalibrationResult
    report: Path


class CaptureState(CaptureWatcher):
    """judged: the latest pair and what became of it; looked_at: images in which the board was
    searched for the calibration, of how many; said: how it ended, where there is no calibration.

    button: set by the one button of the page, exchanged whole for each thing that it ends.
    """

    def __init__(self, board: Board) -> None:
        self.phase = CONNECTING
        self.camera: StereoCamera | None = None
        self.judged: tuple[CapturedPair, Look] | None = None
        self.views = BoardViews(board)
        self.looked_at = 0, 0
        self.solved: Solved | None = None
        self.said = ""
        self.button = threading.Event()

    def begins(self, camera: StereoCamera) -> None:
        """The cameras send."""
        self.camera = camera
        self.phase = TAKING

    def looked(self, pair: CapturedPair, look: Look, capture: BoardCapture) -> None:
        """A pair was judged."""
        self.views = capture.views
        self.judged = pair, look

    def solving(self, done: int, total: int) -> None:
        """The calibration has looked at some of its images."""
        self.looked_at = done, total
        self.phase = SOLVING

    def shows(self, solved: Solved, button: threading.Event) -> None:
        """The calibration stands; the button ends the command."""
        self.solved, self.button = solved, button
        self.phase = SOLVED

    def ended(self, said: str = "") -> None:
        """Nothing comes after this; what was said of it before stays."""
        self.said = said or self.said
        self.phase = ENDED
