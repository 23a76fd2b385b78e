"""The inner loops of stage 2: matching and updating the particles' maps by a local map.

Both visit global cells and look up the local cell under their centre (inverse mapping): no
holes, no cell twice. Particles are independent, so the result does not depend on the threads.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from mapping.tiles import NO_TILE, TILE, UNKNOWN

# Bits of a local map's cell.
OBSERVED, OCCUPIED, FREE, NEAR_OCCUPIED, POSSIBLE = 1, 2, 4, 8, 16


@njit(cache=True, nogil=True)
def _local_cells(pose, row, column, cell, x0, y0):
    """Local cell coordinates of a tile's first cell centre, and their steps along x and y."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx = (column * TILE + 0.5) * cell - pose[0]
    dy = (row * TILE + 0.5) * cell - pose[1]
    u = (c * dx + s * dy - x0) / cell
    v = (-s * dx + c * dy - y0) / cell
    return u, v, c, s


@njit(cache=True, nogil=True)
def _outside(u, v, c, s, shape):
    """Whether a tile whose first cell lies at (u, v) misses the local map altogether."""
    u1, v1 = u + c * (TILE - 1), v - s * (TILE - 1)
    u2, v2 = u + s * (TILE - 1), v + c * (TILE - 1)
    u3, v3 = u1 + s * (TILE - 1), v1 + c * (TILE - 1)
    return (
        max(u, u1, u2, u3) < 0.0
        or max(v, v1, v2, v3) < 0.0
        or min(u, u1, u2, u3) >= shape[1]
        or min(v, v1, v2, v3) >= shape[0]
    )


@njit(cache=True, nogil=True, parallel=True)
def match(tiles, table, corner, poses, local, x0, y0, cell, threshold):
    """|S| and n of eq (8) for every particle, (N,) int64 and float64.

    S: global obstacle cells (value > threshold) on a cell observed in the local map;
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
                u0, v0, c, s = _local_cells(
                    poses[k], row + corner[0], column + corner[1], cell, x0, y0
                )
                if _outside(u0, v0, c, s, local.shape):
                    continue
                tile = tiles[number]
                for i in range(TILE):
                    for j in range(TILE):
                        if tile[i, j] <= threshold:
                            continue
                        u = math.floor(u0 + c * j + s * i)
                        v = math.floor(v0 - s * j + c * i)
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


@njit(cache=True, nogil=True, parallel=True)
def touched(table, corner, poses, local, x0, y0, cell):
    """Which tiles (N, rows, columns) bool hold a cell that the local map has decided."""
    particles, rows, columns = table.shape
    result = np.zeros((particles, rows, columns), np.bool_)
    for k in prange(particles):
        for row in range(rows):
            for column in range(columns):
                u0, v0, c, s = _local_cells(
                    poses[k], row + corner[0], column + corner[1], cell, x0, y0
                )
                if not _outside(u0, v0, c, s, local.shape):
                    result[k, row, column] = _any_decided(local, u0, v0, c, s)
    return result


@njit(cache=True, nogil=True)
def _any_decided(local, u0, v0, c, s):
    for i in range(TILE):
        for j in range(TILE):
            u = math.floor(u0 + c * j + s * i)
            v = math.floor(v0 - s * j + c * i)
            if (
                0 <= u < local.shape[1]
                and 0 <= v < local.shape[0]
                and local[v, u] & (OCCUPIED | FREE)
            ):
                return True
    return False


@njit(cache=True, nogil=True, parallel=True)
def update(tiles, table, corner, needed, poses, local, x0, y0, cell, occupied_step, free_step):
    """Add eq (1) at the local map's obstacle cells and eq (2) at its free ones, in place."""
    particles, rows, columns = table.shape
    for k in prange(particles):
        for row in range(rows):
            for column in range(columns):
                if not needed[k, row, column]:
                    continue
                u0, v0, c, s = _local_cells(
                    poses[k], row + corner[0], column + corner[1], cell, x0, y0
                )
                tile = tiles[table[k, row, column]]
                for i in range(TILE):
                    for j in range(TILE):
                        u = math.floor(u0 + c * j + s * i)
                        v = math.floor(v0 - s * j + c * i)
                        if not (0 <= u < local.shape[1] and 0 <= v < local.shape[0]):
                            continue
                        bits = local[v, u]
                        if bits & OCCUPIED:
                            step = occupied_step
                        elif bits & FREE:
                            step = free_step
                        else:
                            continue
                        value = np.int64(tile[i, j])
                        if value == UNKNOWN:
                            value = 0
                        tile[i, j] = np.int8(min(max(value + step, -127), 127))
