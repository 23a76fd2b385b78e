"""Where the robot's body has been is free: the one place that a camera looking ahead never sees.

What the cameras say of such a cell, before or after, gives way: a range that ends there is wrong,
and what has been put there since is for the planner's obstacle layer to see. A run that begins in
the map learns it as any other change.
"""

from __future__ import annotations

import math

import numpy as np

from mapping.grid import OccupancyGrid
from mapping.sensor_model import CLAMP, probability

SUREST_FREE = np.float32(probability(np.array(-CLAMP)))
# Between two poses that lie so many times the usual interval apart the way is not known.
GAP = 5.0
SAMPLES = 4  # a cell, along the way


def with_footprint(
    grid: OccupancyGrid, path: np.ndarray, stamps: np.ndarray, radius: float
) -> OccupancyGrid:
    """The map, grown where needed, with all cells free that the body has covered.

    path: (n, 3) poses of its middle at stamps (n,) [ns]; radius: of the body [m]. Cells are covered
    when their middle lies within the radius of the way, and where the way itself crosses them.
    """
    if not len(path):
        return grid
    cell = grid.cell
    # Counted from the grid's origin in cells, thinned to what a quarter of a cell tells apart.
    points = (_along(path[:, :2], stamps, cell / SAMPLES) - grid.origin) / cell
    # Rounding errors of the path do not decide for a cell where it runs along a border.
    points = np.unique(np.floor(points * SAMPLES + 1e-6).astype(np.int64), axis=0)
    points = (points + 0.5) / SAMPLES
    reach = math.ceil(radius / cell)
    low = np.floor(points.min(axis=0)).astype(int) - reach
    high = np.floor(points.max(axis=0)).astype(int) + reach + 1
    height, width = grid.probability.shape
    left, bottom = np.maximum(-low, 0).tolist()
    right, top = np.maximum(high - (width, height), 0).tolist()
    p = np.pad(grid.probability, ((bottom, top), (left, right)), constant_values=np.nan)
    points += (left, bottom)
    here = np.floor(points).astype(np.int64)
    for row in range(-reach, reach + 1):
        for column in range(-reach, reach + 1):
            cells = here + np.array([column, row])
            within = np.hypot(*(cells + 0.5 - points).T) * cell <= radius
            covered = cells[within | (row == column == 0)]
            p[covered[:, 1], covered[:, 0]] = SUREST_FREE
    x, y = grid.origin
    return OccupancyGrid(p, (float(x - left * cell), float(y - bottom * cell)), cell).trimmed()


def _along(xy: np.ndarray, stamps: np.ndarray, step: float) -> np.ndarray:
    """Points (m, 2) of the way through xy (n, 2), no further apart than `step` [m]."""
    apart, seconds = np.hypot(*np.diff(xy, axis=0).T), np.diff(stamps) / 1e9
    known = seconds <= GAP * np.median(seconds) if len(seconds) else np.zeros(0, bool)
    copies = np.where(known, np.ceil(apart / step), 1).astype(np.int64)
    copies = np.append(np.maximum(copies, 1), 1)
    first = np.repeat(np.cumsum(copies) - copies, copies)
    share = (np.arange(copies.sum()) - first) / np.repeat(copies, copies)
    ahead = np.append(xy[1:], xy[-1:], axis=0)
    return np.repeat(xy, copies, axis=0) + share[:, None] * np.repeat(ahead - xy, copies, axis=0)
