"""The inner loop of stage 1: what one observation says about each cell of a local map."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# Free space is claimed up to this many sigmas before a hit: nearer may be the obstacle itself.
FREE_BEFORE = 2.0


@njit(cache=True, nogil=True)
def add_observation(
    grid,
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
            evidence = _cell_evidence(
                angle, width, r, cell, bearing, ranges, sigma, max_range, occupied_step, free_step
            )
            if evidence != 0.0:
                value = grid[row, column]
                if value != value:
                    value = 0.0
                grid[row, column] = min(max(value + evidence, -clamp), clamp)


@njit(cache=True, nogil=True)
def _cell_evidence(
    angle, width, r, cell, bearing, ranges, sigma, max_range, occupied_step, free_step
):
    """Log-odds that the beams within `width` of `angle` add to a cell at distance r."""
    first = np.searchsorted(bearing, angle - width)
    hit, free, beams = 0.0, 0, 0
    for i in range(first, bearing.size):
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
        doubt = sigma[i]
        off = abs(r - z)
        # The obstacle's place is uncertain by sigma: the hit is spread over it.
        if off < max(0.5 * cell, 1.0 * doubt):
            hit = max(hit, spread(doubt, cell))
        elif r < z - max(FREE_BEFORE * doubt, 0.5 * cell):
            free += 1
    if hit > 0.0:
        return hit * occupied_step
    if 2 * free > beams:
        return free_step
    return 0.0


@njit(cache=True, nogil=True)
def spread(doubt, cell):
    """Weight of a hit whose place is uncertain by `doubt`."""
    return 1.0
