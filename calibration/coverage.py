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
    corners: name of a region -> number of corners found in it.
    regions: name of a region -> share of its area that at least one board covered.
    """

    boards: np.ndarray
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
    fine = np.array([columns * FINE, rows * FINE])
    scale = fine / np.asarray(image_size)
    covered = np.zeros((len(corners), fine[1], fine[0]), np.uint8)
    for drawing, seen in zip(covered, corners, strict=True):
        # Pixel centres are at integers, in the image and in the drawing.
        hull = cv2.convexHull(((np.asarray(seen) + 0.5) * scale - 0.5).astype(np.float32))
        cv2.fillConvexPoly(drawing, np.round(hull).astype(np.int32), 1)
    filled = covered.reshape(len(corners), rows, FINE, columns, FINE).mean(axis=(2, 4))
    any_board = covered.any(axis=0)
    everything = np.concatenate([np.asarray(seen) for seen in corners])
    return Coverage(
        boards=(filled >= 0.5).sum(axis=0),
        corners=_corners_by_region(everything, image_size),
        regions={
            name: float(part.mean())
            for names, band in zip(REGIONS, np.split(any_board, 3, axis=0), strict=True)
            for name, part in zip(names, np.split(band, 3, axis=1), strict=True)
        },
    )


def _by_share(region: tuple[str, float]) -> float:
    return region[1]


def _corners_by_region(corners: np.ndarray, image_size: tuple[int, int]) -> dict[str, int]:
    thirds = np.clip((corners + 0.5) * 3 // np.asarray(image_size), 0, 2).astype(int)
    return {
        name: int(np.count_nonzero((thirds == (column, row)).all(axis=1)))
        for row, names in enumerate(REGIONS)
        for column, name in enumerate(names)
    }
