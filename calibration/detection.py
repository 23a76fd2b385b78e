"""A board in an image: its corners, to a small fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.aprilgrid import search_aprilgrid
from calibration.board import Board
from calibration.charuco import search_charuco
from calibration.chessboards import search_chessboard
from calibration.circles import refine_circles, search_circles
from calibration.refine import blur_of, refine_corners, smallest_spacing, window
from calibration.sighting import Sighting

CIRCLES = ("circles", "acircles")
FEWEST_CORNERS = 6  # of a board that counts in part, not all on a line
# The board is searched in a copy no longer than this [px] first, and refined in the image itself:
# in an image of 2560 px this takes a tenth of the time.
SEARCH_SIDE = 1300
SMALLEST_SIDE = 40  # px; a smaller image shows no board, and OpenCV's detectors fail on it
# How far refinement may carry a coded corner, over the smallest spacing.
STRAYED = 0.25
BLUR_REACH = 12  # px around a corner that are enough to see how sharp its edges are


@dataclass(frozen=True, eq=False)
class Detection:
    """What an image shows; the fields are those of `corners.BoardImage`."""

    size: tuple[int, int]
    sighting: Sighting | None
    blur: float | None
    missing: str | None


def detect(image: np.ndarray, board: Board) -> Detection:
    """What an image uint8 (H, W) shows of the board."""
    size = (image.shape[1], image.shape[0])
    try:
        sighting = _find_board(image, board)
    except cv2.error as error:
        # One image is no reason to lose the others: it is left out, counted and named.
        return Detection(size, None, None, f"nothing that OpenCV can search ({error.err})")
    if sighting is None:
        return Detection(size, None, None, f"no {'' if board.coded else 'whole '}board")
    if board.coded and not _enough(sighting, board):
        count = len(sighting.ids)
        problem = f"only {count} corners of the board (at least {FEWEST_CORNERS}, off a line)"
        return Detection(size, None, None, problem)
    reach = 0.4 * smallest_spacing(sighting.corners, sighting.ids, board)
    if board.kind not in CIRCLES:
        reach = min(reach, BLUR_REACH)
    return Detection(size, sighting, blur_of(image, sighting.corners, reach), None)


def find_board(image: np.ndarray, board: Board) -> Sighting | None:
    """The board's corners in an image uint8 (H, W), however few; None when there is none, or
    OpenCV fails on the image."""
    try:
        return _find_board(image, board)
    except cv2.error:
        return None


def _find_board(image: np.ndarray, board: Board) -> Sighting | None:
    if min(image.shape) < SMALLEST_SIDE:
        return None
    found = _search_smaller(image, board) or _search(image, board)
    if found is None:
        return None
    ids, rough = found
    if board.kind in CIRCLES:
        return Sighting(ids, refine_circles(image, rough, board))
    if not board.coded:
        return Sighting(ids, refine_corners(image, rough, ids, board))
    return _refine_coded(image, ids, rough, board)


def _search_smaller(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    """`_search` in a smaller copy, where the image is large."""
    scale = SEARCH_SIDE / max(image.shape)
    if scale >= 1:
        return None
    copy = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    found = _search(copy, board)
    # Pixel centres are at integers.
    return found and (found[0], (found[1] + 0.5) / scale - 0.5)


def _search(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    """ids (n,), ascending, and corners (n, 2) to about a pixel; n > 0."""
    if board.kind == "charuco":
        return search_charuco(image, board)
    if board.kind == "aprilgrid":
        return search_aprilgrid(image, board)
    search = search_chessboard if board.kind == "chessboard" else search_circles
    corners = search(image, board)
    return None if corners is None else (np.arange(len(corners)), corners)


def _refine_coded(
    image: np.ndarray, ids: np.ndarray, rough: np.ndarray, board: Board
) -> Sighting | None:
    """Those of the corners that are seen; markers tell of hidden ones too."""
    half = window(rough, ids, board)
    last = np.array(image.shape[::-1]) - 1 - half
    inside = np.all((rough >= half) & (rough <= last), axis=1)
    ids, rough = ids[inside], rough[inside]
    if not len(ids):
        return None
    corners = refine_corners(image, rough, ids, board)
    # Where no edges meet at the corner, something hides it.
    met = np.linalg.norm(corners - rough, axis=1) < STRAYED * smallest_spacing(rough, ids, board)
    return Sighting(ids[met], corners[met]) if met.any() else None


def _enough(sighting: Sighting, board: Board) -> bool:
    if len(sighting.ids) < FEWEST_CORNERS:
        return False
    spread = board.points[sighting.ids] - board.points[sighting.ids].mean(axis=0)
    return bool(np.linalg.svd(spread, compute_uv=False)[1] > 0.1 * board.square)
