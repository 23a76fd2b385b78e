"""Corners spread over the image: what visual odometry follows from pair to pair.

Shi and Tomasi's measure (Good Features to Track, 1994): the smaller eigenvalue of the gradients'
covariance in a window. The best corners of each cell of a grid are taken, so that one poster does
not get them all: a motion is known well when its points stand all over the view.
"""

from __future__ import annotations

import cv2
import numpy as np

WINDOW = 5  # px, of the gradients
CELLS = 180  # of the grid, about as wide as high
PER_CELL = 3
# Less than this is noise of the sensor; as OpenCV scales it for images of 8 bits.
LEAST_CORNER = 2e-5
BORDER = 12  # px, where no window fits


def find_corners(image: np.ndarray) -> np.ndarray:
    """Corners (n, 2) float32, column and row [px], of an image uint8 (H, W); in order of cells."""
    strength = cv2.cornerMinEigenVal(image, WINDOW)
    peak = strength == cv2.dilate(strength, np.ones((WINDOW, WINDOW), np.uint8))
    peak &= strength > LEAST_CORNER
    peak[:BORDER] = peak[-BORDER:] = False
    peak[:, :BORDER] = peak[:, -BORDER:] = False
    v, u = np.nonzero(peak)
    height, width = image.shape
    side = max((height * width / CELLS) ** 0.5, 1.0)
    cell = (v / side).astype(int) * int(width / side + 1) + (u / side).astype(int)
    order = np.lexsort((-strength[v, u], cell))
    cell = cell[order]
    # How many of the same cell stand before each.
    rank = np.arange(len(cell)) - np.searchsorted(cell, cell)
    chosen = order[rank < PER_CELL]
    return np.column_stack([u[chosen], v[chosen]]).astype(np.float32)
