"""Exact ray casting through a grid of cells, one cell after another.

Source: Amanatides and Woo, A fast voxel traversal algorithm for ray tracing (1987).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def cast(solid, x0, y0, cell, poses, bearing, reach):
    """Distance from each pose along each bearing to the face of the first solid cell.

    solid: (H, W) bool, row 0 = lowest y; x0, y0: its lower-left corner [m]; cell [m].
    poses: (n, 3) x m, y m, theta rad; bearing: (m,) rad; reach: how far a ray goes [m].

    Returns the ranges (n, m) m, +inf where nothing stands within `reach` or before the grid's
    border, and the cells (H, W) bool that the rays crossed, those they hit among them.
    """
    ranges = np.empty((poses.shape[0], bearing.size))
    crossed = np.zeros(solid.shape, np.bool_)
    for i in range(poses.shape[0]):
        u, v = (poses[i, 0] - x0) / cell, (poses[i, 1] - y0) / cell
        for j in range(bearing.size):
            angle = poses[i, 2] + bearing[j]
            ranges[i, j] = cell * _first_hit(solid, crossed, u, v, angle, reach / cell)
    return ranges, crossed


@njit(cache=True, nogil=True)
def _first_hit(solid, crossed, u, v, angle, reach):
    """Distance in cells along one ray from (u, v) cells; marks what it crosses."""
    rows, columns = solid.shape
    du, dv = math.cos(angle), math.sin(angle)
    column, row = math.floor(u), math.floor(v)
    # Distances to the next upright and the next level face, and between two of a kind.
    upright, right, across = _faces(u, column, du)
    level, up, along = _faces(v, row, dv)
    distance = 0.0
    while distance <= reach and 0 <= row < rows and 0 <= column < columns:
        crossed[row, column] = True
        if solid[row, column]:
            return distance
        if upright < level:
            distance, upright, column = upright, upright + across, column + right
        else:
            distance, level, row = level, level + along, row + up
    return math.inf


@njit(cache=True, nogil=True)
def _faces(place, index, direction):
    """(distance to the first face, step of the index, distance from face to face) on one axis."""
    if direction > 0.0:
        return (index + 1 - place) / direction, 1, 1.0 / direction
    if direction < 0.0:
        return (index - place) / direction, -1, -1.0 / direction
    return math.inf, 0, math.inf
