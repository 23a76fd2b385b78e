"""The inner loops of the observation-improved proposal: a scan matched to each particle's map."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from mapping.tiles import NO_TILE, TILE, TILE_BITS


@njit(cache=True, nogil=True)
def _obstacle(tiles, table, row, column):
    """How sure a cell is to be an obstacle, 0 to 127; row and column count from the table's
    corner."""
    if row < 0 or column < 0:
        return 0
    i, j = row >> TILE_BITS, column >> TILE_BITS
    if i >= table.shape[0] or j >= table.shape[1]:
        return 0
    number = table[i, j]
    if number == NO_TILE:
        return 0
    return max(np.int64(tiles[number, row & (TILE - 1), column & (TILE - 1)]), 0)


@njit(cache=True, nogil=True)
def _between(tiles, table, row, column, a, b):
    """`_obstacle`, 0 to 1, at the share a of the way from a column to the next, b from a row."""
    i, j = row & (TILE - 1), column & (TILE - 1)
    if i == TILE - 1 or j == TILE - 1 or row < 0 or column < 0:
        low, right = (
            _obstacle(tiles, table, row, column),
            _obstacle(tiles, table, row, column + 1),
        )
        up, diagonal = (
            _obstacle(tiles, table, row + 1, column),
            _obstacle(tiles, table, row + 1, column + 1),
        )
    else:  # all four in one tile
        if row >> TILE_BITS >= table.shape[0] or column >> TILE_BITS >= table.shape[1]:
            return 0.0
        number = table[row >> TILE_BITS, column >> TILE_BITS]
        if number == NO_TILE:
            return 0.0
        tile = tiles[number]
        low, right = max(np.int64(tile[i, j]), 0), max(np.int64(tile[i, j + 1]), 0)
        up, diagonal = max(np.int64(tile[i + 1, j]), 0), max(np.int64(tile[i + 1, j + 1]), 0)
    if low + right + up + diagonal == 0:
        return 0.0
    return ((1.0 - b) * ((1.0 - a) * low + a * right) + b * ((1.0 - a) * up + a * diagonal)) / 127.0


@njit(cache=True, nogil=True)
def hit_score(tiles, table, corner, cell, points, gain, x, y, theta):
    """Sum over the hits (n, 2) of ln(1 + gain m), m: the map at the hit, between cell centres."""
    c, s = math.cos(theta) / cell, math.sin(theta) / cell
    u0, v0 = x / cell - 0.5 - corner[1] * TILE, y / cell - 0.5 - corner[0] * TILE
    total, product = 0.0, 1.0
    for i in range(points.shape[0]):
        u = u0 + c * points[i, 0] - s * points[i, 1]
        v = v0 + s * points[i, 0] + c * points[i, 1]
        column, row = math.floor(u), math.floor(v)
        product *= 1.0 + gain * _between(tiles, table, row, column, u - column, v - row)
        if product > 1e200:
            total += math.log(product)
            product = 1.0
    return total + math.log(product)


@njit(cache=True, nogil=True)
def _posterior(tiles, table, corner, cell, points, gain, kappa, pose, information, xi):
    """ln of the posterior, up to a constant, of the pose moved by xi (3,) in its own frame."""
    held = 0.0
    for i in range(3):
        for j in range(3):
            held += xi[i] * information[i, j] * xi[j]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = pose[0] + c * xi[0] - s * xi[1], pose[1] + s * xi[0] + c * xi[1]
    hit = hit_score(tiles, table, corner, cell, points, gain, x, y, pose[2] + xi[2])
    return kappa * hit - 0.5 * held


@njit(cache=True, nogil=True, parallel=True)
def refine(
    tiles, table, corner, poses, cell, points, gain, kappa, information, first_step, last_step, h
):
    """Match hits (n, 2) m to every particle's own map, held back by odometry.

    tiles, table, corner: of `TileMaps`; poses: (N, 3) predicted; cell [m]; kappa: the share of an
    independent measurement that a hit is; information: (3, 3) of a pose about its prediction, in
    that frame; first_step: (3,) of the search along x, y [m] and theta [rad], halved down to the
    share last_step of it.

    Returns the best moves (N, 3) in the predicted frames, and the information (N, 3, 3) that the
    hits add (negative Hessian by differences of widths h (3,)).
    """
    particles = len(poses)
    moves = np.zeros((particles, 3))
    gained = np.zeros((particles, 3, 3))
    nothing = np.zeros((3, 3))
    for k in prange(particles):
        own = table[k]
        xi, trial = np.zeros(3), np.zeros(3)
        top = _posterior(tiles, own, corner, cell, points, gain, kappa, poses[k], information, xi)
        scale = 1.0
        while scale >= last_step:
            improved = False
            for axis in range(3):
                # Both ways are looked at: to take the first that helps would favour one of them.
                to = xi[axis]
                trial[:] = xi
                for sign in (-1.0, 1.0):
                    trial[axis] = xi[axis] + sign * scale * first_step[axis]
                    value = _posterior(
                        tiles, own, corner, cell, points, gain, kappa, poses[k], information, trial
                    )
                    if value > top:
                        top, to, improved = value, trial[axis], True
                xi[axis] = to
            if not improved:
                scale *= 0.5
        moves[k] = xi
        for i in range(3):
            for j in range(i, 3):
                rise = 0.0
                for a in (-1.0, 1.0):
                    for b in (-1.0, 1.0):
                        trial[:] = xi
                        trial[i] += a * h[i]
                        trial[j] += b * h[j]
                        value = _posterior(
                            tiles, own, corner, cell, points, gain, kappa, poses[k], nothing, trial
                        )
                        rise += a * b * value
                gained[k, i, j] = gained[k, j, i] = -rise / (4.0 * h[i] * h[j])
    return moves, gained
