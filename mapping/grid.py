"""OccupancyGrid: the map that leaves the mapper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# A cell is an obstacle above the one and free below the other, 1 minus it: free cells are as sure
# as obstacles must be. One local map that has seen through a cell is enough by the usual settings
# (eq (2): p = 0.34), and no local map calls a cell free that fewer than three looks agree on.
OCCUPIED_ABOVE, FREE_BELOW = 0.65, 0.35
OCCUPIED, FREE, UNKNOWN = 100, 0, -1  # as in nav_msgs/OccupancyGrid


@dataclass(frozen=True)
class OccupancyGrid:
    """probability: (H, W) float32, row 0 = lowest y, NaN = unknown; origin: (x, y) of the
    lower-left corner of cell [0, 0] [m]; cell: side of a cell [m]."""

    probability: np.ndarray
    origin: tuple[float, float]
    cell: float

    @property
    def classes(self) -> np.ndarray:
        """(H, W) int8: OCCUPIED, FREE or UNKNOWN, which holds what is not decided, too.

        Every picture, file and message that shows a map shows these.
        """
        p = self.probability  # a comparison with NaN is false
        classes = np.full(p.shape, UNKNOWN, np.int8)
        classes[p > OCCUPIED_ABOVE] = OCCUPIED
        classes[p < FREE_BELOW] = FREE
        return classes

    def area(self, kind: int) -> float:
        """Of all cells of a class [m^2]."""
        return float(np.count_nonzero(self.classes == kind)) * self.cell**2

    def trimmed(self) -> OccupancyGrid:
        """Without the unknown margin (at least one cell remains)."""
        known = ~np.isnan(self.probability)
        rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        if not rows.size:
            return OccupancyGrid(np.full((1, 1), np.nan, np.float32), self.origin, self.cell)
        x, y = self.origin
        return OccupancyGrid(
            self.probability[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1],
            (float(x + columns[0] * self.cell), float(y + rows[0] * self.cell)),
            self.cell,
        )


def coarser(classes: np.ndarray, factor: int) -> np.ndarray:
    """Classes (H, W) of cells `factor` times as large, for pictures: an obstacle where there is one
    among them, so that thin walls stay; else free where one is."""
    rows, columns = (-side % factor for side in classes.shape)
    padded = np.pad(classes, ((0, rows), (0, columns)), constant_values=UNKNOWN)
    height, width = (side // factor for side in padded.shape)
    return padded.reshape(height, factor, width, factor).max(axis=(1, 3))
