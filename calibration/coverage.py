"""Which parts of an image the boards have covered: where they have not, the lens is a guess."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

CELLS = (9, 12)  # rows, columns: whole numbers of cells in each of the 3 x 3 named regions
FINE = 16  # sides of a cell in the drawing that tells how much of it a board covers
REGIONS = (
    ("upper left", "top", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "bottom", "lower right"),
)
POOR = 0.3  # a region with less than this share covered needs views


@dataclass(frozen=True, eq=False)
class Coverage:
    """Where the boards stood in one camera's images.

    boards: (9, 12) how many boards covered at least half of each cell of the image.
    covered: (144, 192) whether any board did, as finely as it is drawn.
    corners: name of a region -> number of corners found in it.
    regions: name of a region -> share of its area that at least one board covered.
    """

    boards: np.ndarray
    covered: np.ndarray
    corners: dict[str, int]
    regions: dict[str, float]

    @property
    def share(self) -> float:
        """Part of the image's area that at least one board covered."""
        return float(np.mean(list(self.regions.values())))

    @property
    def poor(self) -> list[str]:
        """Names of the regions that need views, the emptiest first."""
        return [name for name, share in sorted(self.regions.items(), key=_by_share) if share < POOR]


def coverage(image_size: tuple[int, int], corners: Sequence[np.ndarray]) -> Coverage:
    """Coverage of one camera's images.

    A board covers the convex hull of its corners: the lens is known between them, too.

    Args:
        image_size: (width, height) [px].
        corners: per view the (n, 2) pixels of its corners, n >= 3.
    """
    rows, columns = CELLS
    drawn = np.array([covered_by(image_size, seen) for seen in corners])
    filled = drawn.reshape(len(corners), rows, FINE, columns, FINE).mean(axis=(2, 4))
    covered = np.any(drawn, axis=0)
    everything = np.concatenate([np.asarray(seen) for seen in corners])
    return Coverage(
        boards=(filled >= 0.5).sum(axis=0),
        covered=covered,
        corners=_corners_by_region(everything, image_size),
        regions=region_shares(covered),
    )


def covered_by(image_size: tuple[int, int], corners: np.ndarray) -> np.ndarray:
    """Where a board with corners (n, 2) px covers an image: (144, 192) bool."""
    rows, columns = CELLS
    drawing = np.zeros((rows * FINE, columns * FINE), np.uint8)
    scale = np.array(drawing.shape[::-1]) / np.asarray(image_size)
    # Pixel centres are at integers, in the image and in the drawing.
    hull = cv2.convexHull(((np.asarray(corners) + 0.5) * scale - 0.5).astype(np.float32))
    cv2.fillConvexPoly(drawing, np.round(hull).astype(np.int32), 1)
    return drawing.astype(bool)


def region_shares(covered: np.ndarray) -> dict[str, float]:
    """Name of a region -> share of its area that is covered (144, 192)."""
    return {
        name: float(part.mean())
        for names, band in zip(REGIONS, np.split(covered, 3, axis=0), strict=True)
        for name, part in zip(names, np.split(band, 3, axis=1), strict=True)
    }


def _by_share(region: tuple[str, float]) -> float:
    return region[1]


def _corners_by_region(corners: np.ndarray, image_size: tuple[int, int]) -> dict[str, int]:
    thirds = np.clip((corners + 0.5) * 3 // np.asarray(image_size), 0, 2).astype(int)
    return {
        name: int(np.count_nonzero((thirds == (column, row)).all(axis=1)))
        for row, names in enumerate(REGIONS)
        for column, name in enumerate(names)
    }
