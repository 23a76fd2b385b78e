"""OccupancyGrid: the map that leaves the mapper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class OccupancyGrid:
    """probability: (H, W) float32, row 0 = lowest y, NaN = unknown; origin: (x, y) of the
    lower-left corner of cell [0, 0] [m]; cell: side of a cell [m]."""

    probability: np.ndarray
    origin: tuple[float, float]
    cell: float

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
