"""The inner loops of stage 1: what a window of observations says about the cells around the robot.

Every beam walks through the cells it crosses (Amanatides and Woo 1987). A stereo range has a
doubt that grows with its square: an obstacle is *possible* in all cells within HIT_WITHIN sigmas
of the range, free space ends FREE_BEFORE sigmas before it. Left at that, far walls would come out
thick: `thin` keeps the likeliest cells along the line of sight.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

HIT_WITHIN = 1.5
FREE_BEFORE = 2.0
# Standard deviation of a hit's place within its cell, as a share of the cell (uniform: 0.29).
WITHIN_CELL = 0.29
# Neighbouring hits closer than this lie on one surface [m].
ONE_SURFACE = 0.25
# Likeliness is compared this many cells to both sides along the line of sight.
THIN_REACH = 3

# What one observation says of a cell; DOUBTFUL: neither free nor hit.
_FREE, _HIT, _DOUBTFUL = 1, 2, 3


@njit(cache=True, nogil=True)
def add_observations(
    grid,
    likely,
    x0,
    y0,
    cell,
    sensors,
    first,
    bearing,
    ranges,
    sigma,
    max_range,
    occupied_step,
    free_step,
    clamp,
):
    """Add observations to log-odds `grid` (H, W) in place; NaN cells start from P = 0.5.

    likely (H, W): summed probability density [1/m] that the obstacle stands in the cell.
    sensors: (m, 3) poses of the sensor in the grid's frame; beams first[k] to first[k + 1] of
    bearing, ranges, sigma belong to observation k, as does max_range[k]. A cell is updated at
    most once an observation: occupied beats free. The grid must hold all that the beams reach.
    """
    state = np.zeros(grid.shape, np.uint8)
    density = np.zeros(grid.shape, np.float32)
    beams = np.zeros(grid.shape, np.int32)
    seen = np.empty(grid.size, np.int64)
    columns = grid.shape[1]
    for k in range(len(sensors)):
        one = slice(first[k], first[k + 1])
        number = _observe(
            state,
            density,
            beams,
            seen,
            (sensors[k, 0] - x0) / cell,
            (sensors[k, 1] - y0) / cell,
            sensors[k, 2],
            cell,
            bearing[one],
            ranges[one],
            sigma[one],
            max_range[k],
        )
        for n in range(number):
            row, column = seen[n] // columns, seen[n] % columns
            if beams[row, column] > 0:
                likely[row, column] += density[row, column] / beams[row, column]
                density[row, column], beams[row, column] = 0.0, 0
            if state[row, column] == _HIT or state[row, column] == _FREE:
                step = occupied_step if state[row, column] == _HIT else free_step
                value = grid[row, column]
                if value != value:
                    value = np.float32(0.0)
                grid[row, column] = min(max(value + step, -clamp), clamp)
            state[row, column] = 0


@njit(cache=True, nogil=True)
def _observe(state, density, beams, seen, u0, v0, heading, cell, bearing, ranges, sigma, max_range):
    """Walk all beams of one observation from cell coordinates (u0, v0); the number of cells seen.

    Where beams lie further apart than a cell, the space between two of them is free up to the
    nearer of both, and two hits closer than ONE_SURFACE are joined by a wall: it must not be
    cleared by beams that pass it aslant, nor be drawn as a row of dots.
    """
    number = 0
    before = 0.0  # where the beam before ends; 0: it tells nothing
    free_before, hit_before = 0.0, False
    for i in range(bearing.size):
        z = ranges[i]
        if z != z:
            before, free_before, hit_before = 0.0, 0.0, False
            continue
        hit = z < np.inf
        end = z / cell if hit else max_range / cell
        doubt = sigma[i] / cell if hit else 0.0
        free = end - max(FREE_BEFORE * doubt, 0.5) if hit else end
        angle = heading + bearing[i]
        number = _walk(
            state, density, beams, seen, number, u0, v0, angle, 0.0, end, free, hit, doubt, cell
        )
        gap = bearing[i] - bearing[i - 1] if i > 0 else 0.0
        # Nearer than that the two beams themselves leave no gap.
        start = 0.9 / max(gap, 1e-9)
        apart = math.sqrt(end**2 + before**2 - 2.0 * end * before * math.cos(gap))
        wall = hit and hit_before and apart * cell < ONE_SURFACE
        copies = math.ceil((apart if wall else gap * min(free_before, free)) - 1e-9)
        for copy in range(1, copies):
            share = copy / copies
            if wall:
                # A point of the straight line from one hit to the other, seen from the sensor.
                ahead = (1.0 - share) * before + share * end * math.cos(gap)
                aside = share * end * math.sin(gap)
                until = math.hypot(ahead, aside)
                turned = gap - math.atan2(aside, ahead)
                clear = until - max(FREE_BEFORE * doubt, 0.5)
            else:
                until, turned = min(free_before, free), gap * (1.0 - share)
                clear = until
            at = angle - turned
            number = _walk(
                state,
                density,
                beams,
                seen,
                number,
                u0,
                v0,
                at,
                start,
                until,
                clear,
                wall,
                doubt,
                cell,
            )
        before, free_before, hit_before = end, free, hit
    return number


@njit(cache=True, nogil=True)
def _walk(
    state, density, beams, seen, number, u0, v0, angle, start, end, free_until, hit, doubt, cell
):
    """Walk one beam from `start` to `end`, where it hits or not; free up to `free_until`.

    Lengths are cells from (u0, v0). Marks in `state` what the beam says of its cells, sums its
    likeliness in `density` and `beams`, and appends cells not met before to `seen`; the number of
    those so far.
    """
    rows, columns = state.shape
    c, s = math.cos(angle), math.sin(angle)
    spread = math.hypot(doubt, WITHIN_CELL)
    far = end + max(HIT_WITHIN * doubt, 3.0 * spread) if hit else end
    u, v = u0 + start * c, v0 + start * s
    column, row = math.floor(u), math.floor(v)
    step_u, step_v = (1 if c > 0 else -1), (1 if s > 0 else -1)
    # Way along the beam from one border to the next, and to the first one.
    way_u = 1.0 / abs(c) if c != 0.0 else np.inf
    way_v = 1.0 / abs(s) if s != 0.0 else np.inf
    next_u = start + ((column + 1 - u) if c > 0 else (u - column)) * way_u if c != 0 else np.inf
    next_v = start + ((row + 1 - v) if s > 0 else (v - row)) * way_v if s != 0 else np.inf
    enter = start
    while enter < far:
        leave = min(next_u, next_v)
        if 0 <= row < rows and 0 <= column < columns:
            middle = 0.5 * (enter + min(leave, far))
            off = middle - end
            kind = 0
            if hit and (enter <= end < leave or abs(off) < HIT_WITHIN * doubt):
                kind = _HIT
            elif middle < free_until:
                kind = _FREE
            in_doubt = hit and (abs(off) < 3.0 * spread or kind == _HIT)
            if kind > 0 or in_doubt:
                old = state[row, column]
                if old == 0:
                    seen[number] = row * columns + column
                    number += 1
                    state[row, column] = kind if kind > 0 else _DOUBTFUL
                elif kind == _HIT or (kind == _FREE and old == _DOUBTFUL):
                    state[row, column] = kind
                if in_doubt:
                    scaled = off / spread
                    density[row, column] += math.exp(-0.5 * scaled * scaled) / (spread * cell)
                    beams[row, column] += 1
        enter = leave
        if next_u < next_v:
            column += step_u
            next_u += way_u
        else:
            row += step_v
            next_v += way_v
    return number


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
