"""P(O|E) and P(O|notE) of eqs (1) and (2), counted in cells as stage 1 of the mapper marks them.

One observation is drawn into an empty grid by stage 1 itself: a cell is then called occupied (a
hit, spread over the doubt of its range), free (a beam passes through it), or nothing is said of
it. The true ranges are drawn in the same way, without doubt: cells that hold the nearest obstacle
of a beam (E), and cells that beams cross before it (notE). Of these, and only where the
observation says something of the cell:

    P(O|E)    = share of the obstacle cells that are called occupied
    P(O|notE) = share of the free cells that are called occupied

These are the probabilities with which eqs (1), (2) multiply: they count per cell, not per column,
and what stands behind the nearest obstacle is not asked. Every frame is drawn from another place
within a cell and in another direction, or walls along the grid would be counted by chance.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mapping.local_map import draw
from mapping.sensor_model import SensorModel
from stereo.scan import RangeScan

BIN = 1.0  # m
# Occupied and free cells come out of stage 1 as +1 and -1.
MARKS = SensorModel(1.0, -1.0, 0.5, 0.5, -0.5)
# Steps that never come near to repeating themselves (golden section, and its kin in the plane).
STEP_X, STEP_Y, STEP_TURN = 0.7549, 0.5698, 2.399963

# Of the counts: obstacle cells called occupied, obstacle cells of which something is said, and
# the same of free cells.
HIT, TOLD, FALSE_HIT, TOLD_FREE = range(4)


def range_bins(max_range: float) -> np.ndarray:
    """Edges (k + 1,) of the bins of range [m]."""
    return BIN * np.arange(math.ceil(max_range / BIN - 1e-9) + 1)


def count_cells(
    scan: RangeScan, truth: np.ndarray, cell: float, spread: bool, frame: int
) -> np.ndarray:
    """Counts (4, k) of one frame by bin of the cell's distance; truth: (b,) m as `RangeScan.range`.

    spread: as the setting `mapping.spread`.
    """
    edges = range_bins(scan.max_range)
    said, measured_at = _drawn(scan if spread else _exact(scan, scan.range), cell, frame)
    capped = np.where(truth > scan.max_range, np.inf, truth)
    true, true_at = _drawn(_exact(scan, capped), cell, frame)
    rows, columns = np.nonzero(~np.isnan(true))
    kind = true[rows, columns]
    i, j = rows + (true_at[1] - measured_at[1]), columns + (true_at[0] - measured_at[0])
    inside = (i >= 0) & (j >= 0) & (i < said.shape[0]) & (j < said.shape[1])
    called = np.full(len(rows), np.nan)
    called[inside] = said[i[inside], j[inside]]
    x, y, _ = _sensor(cell, frame)
    distance = np.hypot(
        (columns + true_at[0] + 0.5) * cell - x, (rows + true_at[1] + 0.5) * cell - y
    )
    told = ~np.isnan(called)
    masks = {
        HIT: (kind > 0) & (called > 0),
        TOLD: (kind > 0) & told,
        FALSE_HIT: (kind < 0) & (called > 0),
        TOLD_FREE: (kind < 0) & told,
    }
    return np.stack([np.histogram(distance[masks[n]], edges)[0] for n in range(4)])


def _exact(scan: RangeScan, ranges: np.ndarray) -> RangeScan:
    return replace(scan, range=ranges, sigma=np.where(np.isfinite(ranges), 0.0, np.nan))


def _sensor(cell: float, frame: int) -> tuple[float, float, float]:
    """Where the frame is drawn from: (x m, y m, heading rad) in the grid."""
    x, y = math.modf(frame * STEP_X)[0] * cell, math.modf(frame * STEP_Y)[0] * cell
    return x, y, math.remainder(frame * STEP_TURN, math.tau)


def _drawn(scan: RangeScan, cell: float, frame: int) -> tuple[np.ndarray, tuple[int, int]]:
    """Marks (H, W) of stage 1 (+1, -1 or NaN), and the number (column, row) of cell [0, 0]."""
    marks, _, (x, y) = draw([scan], np.array([_sensor(cell, frame)]), cell, MARKS)
    # What is doubtful without being marked has no value either.
    return np.where(marks == 0.0, np.nan, marks), (round(x / cell), round(y / cell))
