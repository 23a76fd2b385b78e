"""Square markers in an image: which ones, and their four corners to about a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np


@dataclass(frozen=True, eq=False)
class Markers:
    """ids: (n,) ascending; corners: (n, 4, 2) px, clockwise from the marker's upper left one."""

    ids: np.ndarray
    corners: np.ndarray


@lru_cache
def predefined(dictionary: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of this name, as in "4x4_50"."""
    constants = {name.lower(): name for name in dir(cv2.aruco) if name.startswith("DICT_")}
    constant = getattr(cv2.aruco, constants[f"dict_{dictionary}"])
    return cv2.aruco.getPredefinedDictionary(constant)


def marker_bits(dictionary: str, number: int) -> np.ndarray:
    """The cells of a printed marker, black border of one cell included: (n, n) bool, True = black.

    Raises IndexError when the dictionary has no such marker.
    """
    known = predefined(dictionary)
    if not 0 <= number < len(known.bytesList):
        raise IndexError(f"{dictionary} has no marker {number}")
    side = known.markerSize + 2
    return cv2.aruco.generateImageMarker(known, number, side) == 0


def find_markers(image: np.ndarray, dictionary: str, border: int = 1) -> Markers:
    """The markers of a dictionary in an image uint8 (H, W), each at most once.

    border: width of the markers' black border in cells.
    """
    settings = cv2.aruco.DetectorParameters()
    settings.markerBorderBits = border
    # Where OpenCV's own settings miss markers: far ones; next to other black shapes, which need
    # more than one size of the thresholding window; and blurred ones, whose cells run together.
    settings.minMarkerPerimeterRate = 0.02
    settings.adaptiveThreshWinSizeMin, settings.adaptiveThreshWinSizeMax = 5, 45
    settings.adaptiveThreshWinSizeStep = 8
    settings.perspectiveRemovePixelPerCell = 8
    settings.perspectiveRemoveIgnoredMarginPerCell = 0.25
    # Lines along the sides: where other black shapes touch a corner, the outline cuts it off.
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    known = predefined(dictionary)
    try:
        corners, ids, _ = cv2.aruco.ArucoDetector(known, settings).detectMarkers(image)
    except cv2.error:
        # That refinement fails on some outlines ("nContours.size() >= 2"), and takes all the
        # markers of the image with it; without it they are found, their corners less exactly.
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
        corners, ids, _ = cv2.aruco.ArucoDetector(known, settings).detectMarkers(image)
    if ids is None or not len(ids):
        return Markers(np.empty(0, int), np.empty((0, 4, 2)))
    numbers, first, count = np.unique(ids.ravel(), return_index=True, return_counts=True)
    # A number read twice is a misreading in one of the two places, and nothing says in which.
    first = first[count == 1]
    squares = np.stack([np.reshape(c, (4, 2)) for c in corners]).astype(float)
    return Markers(numbers[count == 1].astype(int), squares[first])


def in_agreement(markers: Markers, squares: np.ndarray, spacing: float) -> Markers:
    """The markers that lie where their neighbours on the board say.

    A misread number puts a marker elsewhere. What no neighbour vouches for is left out. A wrong
    idea of the board's layout puts most markers elsewhere: where fewer than half of all markers
    seen agree, it is another board, and none is given. The corners given are those of markers
    as large as their distances say.

    Args:
        squares: (m, 4, 2) the corners of marker 0, 1, ... on the board [m]. Numbers from m on are
            none of this board.
        spacing: how far apart neighbours are at most, along a row or column [m].
    """
    known = markers.ids < len(squares)
    ids, corners = markers.ids[known], markers.corners[known]
    if not len(ids):
        return Markers(ids, corners)
    places = squares[ids]
    centres = places.mean(axis=1)
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    near = (apart > 0) & (apart < 1.5 * spacing)
    # told[m, n]: where the view of marker n alone puts the centre of marker m
    views = [_view_of(*pair) for pair in zip(places, corners, strict=True)]
    told = np.stack([_project(view, centres) for view in views], axis=1)
    off = np.linalg.norm(told - corners.mean(axis=1)[:, None], axis=2)
    typical = np.array(
        [np.median(o[n]) if n.any() else np.inf for o, n in zip(off, near, strict=True)]
    )
    side = np.linalg.norm(np.diff(corners, axis=1), axis=2).max(axis=1)
    agree = typical < 0.4 * side
    if 2 * np.count_nonzero(agree) < len(markers.ids):
        agree[:] = False
    sure = near & agree[:, None] & agree
    return Markers(ids[agree], _grown(corners, told, sure)[agree])


def _grown(corners: np.ndarray, told: np.ndarray, sure: np.ndarray) -> np.ndarray:
    """The corners (n, 4, 2) of markers as large as their distances say.

    An outline may lie some pixels within its marker, so that the marker seems too small for the
    distance to the next.

    Args:
        told: (n, n, 2) where marker n puts the centre of m; sure: (n, n) bool, the pairs to trust.
    """
    if not sure.any():
        return corners
    seen = corners.mean(axis=1)
    told_apart = np.linalg.norm(told - seen, axis=2)[sure]
    seen_apart = np.linalg.norm(seen[:, None] - seen, axis=2)[sure]
    grow = float(np.median(seen_apart / told_apart))
    return seen[:, None] + grow * (corners - seen[:, None])


def predicted(
    point: np.ndarray, markers: Markers, squares: np.ndarray, spacing: float
) -> np.ndarray | None:
    """Where (2,) px the markers around say that a point of the board is; None if none is next to
    it.

    Args:
        point: (2,) [m]; squares and spacing as for `in_agreement`.
    """
    places = squares[markers.ids]
    apart = np.linalg.norm(places.mean(axis=1) - point, axis=1) / spacing
    if not np.any(apart < 1):
        return None
    near = apart < 1.6  # those next to the point, and the next ones around
    plane, seen = places[near].reshape(-1, 2), markers.corners[near].reshape(-1, 2)
    homography, _ = cv2.findHomography(plane, seen)
    if homography is None:
        return None
    return _project(homography, point)[0]


def _project(homography: np.ndarray, plane: np.ndarray) -> np.ndarray:
    points = plane.reshape(-1, 1, 2).astype(np.float64)
    return cv2.perspectiveTransform(points, homography).reshape(-1, 2)


def _view_of(square: np.ndarray, seen: np.ndarray) -> np.ndarray:
    return cv2.getPerspectiveTransform(square.astype(np.float32), seen.astype(np.float32))
