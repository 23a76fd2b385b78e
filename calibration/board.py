"""The printed board: how many inner corners, how far apart."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from calibration.errors import CalibrationError

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
SMALLEST_SIDE = 3  # inner corners; OpenCV's detectors find no board with fewer
SQUARE_LIMITS = (1e-3, 2.0)  # m


@dataclass(frozen=True)
class Board:
    """A chessboard of `columns` x `rows` inner corners with squares of `square` metres."""

    columns: int
    rows: int
    square: float

    @property
    def name(self) -> str:
        """The board as it is written on the command line."""
        return f"chessboard:{self.columns}x{self.rows}"

    @property
    def points(self) -> np.ndarray:
        """Corners on the board (columns * rows, 3) [m], row by row, z = 0."""
        y, x = np.mgrid[: self.rows, : self.columns]
        return self.square * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)

    def as_squares(self) -> Board | None:
        """The board meant when `columns` x `rows` counted squares; None if there is none."""
        if min(self.columns, self.rows) <= SMALLEST_SIDE:
            return None
        return replace(self, columns=self.columns - 1, rows=self.rows - 1)


def parse_board(text: str, square: float) -> Board:
    """The board written as `chessboard:COLUMNSxROWS` (inner corners), squares of `square` metres.

    Raises:
        CalibrationError: another kind of board, or no two counts of at least 3.
    """
    match = re.fullmatch(r"chessboard:([0-9]{1,3})[xX]([0-9]{1,3})", text.strip())
    if match is None:
        raise CalibrationError(
            f"--board {text!r}: write chessboard:COLUMNSxROWS with the counts of inner corners, "
            "as in chessboard:9x6"
        )
    columns, rows = int(match[1]), int(match[2])
    if min(columns, rows) < SMALLEST_SIDE:
        raise CalibrationError(
            f"--board {text!r}: a side has at least {SMALLEST_SIDE} inner corners "
            "(squares along it, less one)"
        )
    return Board(columns, rows, square)


def parse_length(text: str) -> float:
    """The metres in a length with its unit, as `25mm`, `2.5cm` or `0.025m`.

    Raises:
        CalibrationError: no number, no unit, an unknown unit, or no size a board can have.
    """
    match = re.fullmatch(r"([0-9]+\.?[0-9]*|\.[0-9]+)\s*([a-zA-Z]*)", text.strip())
    if match is None:
        raise CalibrationError(f"--square {text!r}: write a length with its unit, as in 25mm")
    number, unit = float(match[1]), match[2]
    if not unit:
        raise CalibrationError(f"--square {text!r}: give the unit, as in {match[1]}mm")
    if unit not in METRES:
        raise CalibrationError(f"--square {text!r}: unknown unit '{unit}' (known: mm, cm, m)")
    length = number * METRES[unit]
    low, high = SQUARE_LIMITS
    if not low <= length <= high:
        raise CalibrationError(
            f"--square {text!r}: {length:g} m is no size of a square (1 mm to 2 m): check the unit"
        )
    return length
