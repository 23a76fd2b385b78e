"""What is black on a printed board: rectangles and discs, in metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.aprilgrid import APRIL_DICTIONARY
from calibration.board import Board
from calibration.charuco import marker_squares
from calibration.markernames import MARKERS_IN
from calibration.markers import marker_bits

DISC_SHARE = 0.5  # a disc's diameter over the least distance between centres


@dataclass(frozen=True, eq=False)
class Drawing:
    """Black shapes on white paper, in the frame of `Board.points` (x right, y down the sheet) [m].

    rectangles: (n, 4) left, top, width, height; discs: (n, 3) centre x, y and radius.
    """

    rectangles: np.ndarray
    discs: np.ndarray

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom of all that is black."""
        low = np.vstack([self.rectangles[:, :2], self.discs[:, :2] - self.discs[:, 2:]])
        high = np.vstack(
            [
                self.rectangles[:, :2] + self.rectangles[:, 2:],
                self.discs[:, :2] + self.discs[:, 2:],
            ]
        )
        (left, top), (right, bottom) = low.min(axis=0).tolist(), high.max(axis=0).tolist()
        return left, top, right, bottom


def draw_board(board: Board) -> Drawing:
    """The board as it is printed; one whose markers are not named gets `printed_dictionary`."""
    if board.kind in ("circles", "acircles"):
        centres = board.points[:, :2]
        first, second = centres[board.neighbours[0]]
        radius = DISC_SHARE / 2 * float(np.linalg.norm(second - first))
        discs = np.column_stack([centres, np.full(len(centres), radius)])
        return Drawing(np.empty((0, 4)), discs)
    if board.kind == "chessboard":
        rectangles = _black_squares(board.columns + 1, board.rows + 1, board.square)
    elif board.kind == "charuco":
        squares = _black_squares(board.columns, board.rows, board.square)
        rectangles = np.vstack([squares, _cells(marker_squares(board), printed_dictionary(board))])
    else:
        tags = board.points[:, :2].reshape(-1, 4, 2)
        rectangles = np.vstack([_cells(tags, printed_dictionary(board)), _corner_squares(board)])
    return Drawing(rectangles, np.empty((0, 3)))


def printed_dictionary(board: Board) -> str:
    """The dictionary of the markers, where none is named that with the fewest and largest cells."""
    if board.dictionary:
        return board.dictionary
    if board.kind == "aprilgrid":
        return APRIL_DICTIONARY
    needed = board.columns * board.rows // 2
    return next(name for name, size in MARKERS_IN.items() if size >= needed)


def _black_squares(columns: int, rows: int, square: float) -> np.ndarray:
    """The black ones of columns x rows squares, the first being black; its lower right corner is
    the origin."""
    i, j = np.mgrid[:rows, :columns]
    cells = np.stack([j, i], axis=2)[(i + j) % 2 == 0] - 1.0
    return np.column_stack([cells * square, np.full((len(cells), 2), square)])


def _cells(squares: np.ndarray, dictionary: str) -> np.ndarray:
    """The black cells of markers 0, 1, ... in their squares (n, 4, 2), runs in a row joined."""
    rectangles = []
    for number, square in enumerate(squares):
        bits = marker_bits(dictionary, number)
        cell = (square[2] - square[0]) / len(bits)
        for row, line in enumerate(bits):
            edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
            for start, end in edges.reshape(-1, 2):
                corner = square[0] + cell * (start, row)
                rectangles.append([*corner, cell[0] * (end - start), cell[1]])
    return np.array(rectangles)


def _corner_squares(board: Board) -> np.ndarray:
    """Kalibr's small black squares between tags: a tag's corner is then one of a chessboard."""
    squares = board.points[:, :2].reshape(-1, 4, 2)
    gap = board.square - (squares[0, 1, 0] - squares[0, 0, 0])
    outward = np.array([[-1, -1], [0, -1], [0, 0], [-1, 0]]) * gap
    corners = np.unique(np.round((squares + outward).reshape(-1, 2), 9), axis=0)
    return np.column_stack([corners, np.full((len(corners), 2), gap)])
