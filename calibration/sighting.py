"""What an image, and a pair of images, show of a board: corners with the board's own numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Sighting:
    """Corners of the board in one image.

    ids: (n,) int64, ascending: which of `Board.points` each corner is; corners: (n, 2) float64
    pixels of the raw image. A whole chessboard shows all ids, a ChArUco board perhaps some.
    """

    ids: np.ndarray
    corners: np.ndarray


@dataclass(frozen=True, eq=False)
class PairSighting:
    """The same standing board in both images of a pair; the two may show different corners."""

    left: Sighting
    right: Sighting

    def common(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """ids (n,) seen in both images, their corners (n, 2) in the left and in the right one."""
        ids, at_left, at_right = np.intersect1d(
            self.left.ids, self.right.ids, assume_unique=True, return_indices=True
        )
        return ids, self.left.corners[at_left], self.right.corners[at_right]
