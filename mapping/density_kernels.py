"""The inner loops of scan-matched ego-motion: hit density, score, search."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, nogil=True)
def add_hits(density, layer, x0, y0, cell, points, doubt):
    """Add one scan's hits (n, 2), each a round bump of its doubt (n,), to `density` in place.

    A cell takes the highest bump of the scan, not their sum: near surfaces fill many columns
    and must not outweigh far ones.
    `layer` is scratch space of the same shape, zero before and after.
    """
    rows, columns = density.shape
    for i in range(points.shape[0]):
        sd = doubt[i]
        reach = 2.5 * sd
        first_row = max(0, int((points[i, 1] - reach - y0) / cell))
        last_row = min(rows - 1, int((points[i, 1] + reach - y0) / cell))
        first_column = max(0, int((points[i, 0] - reach - x0) / cell))
        last_column = min(columns - 1, int((points[i, 0] + reach - x0) / cell))
        for row in range(first_row, last_row + 1):
            dy = y0 + (row + 0.5) * cell - points[i, 1]
            for column in range(first_column, last_column + 1):
                dx = x0 + (column + 0.5) * cell - points[i, 0]
                bump = math.exp(-0.5 * (dx * dx + dy * dy) / (sd * sd))
                if bump > layer[row, column]:
                    density[row, column] += bump - layer[row, column]
                    layer[row, column] = bump
    layer[:] = 0.0


@njit(cache=True, nogil=True)
def score(density, x0, y0, cell, points, prior, information, kappa, pose):
    """Log posterior of a pose (3,): hits on the density, and nearness to odometry."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rows, columns = density.shape
    total = 0.0
    for i in range(points.shape[0]):
        u = (pose[0] + c * points[i, 0] - s * points[i, 1] - x0) / cell - 0.5
        v = (pose[1] + s * points[i, 0] + c * points[i, 1] - y0) / cell - 0.5
        column, row = math.floor(u), math.floor(v)
        if 0 <= row < rows - 1 and 0 <= column < columns - 1:
            a, b = u - column, v - row
            d = (1.0 - b) * (
                (1.0 - a) * density[row, column] + a * density[row, column + 1]
            ) + b * ((1.0 - a) * density[row + 1, column] + a * density[row + 1, column + 1])
            total += math.log(1.0 + d)
    off = pose - prior
    held = 0.0
    for i in range(3):
        for j in range(3):
            held += off[i] * information[i, j] * off[j]
    return kappa * total - 0.5 * held


@njit(cache=True, nogil=True)
def climb(density, x0, y0, cell, points, prior, information, kappa, first_step, last_step):
    """Pose (3,) of the highest score near `prior`: steps along the axes, halved when none helps."""
    pose = prior.copy()
    best = score(density, x0, y0, cell, points, prior, information, kappa, pose)
    scale = 1.0
    while scale >= last_step:
        improved = False
        for axis in range(3):
            for sign in (-1.0, 1.0):
                trial = pose.copy()
                trial[axis] += sign * scale * first_step[axis]
                value = score(density, x0, y0, cell, points, prior, information, kappa, trial)
                if value > best:
                    best, improved = value, True
                    pose = trial
        if not improved:
            scale *= 0.5
    return pose
