"""AprilGrids (Kalibr): a lattice of tags with a small black square at each tag's corners."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.board import APRIL_DICTIONARY, Board
from calibration.markers import Markers, find_markers, in_agreement, predicted

# Tags as AprilTag and OpenCV print them have a black border of one cell, Kalibr's have two.
BORDERS = (1, 2)
# The small squares touch the tags' corners: in images shorter than this [px], enlarged twice, the
# outlines of three times as many tags come apart.
ENLARGE_BELOW = 1300


def search_aprilgrid(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    """ids (n,) of the tag corners seen and where they are (n, 2) px, to about a pixel; or None.

    Which corner of a tag comes first is not the same for every maker of tags, so that the way up
    is taken in which neighbouring tags agree.

    Args:
        image: uint8 (H, W).
    """
    squares = board.points[:, :2].reshape(-1, 4, 2)
    enlarge = 2 if max(image.shape) < ENLARGE_BELOW else 1
    large = cv2.resize(image, None, fx=enlarge, fy=enlarge, interpolation=cv2.INTER_CUBIC)
    best = Markers(np.empty(0, int), np.empty((0, 4, 2)))
    for border in BORDERS:
        tags = find_markers(large, board.dictionary or APRIL_DICTIONARY, border)
        if len(tags.ids) <= len(best.ids):
            continue
        for quarter in range(4):
            turned = Markers(tags.ids, np.roll(tags.corners, quarter, axis=1))
            agreed = in_agreement(turned, squares, board.square)
            if len(agreed.ids) > len(best.ids):
                best = agreed
    if not len(best.ids):
        return None
    ids = (4 * best.ids[:, None] + np.arange(4)).ravel()
    corners = [predicted(board.points[n, :2], best, squares, board.square) for n in ids]
    known = np.array([corner is not None for corner in corners])
    places = np.array([corner for corner in corners if corner is not None]).reshape(-1, 2)
    # Pixel centres are at integers.
    return ids[known], (places + 0.5) / enlarge - 0.5
