"""The inner loops of scan-matched ego-motion: hit density, score, search, curvature."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# A bump is drawn up to so many of its standard deviations.
BUMP_REACH = 2.5


@njit(cache=True, nogil=True)
def joined(points, doubt, most, step):
    """Hits (n, 2) with points between neighbours that are closer than `most`, `step` apart; and
    their doubts."""
    n = points.shape[0]
    extra = np.zeros(n, np.int64)
    for i in range(n - 1):
        gap = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
        if gap < most:
            extra[i] = int(gap / step)
    total = n + extra.sum()
    surface, doubts = np.empty((total, 2)), np.empty(total)
    m = 0
    for i in range(n):
        surface[m], doubts[m] = points[i], doubt[i]
        m += 1
        for k in range(1, extra[i] + 1):
            share = k / (extra[i] + 1)
            surface[m] = (1.0 - share) * points[i] + share * points[i + 1]
            doubts[m] = (1.0 - share) * doubt[i] + share * doubt[i + 1]
            m += 1
    return surface, doubts


@njit(cache=True, nogil=True)
def bumps(layer, x0, y0, cell, points, eye, doubt, across):
    """One scan's share of the density: flat cell numbers (m,) and values (m,).

    Each hit (n, 2) is a Gaussian bump, of standard deviation `doubt` (n,) along the line of sight
    from `eye` (2,) and `across` beside it: a wall that is looked at aslant is known far better
    than its range. A cell takes the highest bump of the scan, not their sum: near surfaces fill
    many columns and must not outweigh far ones. `layer` (H, W) is scratch space, zero before and
    after.
    """
    rows, columns = layer.shape
    cells = np.empty(256, np.int64)
    count = 0
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - eye[0], points[i, 1] - eye[1]
        r = max(math.hypot(dx, dy), 1e-9)
        dx, dy = dx / r, dy / r
        along, aside = 1.0 / doubt[i] ** 2, 1.0 / across**2
        # Inverse covariance of the bump.
        xx = dx * dx * along + dy * dy * aside
        xy = dx * dy * (along - aside)
        yy = dy * dy * along + dx * dx * aside
        reach_y = BUMP_REACH * math.hypot(dy * doubt[i], dx * across)
        first_row = max(0, math.ceil((points[i, 1] - reach_y - y0) / cell - 0.5))
        last_row = min(rows - 1, math.floor((points[i, 1] + reach_y - y0) / cell - 0.5))
        # From one cell to the next the exponent grows by a step that itself grows evenly.
        bend = math.exp(-xx * cell * cell)
        for row in range(first_row, last_row + 1):
            v = y0 + (row + 0.5) * cell - points[i, 1]
            # The row's part of the ellipse of BUMP_REACH.
            half = math.sqrt(max(BUMP_REACH**2 * xx - along * aside * v * v, 0.0)) / xx
            middle = points[i, 0] - xy * v / xx - x0
            first_column = max(0, math.ceil((middle - half) / cell - 0.5))
            last_column = min(columns - 1, math.floor((middle + half) / cell - 0.5))
            u = x0 + (first_column + 0.5) * cell - points[i, 0]
            bump = math.exp(-0.5 * (xx * u * u + 2.0 * xy * u * v + yy * v * v))
            grow = math.exp(-cell * (xx * u + xy * v) - 0.5 * xx * cell * cell)
            for column in range(first_column, last_column + 1):
                if bump > layer[row, column]:
                    if layer[row, column] == 0.0:
                        if count == cells.size:
                            cells = np.concatenate((cells, np.empty(count, np.int64)))
                        cells[count] = row * columns + column
                        count += 1
                    layer[row, column] = bump
                bump *= grow
                grow *= bend
    cells = cells[:count].copy()
    values = np.empty(count)
    flat = layer.reshape(-1)
    for n in range(count):
        values[n] = flat[cells[n]]
        flat[cells[n]] = 0.0
    return cells, values


@njit(cache=True, nogil=True)
def accumulate(density, cells, values, sign):
    """Add (sign 1) or take away (-1) a scan's share of the density (H, W) in place."""
    flat = density.reshape(-1)
    for n in range(cells.size):
        # What is left of rounding when all shares are gone must not turn negative.
        flat[cells[n]] = max(flat[cells[n]] + sign * values[n], 0.0)


@njit(cache=True, nogil=True)
def score(density, x0, y0, cell, points, prior, information, kappa, pose):
    """Log posterior of a pose (3,): hits (n, 2) on the density (H, W), and nearness to odometry.

    x0, y0: lower-left corner of the density [m]; prior (3,), information (3, 3): of the pose by
    odometry; kappa: the share of an independent measurement that a hit is.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rows, columns = density.shape
    total, product = 0.0, 1.0
    for i in range(points.shape[0]):
        u = (pose[0] + c * points[i, 0] - s * points[i, 1] - x0) / cell - 0.5
        v = (pose[1] + s * points[i, 0] + c * points[i, 1] - y0) / cell - 0.5
        column, row = math.floor(u), math.floor(v)
        if 0 <= row < rows - 1 and 0 <= column < columns - 1:
            a, b = u - column, v - row
            d = (1.0 - b) * (
                (1.0 - a) * density[row, column] + a * density[row, column + 1]
            ) + b * ((1.0 - a) * density[row + 1, column] + a * density[row + 1, column + 1])
            # The logarithm of a product costs one logarithm, not many.
            product *= 1.0 + d
            if product > 1e200:
                total += math.log(product)
                product = 1.0
    total += math.log(product)
    off = pose - prior
    held = 0.0
    for i in range(3):
        for j in range(3):
            held += off[i] * information[i, j] * off[j]
    return kappa * total - 0.5 * held


@njit(cache=True, nogil=True)
def climb(density, x0, y0, cell, points, prior, information, kappa, first_step, last_step):
    """Pose (3,) of the highest score near `prior`: steps along the axes, halved when none helps.

    first_step: (3,) along x, y [m] and theta [rad], halved down to the share last_step of it.
    """
    pose = prior.copy()
    trial = prior.copy()
    best = score(density, x0, y0, cell, points, prior, information, kappa, pose)
    scale = 1.0
    while scale >= last_step:
        improved = False
        for axis in range(3):
            # Both ways are looked at: to take the first that helps would favour one of them.
            start, to = pose[axis], pose[axis]
            for sign in (-1.0, 1.0):
                trial[:] = pose
                trial[axis] = start + sign * scale * first_step[axis]
                value = score(density, x0, y0, cell, points, prior, information, kappa, trial)
                if value > best:
                    best, to, improved = value, trial[axis], True
            pose[axis] = to
        if not improved:
            scale *= 0.5
    return pose


@njit(cache=True, nogil=True)
def curvature(density, x0, y0, cell, points, kappa, pose, h):
    """Information (3, 3) that the hits alone hold of a pose: the negative Hessian of their score,
    by central differences of widths h (3,)."""
    nothing = np.zeros((3, 3))
    result = np.zeros((3, 3))
    for i in range(3):
        for j in range(i, 3):
            rise = 0.0
            for a in (-1.0, 1.0):
                for b in (-1.0, 1.0):
                    at = pose.copy()
                    at[i] += a * h[i]
                    at[j] += b * h[j]
                    value = score(density, x0, y0, cell, points, pose, nothing, kappa, at)
                    rise += a * b * value
            result[i, j] = result[j, i] = -rise / (4.0 * h[i] * h[j])
    return result
