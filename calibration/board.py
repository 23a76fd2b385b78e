"""The printed board: which kind, how many corners, how far apart."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.errors import CalibrationError
from calibration.markernames import MARKERS_IN, dictionary_name

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
LENGTH_LIMITS = (1e-3, 2.0)  # m

# kind -> what COLUMNSxROWS counts, an example, and the fewest along a side
KINDS = {
    "chessboard": ("inner corners", "chessboard:9x6", 3),
    "charuco": ("squares", "charuco:8x6", 3),
    "circles": ("circles", "circles:7x5", 3),
    "acircles": ("circles a row and rows", "acircles:4x11", 3),
    "aprilgrid": ("tags", "aprilgrid:6x6", 2),
}
LARGEST = 2000  # columns x rows
CODED = ("charuco", "aprilgrid")  # markers number the corners: a part of the board is enough

# Side of a marker over `square`, where --marker is not given: for a ChArUco board what OpenCV's
# samples print, for an AprilGrid Kalibr's gap of 0.3 tags.
MARKER_SHARE = {"charuco": 0.75, "aprilgrid": 1 / 1.3}
APRIL_DICTIONARY = "apriltag_36h11"


@dataclass(frozen=True)
class Board:
    """A flat board with points that can be found to a fraction of a pixel.

    kind: one of `KINDS`. columns, rows: what `KINDS` says, for that kind.
    square: the spacing [m]: the side of a square (chessboard, charuco), from centre to centre
        (circles), from row to row (acircles, where neighbours in a row are 2 `square` apart), from
        one tag to the next (aprilgrid).
    marker: side of a marker's black square [m] (charuco, aprilgrid).
    dictionary: of the markers, as in "4x4_50"; None: recognised in the images (charuco).
    """

    columns: int
    rows: int
    square: float
    kind: str = "chessboard"
    marker: float | None = None
    dictionary: str | None = None

    @property
    def name(self) -> str:
        """The board as it is written on the command line."""
        return f"{self.kind}:{self.columns}x{self.rows}"

    @property
    def coded(self) -> bool:
        """Whether every corner is known by itself, so that a part of the board counts."""
        return self.kind in CODED

    @property
    def lattice(self) -> tuple[int, int]:
        """(columns, rows) of the points of a kind whose points form a plain lattice."""
        if self.kind == "charuco":
            return self.columns - 1, self.rows - 1
        return self.columns, self.rows

    @cached_property
    def points(self) -> np.ndarray:
        """Points on the board (m, 3) [m] by id: x to the right, y down the sheet, z = 0.

        Row by row; of an AprilGrid the four corners of each tag in turn, clockwise from its upper
        left one, tag 0 at the lower left as Kalibr counts.
        """
        columns, rows = self.lattice
        j, i = (axis.ravel() for axis in np.meshgrid(np.arange(columns), np.arange(rows)))
        if self.kind == "acircles":
            plane = np.stack([2 * j + i % 2, i], axis=1) * self.square
        elif self.kind == "aprilgrid":
            tags = np.stack([j, rows - 1 - i], axis=1) * self.square
            corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (self.marker or 0.0)
            plane = (tags[:, None] + corners).reshape(-1, 2)
        else:
            plane = np.stack([j, i], axis=1) * self.square
        points = np.column_stack([plane, np.zeros(len(plane))])
        points.flags.writeable = False
        return points

    @cached_property
    def neighbours(self) -> np.ndarray:
        """The pairs of ids (k, 2), the smaller one first, whose points are nearest together."""
        plane = self.points[:, :2]
        apart = np.linalg.norm(plane[:, None] - plane, axis=2)
        np.fill_diagonal(apart, np.inf)
        near = apart <= apart.min() * 1.001
        return np.argwhere(np.triu(near))

    def as_squares(self) -> Board | None:
        """The chessboard meant when `columns` x `rows` counted squares; None if there is none."""
        if self.kind != "chessboard" or min(self.columns, self.rows) <= KINDS[self.kind][2]:
            return None
        return replace(self, columns=self.columns - 1, rows=self.rows - 1)


def parse_board(
    text: str, square: float, marker: float | None = None, dictionary: str | None = None
) -> Board:
    """The board written as KIND:COLUMNSxROWS, with its spacing and marker side in metres.

    Raises:
        CalibrationError: an unknown kind, no two counts or too small ones, a marker or dictionary
            that is unknown, does not fit, or belongs to another kind of board.
    """
    match = re.fullmatch(r"([a-z]+):([0-9]{1,3})[xX]([0-9]{1,3})", text.strip())
    if match is None or match[1] not in KINDS:
        examples = ", ".join(f"{example} ({counts})" for counts, example, _ in KINDS.values())
        raise CalibrationError(f"--board {text!r}: write KIND:COLUMNSxROWS, one of {examples}")
    kind, columns, rows = match[1], int(match[2]), int(match[3])
    counts, _, fewest = KINDS[kind]
    if min(columns, rows) < fewest:
        less = " (squares along it, less one)" if kind == "chessboard" else ""
        raise CalibrationError(f"--board {text!r}: a side has at least {fewest} {counts}{less}")
    if columns * rows > LARGEST:
        raise CalibrationError(f"--board {text!r}: has more than {LARGEST} {counts}: write fewer")
    board = Board(columns, rows, square, kind)
    if kind not in CODED:
        if marker is not None or dictionary is not None:
            option = "--marker" if marker is not None else "--dictionary"
            raise CalibrationError(f"{option}: {board.name} has no markers: leave it out")
        return board
    return replace(
        board, marker=_marker_side(board, marker), dictionary=_dictionary(board, dictionary)
    )


def _marker_side(board: Board, marker: float | None) -> float:
    if marker is None:
        return MARKER_SHARE[board.kind] * board.square
    if not 0.2 * board.square <= marker < board.square:
        raise CalibrationError(
            f"--marker: {marker * 1e3:g} mm does not fit a --square of {board.square * 1e3:g} mm: "
            "measure the side of a marker's black square, and from one square (or tag) to the next"
        )
    return marker


def _dictionary(board: Board, text: str | None) -> str | None:
    if board.kind == "aprilgrid" and text is None:
        text = APRIL_DICTIONARY
    if text is None:
        return None
    name = dictionary_name(text)
    tags = board.columns * board.rows
    needed = tags if board.kind == "aprilgrid" else tags // 2
    if needed > MARKERS_IN[name]:
        raise CalibrationError(
            f"--dictionary {text!r}: has {MARKERS_IN[name]} markers, {board.name} needs {needed}"
        )
    return name


def parse_length(text: str, option: str = "--square") -> float:
    """The metres in a length with its unit, as `25mm`, `2.5cm` or `0.025m`.

    Raises:
        CalibrationError: no number, no unit, an unknown unit, or nothing that a board or a camera
            pair measures; the message names `option`.
    """
    match = re.fullmatch(r"([0-9]+\.?[0-9]*|\.[0-9]+)\s*([a-zA-Z]*)", text.strip())
    if match is None:
        raise CalibrationError(f"{option} {text!r}: write a length with its unit, as in 25mm")
    number, unit = float(match[1]), match[2]
    if not unit:
        raise CalibrationError(f"{option} {text!r}: give the unit, as in {match[1]}mm")
    if unit not in METRES:
        raise CalibrationError(f"{option} {text!r}: unknown unit '{unit}' (known: mm, cm, m)")
    length = number * METRES[unit]
    low, high = LENGTH_LIMITS
    if not low <= length <= high:
        raise CalibrationError(
            f"{option} {text!r}: {length:g} m is not within 1 mm to 2 m: check the unit"
        )
    return length
