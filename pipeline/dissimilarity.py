"""Dissimilarity of a map to the ideal one, minimised over a rigid motion.

Source: Sec. IV-B, eqs. (9) and (10), of "A Hierarchical SLAM for Uncertain Range Data" (2010).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from mapping.grid import OccupancyGrid

UNKNOWN = -1.0
COST_WHERE_IDEAL_IS_UNKNOWN = 0.1

RANGE_M = 0.5
RANGE_RAD = math.radians(5.0)

# The coarse search looks at a sample of the cells; its best poses are refined on all of them.
# Steps end when they are finer than this share of a cell of the ideal map.
SAMPLE = 4000
SHORTLIST = 20
REFINED = 2
MOST_STEPS = 10
FINEST = 0.05


@dataclass(frozen=True)
class KnownCells:
    """The cells of a map that hold information, about their mean position.

    x, y: (n,) m from `centre` (2,) m; probability: (n,).
    """

    x: np.ndarray
    y: np.ndarray
    probability: np.ndarray
    centre: np.ndarray

    def moved(self, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x and y [m] in the world after the motion (dx m, dy m, turn rad about the centre)."""
        c, s = math.cos(motion[2]), math.sin(motion[2])
        x = self.centre[0] + motion[0] + c * self.x - s * self.y
        y = self.centre[1] + motion[1] + s * self.x + c * self.y
        return x, y


def known_cells(grid: OccupancyGrid) -> KnownCells:
    """The known cells of a map, row by row; at least one must be known."""
    rows, columns = np.nonzero(~np.isnan(grid.probability))
    x = grid.origin[0] + (columns + 0.5) * grid.cell
    y = grid.origin[1] + (rows + 0.5) * grid.cell
    centre = np.array([x.mean(), y.mean()])
    values = grid.probability[rows, columns].astype(float)
    return KnownCells(x - centre[0], y - centre[1], values, centre)


def least_dissimilarity(generated: OccupancyGrid, ideal: OccupancyGrid) -> tuple[float, np.ndarray]:
    """E of eq. (9), least over motions of the generated map, and that motion.

    The motion (dx m, dy m, turn rad about the mean of the known cells) is searched within
    +-0.5 m and +-5 deg, first on a lattice of about one cell, then around its best poses in
    halving steps. Each cell of the generated map is compared with the ideal's cell in which
    its centre falls, so that cell sizes and origins may differ.
    """
    cells = known_cells(generated)
    # A stride over the rows' cells: the same sample every time.
    stride = max(1, len(cells.x) // SAMPLE)
    sample = KnownCells(
        cells.x[::stride], cells.y[::stride], cells.probability[::stride], cells.centre
    )
    reach = max(float(np.sqrt(np.mean(cells.x**2 + cells.y**2))), generated.cell)
    step = min(generated.cell, ideal.cell)
    counts = [_steps(RANGE_M, step), _steps(RANGE_M, step), _steps(RANGE_RAD, step / reach)]
    lattice = _lattice(counts)
    order = np.argsort(dissimilarities(sample, ideal, lattice), kind="stable")
    # No motion at all is always on the list: the least E is never above the E as it stands.
    shortlist = np.concatenate([np.zeros((1, 3)), lattice[order[:SHORTLIST]]])
    best = np.argsort(dissimilarities(cells, ideal, shortlist), kind="stable")[:REFINED]
    width = np.array([RANGE_M, RANGE_M, RANGE_RAD]) / counts
    found = [_refine(cells, ideal, shortlist[k], width) for k in best]
    return min(found, key=lambda cost_and_motion: cost_and_motion[0])


def dissimilarities(cells: KnownCells, ideal: OccupancyGrid, motions: np.ndarray) -> np.ndarray:
    """E of eq. (9) for every motion (m, 3): (m,)."""
    t = np.where(np.isnan(ideal.probability), UNKNOWN, ideal.probability).astype(np.float32)
    return _dissimilarities(
        cells.x / ideal.cell,
        cells.y / ideal.cell,
        cells.probability,
        t,
        (cells.centre - ideal.origin) / ideal.cell,
        motions / np.array([ideal.cell, ideal.cell, 1.0]),
    )


def _refine(
    cells: KnownCells, ideal: OccupancyGrid, motion: np.ndarray, width: np.ndarray
) -> tuple[float, np.ndarray]:
    """Best of the 26 neighbours again and again, with halving steps down to `FINEST` of a cell."""
    neighbours = _lattice([1, 1, 1]) / np.array([RANGE_M, RANGE_M, RANGE_RAD])
    limit = np.array([RANGE_M, RANGE_M, RANGE_RAD])
    best = float(dissimilarities(cells, ideal, motion[None])[0])
    while width[0] > FINEST * ideal.cell:
        width = width / 2.0
        tried = np.clip(motion + neighbours * width, -limit, limit)
        costs = dissimilarities(cells, ideal, tried)
        if costs.min() < best:
            best, motion = float(costs.min()), tried[int(np.argmin(costs))]
    return best, motion


def _steps(limit: float, step: float) -> int:
    """Lattice steps on either side of zero."""
    return min(max(math.ceil(limit / step), 1), MOST_STEPS)


def _lattice(counts: list[int]) -> np.ndarray:
    """(m, 3) motions that fill the range with 2 n + 1 values on each axis."""
    axes = [
        np.linspace(-limit, limit, 2 * n + 1)
        for limit, n in zip((RANGE_M, RANGE_M, RANGE_RAD), counts, strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


@njit(cache=True, nogil=True)
def _dissimilarities(u, v, g, t, centre, motions):
    """Eqs. (9), (10); lengths in cells of the ideal map, -1 = unknown."""
    height, width = t.shape
    costs = np.zeros(len(motions))
    for m in range(len(motions)):
        c, s = math.cos(motions[m, 2]), math.sin(motions[m, 2])
        x0, y0 = centre[0] + motions[m, 0], centre[1] + motions[m, 1]
        cost = 0.0
        for k in range(len(g)):
            x = x0 + c * u[k] - s * v[k]
            y = y0 + s * u[k] + c * v[k]
            if 0.0 <= x < width and 0.0 <= y < height:
                ideal = t[np.uint32(y), np.uint32(x)]
                cost += abs(g[k] - ideal) if ideal != UNKNOWN else COST_WHERE_IDEAL_IS_UNKNOWN
            else:
                cost += COST_WHERE_IDEAL_IS_UNKNOWN
        costs[m] = cost
    return costs
