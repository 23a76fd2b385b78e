"""Chessboards: all inner corners or none, to about a pixel."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.board import Board

# How much of the pattern's contrast beyond a side shows that it goes on there: a white rim has
# half of it, another row of squares all.
GOES_ON = 0.75
ALTERNATE = 0.9  # of the corners, at least; glare may hide some
# Standard deviation of grey within squares, over the contrast between them: blur of a quarter of a
# square leaves 0.16, a lattice that runs aslant over several squares 0.4 and more.
MIXED = 0.28


def search_chessboard(image: np.ndarray, board: Board) -> np.ndarray | None:
    """The inner corners (columns * rows, 2) px, row by row, or None.

    Args:
        image: uint8 (H, W).
    """
    for find in (_by_squares, _by_sectors):
        found, corners = find(image, board.lattice)
        if found and _is_whole(image, corners.reshape(board.rows, board.columns, 2)):
            return corners.reshape(-1, 2)
    return None


def _by_squares(image: np.ndarray, size: tuple[int, int]):
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
    return cv2.findChessboardCorners(image, size, flags=flags)


def _by_sectors(image: np.ndarray, size: tuple[int, int]):
    """Duda and Frese 2018: sees blurred boards that the search for squares misses; under uneven
    light it is the other way round."""
    return cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)


def _is_whole(image: np.ndarray, grid: np.ndarray) -> bool:
    """Whether black and white alternate at the corners (rows, columns, 2) px, and not beyond them.

    A smaller board is also found within a larger one, sometimes aslant or with a row left out, and
    which part of it may differ from image to image.
    """
    pattern = _pattern(image, grid.astype(float))
    regular = max(np.mean(pattern > 0), np.mean(pattern < 0)) > ALTERNATE
    regular &= _mixed(image, grid.astype(float)) < MIXED * np.abs(pattern).mean() / 2
    sides = (np.rot90(grid.astype(float), turns) for turns in range(4))
    return bool(regular) and all(_beyond(image, side) < GOES_ON for side in sides)


def _beyond(image: np.ndarray, grid: np.ndarray) -> float:
    """How much the row before the first, if there were one, continues the pattern: 1 fully.

    At the rim of a board, where two of the four squares at a corner are white, about half.
    """
    before = 2 * grid[0] - grid[1]
    there, here = _pattern(image, np.stack([before, grid[0]])).mean(axis=1)
    return float(there / here) if here else 0.0


def _mixed(image: np.ndarray, grid: np.ndarray) -> float:
    """Standard deviation of grey within the squares between corners (rows, columns, 2) px."""
    inside = (0.25, 0.5, 0.75)
    above = [grid[:, :-1] + a * (grid[:, 1:] - grid[:, :-1]) for a in inside]
    places = [row[:-1] + b * (row[1:] - row[:-1]) for row in above for b in inside]
    return float(np.mean(np.std([_grey(image, place) for place in places], axis=0)))


def _pattern(image: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Grey of the squares at one diagonal less that at the other, around corners
    (rows, columns, 2) px; the sign turned at every second corner, so that it is one on a board."""
    across, down = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    total = np.zeros(grid.shape[:2])
    for right in (-1, 1):
        for below in (-1, 1):
            total += right * below * _grey(image, grid + 0.3 * (right * across + below * down))
    return total * (1 - 2 * (np.indices(total.shape).sum(axis=0) % 2))


def _grey(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Grey (rows, columns) at places (rows, columns, 2) px."""
    u, v = np.moveaxis(places.astype(np.float32), -1, 0)
    grey = cv2.remap(
        image,
        np.ascontiguousarray(u),
        np.ascontiguousarray(v),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return grey.astype(float)
