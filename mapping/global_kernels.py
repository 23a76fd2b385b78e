"""The inner loops of stage 2: matching and updating the particles' maps by a local map.

Both visit global cells and look up the local cell under their centre (inverse mapping): no
holes, no cell twice. Particles are independent, so the result does not depend on the threads.

Cell coordinates run in fixed point: a whole row of a tile costs one multiplication.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from mapping.tiles import NO_TILE, TILE, UNKNOWN

# Bits of a local map's cell.
OBSERVED, OCCUPIED, FREE, NEAR_OCCUPIED, POSSIBLE = 1, 2, 4, 8, 16

# Tiles are visited in square blocks, most of which the local map does not reach. A block's
# cells lie within AROUND cells of the one under its centre, however it is turned: a local map
# with MARGIN undecided cells on all sides holds every block that may have a decided one.
BLOCK = 8
AROUND = 6
MARGIN = 2 * AROUND
_ONE = 1 << 32

# The number of a single set bit among 32 (Leiserson, Prokop and Randall 1998).
_DE_BRUIJN = 0x077CB531
_BIT_NUMBER = np.zeros(32, np.int64)
_BIT_NUMBER[[((_DE_BRUIJN << n) & 0xFFFFFFFF) >> 27 for n in range(32)]] = np.arange(32)


@njit(cache=True, nogil=True)
def _placed(pose, row, column, cell, x0, y0):
    """Fixed-point local cell coordinates of a tile's first cell centre, and cos, sin."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx = (column * TILE + 0.5) * cell - pose[0]
    dy = (row * TILE + 0.5) * cell - pose[1]
    u = (c * dx + s * dy - x0) / cell
    v = (-s * dx + c * dy - y0) / cell
    return (
        np.int64(math.floor(u * _ONE)),
        np.int64(math.floor(v * _ONE)),
        np.int64(math.floor(c * _ONE)),
        np.int64(math.floor(s * _ONE)),
    )


@njit(cache=True, nogil=True)
def _outside(u, v, c, s, shape):
    """Whether a tile whose first cell lies at (u, v) misses the local map altogether."""
    u1, v1 = u + c * (TILE - 1), v - s * (TILE - 1)
    u2, v2 = u + s * (TILE - 1), v + c * (TILE - 1)
    u3, v3 = u1 + s * (TILE - 1), v1 + c * (TILE - 1)
    return (
        max(u, u1, u2, u3) < 0
        or max(v, v1, v2, v3) < 0
        or min(u, u1, u2, u3) >= shape[1] * _ONE
        or min(v, v1, v2, v3) >= shape[0] * _ONE
    )


@njit(cache=True, nogil=True, parallel=True)
def match(obstacles, table, corner, poses, local, x0, y0, cell):
    """|S| and n of eq (8) for every particle, (N,) int64 and float64.

    S: global obstacle cells (set bits of `obstacles`) on a cell observed in the local map;
    n: those of S on, or within the tolerance of, a local obstacle cell; those that are only
    within the doubt of one count half.
    """
    particles, rows, columns = table.shape
    overlap = np.zeros(particles, np.int64)
    matched = np.zeros(particles, np.float64)
    for k in prange(particles):
        seen, near, possible = 0, 0, 0
        for row in range(rows):
            for column in range(columns):
                number = table[k, row, column]
                if number == NO_TILE:
                    continue
                u0, v0, c, s = _placed(poses[k], row + corner[0], column + corner[1], cell, x0, y0)
                if _outside(u0, v0, c, s, local.shape):
                    continue
                for i in range(TILE):
                    left = np.int64(obstacles[number, i])
                    while left != 0:
                        lowest = left & -left
                        left ^= lowest
                        j = _BIT_NUMBER[((lowest * _DE_BRUIJN) & 0xFFFFFFFF) >> 27]
                        u = (u0 + c * j + s * i) >> 32
                        v = (v0 - s * j + c * i) >> 32
                        if 0 <= u < local.shape[1] and 0 <= v < local.shape[0]:
                            bits = local[v, u]
                            if bits & OBSERVED:
                                seen += 1
                                if bits & NEAR_OCCUPIED:
                                    near += 1
                                elif bits & POSSIBLE:
                                    possible += 1
        overlap[k] = seen
        matched[k] = near + 0.5 * possible
    return overlap, matched


