"""How far a map is from the ideal one: dissimilarity E, its cut variant, obstacle cells.

Cells that are unknown in the generated map cost nothing in E, which alone can therefore be
gamed: it is to be read together with the recall of obstacle cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation

from mapping.grid import OccupancyGrid
from pipeline.dissimilarity import known_cells, least_dissimilarity
from pipeline.errors import InputError
from pipeline.map_files import read_map

# Above and below these a cell counts as decided (the paper's Sec. III).
OCCUPIED, FREE = 0.7, 0.2
OBSTACLE = 0.65


@dataclass(frozen=True)
class MapScore:
    """E of eq. (9) and what stands beside it.

    E_cut: E of both maps cut at 0.7 / 0.2 to 1 and 0, undecided cells unknown, with a motion of
    its own. decided: share of the known cells that are decided. overlap: share of the known
    cells that the ideal map knows. precision, recall, f1: of obstacle cells within one cell.
    motion: (x m, y m, turn rad about the middle of the known cells) that gives E.
    """

    E: float
    E_cut: float
    known: int
    decided: float
    overlap: float
    precision: float
    recall: float
    f1: float
    motion: tuple[float, float, float]


def evaluate_map_files(generated: str | Path, ideal: str | Path) -> MapScore:
    """Compare two maps in files or result folders.

    Raises:
        InputError: a map cannot be read or knows no cell.
    """
    grids = []
    for path in (generated, ideal):
        grid = read_map(path)
        if np.isnan(grid.probability).all():
            raise InputError(f"{path}: every cell of this map is unknown: nothing to compare")
        grids.append(grid)
    return evaluate_map(grids[0], grids[1])


def evaluate_map(generated: OccupancyGrid, ideal: OccupancyGrid) -> MapScore:
    """Compare a map with the ideal one; both must know at least one cell."""
    E, motion = least_dissimilarity(generated, ideal)
    cut_generated, cut_ideal = cut(generated), cut(ideal)
    known = int(np.count_nonzero(~np.isnan(generated.probability)))
    decided = int(np.count_nonzero(~np.isnan(cut_generated.probability)))
    E_cut = least_dissimilarity(cut_generated, cut_ideal)[0] if decided else 0.0
    precision, recall = obstacle_rates(generated, ideal, motion)
    return MapScore(
        E=E,
        E_cut=E_cut,
        known=known,
        decided=decided / known,
        overlap=overlap(generated, ideal, motion),
        precision=precision,
        recall=recall,
        f1=_f1(precision, recall),
        motion=(float(motion[0]), float(motion[1]), float(motion[2])),
    )


def cut(grid: OccupancyGrid) -> OccupancyGrid:
    """1 above 0.7, 0 below 0.2, unknown between."""
    p = grid.probability
    decided = np.where(p > OCCUPIED, 1.0, np.where(p < FREE, 0.0, np.nan))
    return replace(grid, probability=decided.astype(np.float32))


def obstacle_rates(
    generated: OccupancyGrid, ideal: OccupancyGrid, motion: np.ndarray
) -> tuple[float, float]:
    """Precision and recall of obstacle cells, after the motion of the generated map.

    Precision: generated obstacle cells with an ideal one within one cell (the larger of the
    two maps' cells, diagonals included). Recall: ideal ones with a generated one so near.
    NaN where there is no such cell to count.
    """
    radius = max(generated.cell, ideal.cell)
    cells = known_cells(generated)
    is_obstacle = cells.probability > OBSTACLE
    x, y = (values[is_obstacle] for values in cells.moved(motion))
    precision = _share(_sample(_grown(ideal, radius), ideal, x, y))

    rows, columns = np.nonzero(ideal.probability > OBSTACLE)
    x = ideal.origin[0] + (columns + 0.5) * ideal.cell - cells.centre[0] - motion[0]
    y = ideal.origin[1] + (rows + 0.5) * ideal.cell - cells.centre[1] - motion[1]
    c, s = math.cos(motion[2]), math.sin(motion[2])
    x, y = cells.centre[0] + c * x + s * y, cells.centre[1] - s * x + c * y
    recall = _share(_sample(_grown(generated, radius), generated, x, y))
    return precision, recall


def overlap(generated: OccupancyGrid, ideal: OccupancyGrid, motion: np.ndarray) -> float:
    """Share of the generated map's known cells that the ideal map knows."""
    x, y = known_cells(generated).moved(motion)
    return _share(_sample(~np.isnan(ideal.probability), ideal, x, y))


def _grown(grid: OccupancyGrid, radius: float) -> np.ndarray:
    """(H, W) bool: an obstacle cell within the radius [m], in columns and in rows."""
    reach = max(1, round(radius / grid.cell))
    square = np.ones((2 * reach + 1, 2 * reach + 1), bool)
    return binary_dilation(grid.probability > OBSTACLE, square)


def _sample(mask: np.ndarray, grid: OccupancyGrid, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Values (n,) of a mask (H, W) of that grid at points [m]; false outside."""
    columns = np.floor((x - grid.origin[0]) / grid.cell).astype(int)
    rows = np.floor((y - grid.origin[1]) / grid.cell).astype(int)
    height, width = mask.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    values = np.zeros(len(x), bool)
    values[inside] = mask[rows[inside], columns[inside]]
    return values


def _share(hits: np.ndarray) -> float:
    return float(hits.mean()) if len(hits) else math.nan


def _f1(precision: float, recall: float) -> float:
    if math.isnan(precision) or math.isnan(recall):
        return math.nan
    return 2.0 * precision * recall / (precision + recall) if precision + recall else 0.0
