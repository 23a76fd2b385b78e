"""The same corner must have the same number in both images of a pair."""

from __future__ import annotations

import numpy as np

from calibration.board import Board


def same_order(left: np.ndarray, right: np.ndarray, board: Board) -> tuple[np.ndarray, bool]:
    """The right image's corners numbered as the left's, and whether that changed them.

    A board that looks alike from two sides may be numbered from either end in each image. The
    cameras of a pair stand nearly the same way up, so the board has nearly the same shape and
    attitude in both images: of the numberings that the board allows, the right one is that
    whose corners, apart from a shift, lie closest to the left's.

    Args:
        left, right: (columns * rows, 2) pixels, row by row.
    """
    grid = right.reshape(board.rows, board.columns, 2)
    quarter_turns = range(4) if board.rows == board.columns else (0, 2)
    orders = [np.rot90(grid, turns).reshape(-1, 2) for turns in quarter_turns]
    shape = left - left.mean(axis=0)
    misfit = [float(np.sum((o - o.mean(axis=0) - shape) ** 2)) for o in orders]
    best = int(np.argmin(misfit))
    return orders[best], best != 0
