"""The inner loops of stage 1: what one observation says about each cell of a local map.

A stereo range has a doubt that grows with its square. An obstacle is therefore *possible* in all
cells within HIT_WITHIN sigmas of its range; free space ends FREE_BEFORE sigmas before it. Left at
that, far walls would come out thick: `thin` keeps the likeliest cells along the line of sight.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

HIT_WITHIN = 1.5
FREE_BEFORE = 2.0
# Standard deviation of a hit's place within its cell, as a share of the cell (uniform: 0.29).
WITHIN_CELL = 0.29
# Likeliness is compared this many cells to both sides along the line of sight.
THIN_REACH = 3


@njit(cache=True, nogil=True)
def add_observation(
    grid,
    likely,
    x0,
    y0,
    cell,
    sensor,
    bearing,
    ranges,
    sigma,
    max_range,
    occupied_step,
    free_step,
    clamp,
):
    """Add one scan to log-odds `grid` (H, W) in place; NaN cells start from P = 0.5.

    likely (H, W): summed probability density [1/m] that the obstacle stands in the cell.
    sensor: (3,) pose of the sensor in the grid's frame. Every cell looks up the beams that
    cross it (no gaps between neighbouring beams) and is updated once: occupied beats free.
    """
    sx, sy, theta = sensor
    reach = 0.0
    for i in range(ranges.size):
        if ranges[i] == np.inf:
            reach = max(reach, max_range)
        elif ranges[i] == ranges[i]:
            reach = max(reach, ranges[i] + 3.0 * sigma[i] + cell)
    c, s = math.cos(theta), math.sin(theta)
    rows, columns = grid.shape
    first_row = max(0, int((sy - reach - y0) / cell))
    last_row = min(rows, int((sy + reach - y0) / cell) + 1)
    first_column = max(0, int((sx - reach - x0) / cell))
    last_column = min(columns, int((sx + reach - x0) / cell) + 1)
    n = bearing.size
    half_gap = 0.5 * (bearing[n - 1] - bearing[0]) / max(n - 1, 1)
    for row in range(first_row, last_row):
        dy = y0 + (row + 0.5) * cell - sy
        for column in range(first_column, last_column):
            dx = x0 + (column + 0.5) * cell - sx
            r = math.hypot(dx, dy)
            if r > reach:
                continue
            ahead, left = c * dx + s * dy, -s * dx + c * dy
            angle = math.atan2(left, ahead)
            width = max(math.atan2(0.5 * cell, r), half_gap)
            if angle + width < bearing[0] or angle - width > bearing[n - 1]:
                continue
            evidence, density = _cell_evidence(
                angle, width, r, cell, bearing, ranges, sigma, max_range, occupied_step, free_step
            )
            likely[row, column] += density
            if evidence != 0.0:
                value = grid[row, column]
                if value != value:
                    value = 0.0
                grid[row, column] = min(max(value + evidence, -clamp), clamp)


@njit(cache=True, nogil=True)
def _cell_evidence(
    angle, width, r, cell, bearing, ranges, sigma, max_range, occupied_step, free_step
):
    """What the beams within `width` of `angle` say of a cell at distance r.

    Its step of log-odds (0: nothing) and the mean density [1/m] of an obstacle there.
    """
    hits, free, beams, density = 0, 0, 0, 0.0
    for i in range(np.searchsorted(bearing, angle - width), bearing.size):
        if bearing[i] > angle + width:
            break
        beams += 1
        z = ranges[i]
        if z != z:
            continue
        if z == np.inf:
            if r < max_range:
                free += 1
            continue
        off = abs(r - z)
        doubt = math.hypot(sigma[i], WITHIN_CELL * cell)
        if off < 3.0 * doubt:
            density += math.exp(-0.5 * (off / doubt) ** 2) / doubt
        if off < max(0.5 * cell, HIT_WITHIN * sigma[i]):
            hits += 1
        elif r < z - max(FREE_BEFORE * sigma[i], 0.5 * cell):
            free += 1
    if beams > 0:
        density /= beams
    if hits > 0:
        return occupied_step, density
    if 2 * free > beams:
        return free_step, density
    return 0.0, density


@njit(cache=True, nogil=True)
def thin(grid, likely, x0, y0, cell, eye_x, eye_y, above):
    """Set possible cells (log-odds > above) that are not the likeliest along their line of sight
    to undecided (log-odds 0); returns a new grid (H, W).

    eye_x, eye_y: where the cells are looked at from. Of the cells along a line of sight only one
    is hit first (non-maximum suppression, Canny 1986).
    """
    rows, columns = grid.shape
    thinned = grid.copy()
    for row in range(rows):
        dy = y0 + (row + 0.5) * cell - eye_y
        for column in range(columns):
            if not grid[row, column] > above:
                continue
            dx = x0 + (column + 0.5) * cell - eye_x
            r = max(math.hypot(dx, dy), cell)
            for step in range(-THIN_REACH, THIN_REACH + 1):
                i, j = round(row + step * dy / r), round(column + step * dx / r)
                if 0 <= i < rows and 0 <= j < columns and likely[i, j] > likely[row, column]:
                    thinned[row, column] = 0.0
                    break
    return thinned
