"""The map of a run against an ideal one, wherever the map's frame has drifted to.

A run that turns astray in its first metres may draw a good map ten degrees askew, out of reach of
the search for the least E (half a metre, five degrees). The map is therefore compared twice: as it
stands, and carried by the motion that aligns its path with the true one; the better counts.
"""

from __future__ import annotations

import math

import numpy as np

from mapping.grid import OccupancyGrid
from odometry.motion import compose, inverse
from pipeline.dissimilarity import RANGE_M, RANGE_RAD, least_dissimilarity
from pipeline.evaluate_map import MapScore, evaluate_map


def frames(grid: OccupancyGrid, alignment: np.ndarray) -> list[OccupancyGrid]:
    """The map where it stands and, unless the search gets there, where `alignment` carries it.

    alignment: (3,) motion that carries the path closest to the true one.
    """
    near = _within_reach(grid, alignment)
    return [grid] if near else [grid, carried(grid, alignment)]


def best_score(places: list[OccupancyGrid], ideal: OccupancyGrid) -> MapScore:
    """The score of the place with the least E."""
    return min((evaluate_map(place, ideal) for place in places), key=lambda score: score.E)


def least_E(places: list[OccupancyGrid], ideal: OccupancyGrid) -> float:  # noqa: N802
    """The least E alone."""
    return min(least_dissimilarity(place, ideal)[0] for place in places)


def carried(grid: OccupancyGrid, motion: np.ndarray) -> OccupancyGrid:
    """The map after a motion (3,); every cell takes the value that its middle comes from."""
    height, width = grid.probability.shape
    corners = np.array([[0.0, 0, 0], [width, 0, 0], [0, height, 0], [width, height, 0]]) * grid.cell
    corners[:, :2] += grid.origin
    around = compose(motion, corners)[:, :2] / grid.cell
    low = np.floor(around.min(axis=0)).astype(int)
    columns, rows = np.ceil(around.max(axis=0)).astype(int) - low
    x, y = np.meshgrid(low[0] + np.arange(columns) + 0.5, low[1] + np.arange(rows) + 0.5)
    middles = grid.cell * np.stack([x, y, np.zeros_like(x)], axis=-1)
    from_cell = np.floor((compose(inverse(motion), middles)[..., :2] - grid.origin) / grid.cell)
    inside = ((from_cell >= 0) & (from_cell < (width, height))).all(axis=-1)
    column, row = from_cell[inside].astype(int).T
    probability = np.full(x.shape, np.nan, np.float32)
    probability[inside] = grid.probability[row, column]
    return OccupancyGrid(
        probability, (float(low[0] * grid.cell), float(low[1] * grid.cell)), grid.cell
    )


def _within_reach(grid: OccupancyGrid, motion: np.ndarray) -> bool:
    """Whether the search for the least E gets there with half its range to spare."""
    rows, columns = np.nonzero(~np.isnan(grid.probability))
    middle = np.array([columns.mean(), rows.mean()]) * grid.cell + grid.origin
    moved = compose(motion, np.append(middle, 0.0))[:2] - middle
    return math.hypot(*moved) < 0.5 * RANGE_M and abs(motion[2]) < 0.5 * RANGE_RAD
