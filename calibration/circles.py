"""Grids of circles: all of them or none. A circle's place is the centre of its dark area."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.board import Board

SMALLEST_DISC, LARGEST_DISC = 12.0, 0.02  # px; share of the image's area


def search_circles(image: np.ndarray, board: Board) -> np.ndarray | None:
    """The centres of the circles (m, 2) px by id, or None.

    Args:
        image: uint8 (H, W), dark circles on a light board or the reverse.
    """
    grid = cv2.CALIB_CB_SYMMETRIC_GRID
    if board.kind == "acircles":
        grid = cv2.CALIB_CB_ASYMMETRIC_GRID
    for picture in (image, 255 - image):
        # The second way stands strong perspective, the first one clutter around the board.
        for way in (0, cv2.CALIB_CB_CLUSTERING):
            found, centres = cv2.findCirclesGrid(
                picture, board.lattice, flags=grid | way, blobDetector=_discs(image)
            )
            if found and _fits(centres.reshape(-1, 2), board):
                return centres.reshape(-1, 2)
    return None


def _fits(centres: np.ndarray, board: Board) -> bool:
    """Whether the centres lie as on the board, seen from the front: other round things may be
    found in its place. A polynomial stands for the view and the bending of the lens."""
    x, y = (board.points[:, :2] - board.points[:, :2].mean(axis=0)).T / board.square
    degree = 3 if len(x) >= 20 else 2
    powers = [(a, b) for b in range(degree + 1) for a in range(degree + 1 - b)]
    terms = np.stack([x**a * y**b for a, b in powers], axis=1)
    bend = np.linalg.lstsq(terms, centres, rcond=None)[0]
    slopes = bend[[powers.index((1, 0)), powers.index((0, 1))]]
    first, second = board.neighbours[0]
    off = np.linalg.norm(terms @ bend - centres, axis=1)
    spacing = np.linalg.norm(centres[second] - centres[first])
    return bool(np.linalg.det(slopes) > 0 and off.max() < 0.25 * spacing)


def _discs(image: np.ndarray) -> cv2.SimpleBlobDetector:
    settings = cv2.SimpleBlobDetector.Params()
    settings.minArea = SMALLEST_DISC
    settings.maxArea = LARGEST_DISC * image.size
    settings.minDistBetweenBlobs = 5
    return cv2.SimpleBlobDetector.create(settings)


def refine_circles(image: np.ndarray, rough: np.ndarray, board: Board) -> np.ndarray:
    """The images of the circles' centres (m, 2) float64 px, from `rough` (m, 2) px by id.

    A blob's centre as OpenCV gives it is that of outlines of whole pixels, and of an ellipse: not
    where the circle's centre is seen. Here it is the centre of the dark area, weighed by grey
    values, measured on the board.

    Args:
        image: uint8 (H, W).
    """
    first, second = board.points[board.neighbours[0], :2]
    plane = board.points[:, :2] / np.linalg.norm(second - first)
    centres = rough
    for _ in range(2):
        centres = np.array([_centre(image, m, centres, plane) for m in range(len(plane))])
    return centres


def _centre(image: np.ndarray, m: int, centres: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """The centre px of circle m, from all centres (m, 2) px and their places on the board, where
    neighbours are 1 apart."""
    near = np.linalg.norm(plane - plane[m], axis=1) < 2.3
    homography, _ = cv2.findHomography(plane[near] - plane[m], centres[near])
    # The pixels nearer to this circle than to its neighbours, and where they are on the board.
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    outline = _through(homography, square)
    height, width = image.shape
    low = np.clip(np.floor(outline.min(axis=0)), 0, (width - 1, height - 1)).astype(int)
    high = np.clip(np.ceil(outline.max(axis=0)), 0, (width - 1, height - 1)).astype(int)
    v, u = np.mgrid[low[1] : high[1] + 1, low[0] : high[0] + 1]
    back = np.linalg.inv(homography)
    xy = _through(back, np.stack([u.ravel(), v.ravel()], axis=1))
    away = np.linalg.norm(xy, axis=1)
    inside = away < 0.5
    rim, middle = (away > 0.44) & inside, away < 0.1
    if not (rim.any() and middle.any()):
        return centres[m]
    grey = image[v, u].ravel().astype(float)
    paper, ink = grey[rim].mean(), grey[middle].mean()
    # How much of a pixel is ink, times the area that it covers on the board
    scale = np.abs(back[2, 0] * u.ravel() + back[2, 1] * v.ravel() + back[2, 2]) ** -3
    weight = (((paper - grey) / (paper - ink)) * scale)[inside] if paper != ink else np.zeros(1)
    if weight.sum() <= 0:
        return centres[m]
    return _through(homography, (weight @ xy[inside] / weight.sum())[None])[0]


def _through(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    return cv2.perspectiveTransform(points.reshape(-1, 1, 2).astype(float), homography)[:, 0]
