"""Chessboard corners in one image, to a small fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calibration.board import Board

# Half the refinement window over the smallest corner spacing. A fixed window reaches into the
# neighbouring corners of a small board: on OpenCV's sample pairs 11 px give a stereo RMS of
# 0.445 px, this gives 0.194.
WINDOW_SHARE = 0.35
SMALLEST_WINDOW = 2  # px
REFINE_UNTIL = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-4)


@dataclass(frozen=True)
class BoardImage:
    """What one image file shows.

    size: (width, height) in pixels; None when the file cannot be read.
    corners: (columns * rows, 2) pixels, row by row; None when the whole board is not seen.
    """

    path: Path
    size: tuple[int, int] | None = None
    corners: np.ndarray | None = None

    @property
    def reason(self) -> str | None:
        """Why the image is of no use, or None."""
        if self.size is None:
            return f"{self.path.name} cannot be read"
        if self.corners is None:
            return f"no whole board in {self.path.name}"
        return None


def look(path: Path, board: Board) -> BoardImage:
    """Read an image file and find the board in it."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        return BoardImage(path)
    return BoardImage(path, (image.shape[1], image.shape[0]), find_corners(image, board))


def find_corners(image: np.ndarray, board: Board) -> np.ndarray | None:
    """The board's inner corners, row by row.

    Args:
        image: uint8 (H, W).

    Returns:
        (columns * rows, 2) float32 pixels, or None when the whole board is not seen.
    """
    found = _search(image, board)
    if found is None:
        return None
    half = max(SMALLEST_WINDOW, round(WINDOW_SHARE * smallest_spacing(found, board)))
    corners = found.astype(np.float32).reshape(-1, 1, 2)
    return cv2.cornerSubPix(image, corners, (half, half), (-1, -1), REFINE_UNTIL).reshape(-1, 2)


def smallest_spacing(corners: np.ndarray, board: Board) -> float:
    """Least distance between neighbouring corners (n, 2) of the board [px]."""
    grid = corners.reshape(board.rows, board.columns, 2)
    along_rows = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    along_columns = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    return float(min(along_rows.min(), along_columns.min()))


def _search(image: np.ndarray, board: Board) -> np.ndarray | None:
    """Corners (n, 2) to about a pixel."""
    size = (board.columns, board.rows)
    found, corners = cv2.findChessboardCorners(
        image, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
    )
    if not found:
        # Sectors (Duda and Frese 2018) see blurred boards that the search for quads misses;
        # under uneven light it is the other way round.
        found, corners = cv2.findChessboardCornersSB(
            image, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE
        )
    return corners.reshape(-1, 2) if found else None