@njit(cache=True, nogil=True)
def _reached(near, u0, v0, c, s, i, j):
    """Whether the block that begins at cell (i, j) of a tile may hold a decided cell."""
    half = BLOCK // 2
    u = (u0 + c * (j + half) + s * (i + half)) >> 32
    v = (v0 - s * (j + half) + c * (i + half)) >> 32
    return 0 <= u < near.shape[1] and 0 <= v < near.shape[0] and near[v, u] != 0


@njit(cache=True, nogil=True, parallel=True)
def touched(table, corner, poses, local, near, x0, y0, cell):
    """Which tiles (N, rows, columns) bool hold a cell that the local map has decided.

    near (H, W): not zero within AROUND cells of a decided one; the local map must have MARGIN
    undecided cells on all sides.
    """
    particles, rows, columns = table.shape
    result = np.zeros((particles, rows, columns), np.bool_)
    for k in prange(particles):
        for row in range(rows):
            for column in range(columns):
                u0, v0, c, s = _placed(poses[k], row + corner[0], column + corner[1], cell, x0, y0)
                if not _outside(u0, v0, c, s, local.shape):
                    result[k, row, column] = _any_decided(local, near, u0, v0, c, s)
    return result


@njit(cache=True, nogil=True)
def _any_decided(local, near, u0, v0, c, s):
    for i0 in range(0, TILE, BLOCK):
        for j0 in range(0, TILE, BLOCK):
            if not _reached(near, u0, v0, c, s, i0, j0):
                continue
            for i in range(i0, i0 + BLOCK):
                for j in range(j0, j0 + BLOCK):
                    u = (u0 + c * j + s * i) >> 32
                    v = (v0 - s * j + c * i) >> 32
                    if (
                        0 <= u < local.shape[1]
                        and 0 <= v < local.shape[0]
                        and local[v, u] & (OCCUPIED | FREE)
                    ):
                        return True
    return False


@njit(cache=True, nogil=True, parallel=True)
def update(
    tiles,
    obstacles,
    table,
    corner,
    needed,
    poses,
    local,
    near,
    x0,
    y0,
    cell,
    occupied_step,
    free_step,
    threshold,
):
    """Add eq (1) at the local map's obstacle cells and eq (2) at its free ones, in place.

    A cell above the threshold is an obstacle: its bit is set in `obstacles`.
    """
    particles, rows, columns = table.shape
    steps = np.zeros(local.shape, np.int16)
    for v in range(local.shape[0]):
        for u in range(local.shape[1]):
            if local[v, u] & OCCUPIED:
                steps[v, u] = occupied_step
            elif local[v, u] & FREE:
                steps[v, u] = free_step
    for k in prange(particles):
        for row in range(rows):
            for column in range(columns):
                if not needed[k, row, column]:
                    continue
                u0, v0, c, s = _placed(poses[k], row + corner[0], column + corner[1], cell, x0, y0)
                number = table[k, row, column]
                tile, marks = tiles[number], obstacles[number]
                for i0 in range(0, TILE, BLOCK):
                    for j0 in range(0, TILE, BLOCK):
                        if _reached(near, u0, v0, c, s, i0, j0):
                            _update_block(tile, marks, steps, u0, v0, c, s, i0, j0, threshold)


@njit(cache=True, nogil=True)
def _update_block(tile, marks, steps, u0, v0, c, s, i0, j0, threshold):
    """A block within reach lies inside the local map: its margin is wide enough."""
    for i in range(i0, i0 + BLOCK):
        u = u0 + c * j0 + s * i
        v = v0 - s * j0 + c * i
        mark = marks[i]
        for j in range(j0, j0 + BLOCK):
            step = np.int64(steps[np.uint64(v >> 32), np.uint64(u >> 32)])
            u += c
            v -= s
            if step == 0:
                continue
            value = np.int64(tile[i, j])
            if value == UNKNOWN:
                value = np.int64(0)
            value = min(max(value + step, -127), 127)
            tile[i, j] = np.int8(value)
            bit = np.uint32(1) << np.uint32(j)
            mark = mark | bit if value > threshold else mark & ~bit
        marks[i] = mark
