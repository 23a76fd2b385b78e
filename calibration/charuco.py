"""ChArUco boards: a chessboard whose white squares hold markers, so that any part of it counts.

The markers number the corners; the corners themselves are found where squares meet, which is
far more precise than a marker's own corners.
"""

from __future__ import annotations

import numpy as np

from calibration.board import Board
from calibration.markernames import smallest_dictionaries
from calibration.markers import Markers, find_markers, in_agreement, predicted

ENOUGH = 0.3  # of all markers, seen in agreement: this is the dictionary


def marker_squares(board: Board, legacy: bool = False) -> np.ndarray:
    """The corners of every marker (n, 4, 2) in the frame of `board.points` [m], clockwise from the
    upper left one.

    legacy: boards of an even number of rows as OpenCV drew them before 4.6, white square first.
    """
    i, j = np.mgrid[: board.rows, : board.columns]
    white_first = legacy and board.rows % 2 == 0
    cells = np.stack([j, i], axis=2)[(i + j) % 2 == (0 if white_first else 1)]
    gap = (board.square - _side(board)) / 2
    # The first inner corner, where `points` begin, is the lower right one of the first square.
    upper_left = (cells - 1) * board.square + gap
    return upper_left[:, None] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * _side(board)


def search_charuco(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    """ids (n,) of the inner corners seen and where they are (n, 2) px, to about a pixel; or None.

    Args:
        image: uint8 (H, W).
    """
    markers, squares = _read(image, board)
    if not len(markers.ids):
        return None
    ids, corners = [], []
    for number, point in enumerate(board.points[:, :2]):
        corner = predicted(point, markers, squares, board.square)
        if corner is not None:
            ids.append(number)
            corners.append(corner)
    if not ids:
        return None
    return np.array(ids, int), np.array(corners).reshape(-1, 2)


def _read(image: np.ndarray, board: Board) -> tuple[Markers, np.ndarray]:
    """The board's markers in the image, and the squares of the layout in which most agree."""
    layouts = [marker_squares(board)]
    if board.rows % 2 == 0:
        layouts.append(marker_squares(board, legacy=True))
    count = len(layouts[0])
    best = Markers(np.empty(0, int), np.empty((0, 4, 2))), layouts[0]
    for dictionary in [board.dictionary] if board.dictionary else smallest_dictionaries(count):
        markers = find_markers(image, dictionary)
        for squares in layouts:
            agreed = in_agreement(markers, squares, board.square)
            if len(agreed.ids) > len(best[0].ids):
                best = agreed, squares
        if len(best[0].ids) >= ENOUGH * count:
            break
    return best


def _side(board: Board) -> float:
    assert board.marker is not None, "a ChArUco board has markers"
    return board.marker
