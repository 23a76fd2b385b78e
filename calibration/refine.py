"""From a corner known to about a pixel to one known to a small fraction of it."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.board import Board

# Half the refinement window over the smallest corner spacing. A fixed window reaches into the
# neighbouring corners of a small board: on OpenCV's sample pairs 11 px give a stereo RMS of
# 0.445 px, this gives 0.194.
WINDOW_SHARE = 0.35
SMALLEST_WINDOW = 2  # px
REFINE_UNTIL = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-4)


def refine_corners(
    image: np.ndarray, rough: np.ndarray, ids: np.ndarray, board: Board
) -> np.ndarray:
    """Corners (n, 2) float64 px, where the edges around `rough` (n, 2) px meet.

    Args:
        image: uint8 (H, W). ids: (n,) which of the board's points they are.
    """
    half = window(rough, ids, board)
    corners = rough.astype(np.float32).reshape(-1, 1, 2)
    fine = cv2.cornerSubPix(image, corners, (half, half), (-1, -1), REFINE_UNTIL)
    return fine.reshape(-1, 2).astype(np.float64)


def window(rough: np.ndarray, ids: np.ndarray, board: Board) -> int:
    """Half the side of the refinement window [px]."""
    share = WINDOW_SHARE
    if board.kind == "charuco" and board.marker is not None:
        # No further than the white gap around a marker: its edges are not the square's.
        share = min(share, (1 - board.marker / board.square) / 2)
    spacing = smallest_spacing(rough, ids, board)
    return max(SMALLEST_WINDOW, round(share * spacing)) if np.isfinite(spacing) else SMALLEST_WINDOW


def smallest_spacing(corners: np.ndarray, ids: np.ndarray, board: Board) -> float:
    """Least distance [px] between corners (n, 2) that are neighbours on the board; inf if none."""
    place = np.full(len(board.points), -1)
    place[ids] = np.arange(len(ids))
    pairs = place[board.neighbours]
    pairs = pairs[(pairs >= 0).all(axis=1)]
    if not len(pairs):
        return np.inf
    return float(np.linalg.norm(corners[pairs[:, 0]] - corners[pairs[:, 1]], axis=1).min())


def blur_of(image: np.ndarray, places: np.ndarray, reach: float) -> float:
    """Standard deviation of the blur of edges [px], the median over the places.

    A step of height h, blurred by a Gaussian of s px, rises by h / (s sqrt(2 pi)) a pixel at most.

    Args:
        image: uint8 (H, W). places: (n, 2) px. reach: within how far of a place [px] there are
            edges, and at least as much on both their sides.
    """
    half = max(3, round(reach))
    sigmas = []
    for u, v in np.rint(places).astype(int):
        patch = image[max(v - half, 0) : v + half + 1, max(u - half, 0) : u + half + 1]
        if min(patch.shape) < 3:
            continue
        dark, bright = np.percentile(patch, (5, 95))
        # Scharr's operator, scaled to grey values a pixel
        slopes = [cv2.Scharr(patch, cv2.CV_32F, *axis) / 32 for axis in ((1, 0), (0, 1))]
        steepest = float(np.hypot(*slopes).max())
        sigmas.append((bright - dark) / (max(steepest, 1e-6) * np.sqrt(2 * np.pi)))
    return float(np.median(sigmas)) if sigmas else np.inf
