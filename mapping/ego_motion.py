"""Scan-matched ego-motion: odometry's increments improved by what the camera saw.

Every scan is aligned to the smoothed hit density of the scans before it, starting from and held
back by odometry: the pose maximises

    kappa sum_i ln(1 + D(T p_i))  -  1/2 (xi - u)' Sigma_u^-1 (xi - u)

with the scan's hits p_i, the density D of earlier hits (each spread over its own doubt), the
odometry increment u and its covariance. The curvature at the maximum is the information on the
pose; where the hits say nothing (along a blank corridor) odometry's alone remains. A false match
lies where D is low and pulls at little.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from mapping.density_kernels import add_hits, climb, score
from odometry.motion import Motion, inverse
from stereo.scan import RangeScan

REMEMBERED = 10  # scans that make up the density
# Neighbouring columns share their errors: every other one is enough, and a hit counts as this
# share of an independent measurement.
COLUMNS = 2
KAPPA = 0.15
# Resolution of the density and least doubt of a hit in it, in cells of the map.
RESOLUTION = 0.8
SMOOTHING = 0.8
# First steps of the search along x and y [cells of the map] and theta [rad]; halved down to
# LAST_STEP of them.
FIRST_STEP = (0.4, 0.4, np.radians(0.5))
LAST_STEP = 0.03
MIN_HITS = 15
# Keeps the information of odometry finite in directions it claims to know exactly [m, m, rad].
LEAST_DOUBT = np.array([1e-4, 1e-4, 2e-5])


class EgoMotion:
    """Turns the odometry between observations into matched motion; `cell` of the map [m]."""

    def __init__(self, cell: float) -> None:
        self.resolution = RESOLUTION * cell
        self.smoothing = SMOOTHING * cell
        self.first_step = np.array([FIRST_STEP[0] * cell, FIRST_STEP[1] * cell, FIRST_STEP[2]])
        # Hits (n, 2) [m] and doubts (n,) [m] of the last scans, in the latest robot frame.
        self._before: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=REMEMBERED)

    def refine(self, scan: RangeScan, motion: Motion) -> Motion:
        """`motion` since the scan before, corrected by matching `scan` where it can be."""
        points, doubt = hits(scan)
        exact = not motion.covariance.any()
        if len(points) >= MIN_HITS and self._before and not exact:
            motion = self._match(points, motion)
        back = inverse(motion.increment)
        for i, (earlier, doubts) in enumerate(self._before):
            self._before[i] = (placed(back, earlier), doubts)
        self._before.append((points, doubt))
        return motion

    def _match(self, points: np.ndarray, motion: Motion) -> Motion:
        information = np.linalg.inv(motion.covariance + np.diag(LEAST_DOUBT**2))
        density, low = self._density(placed(motion.increment, points))
        terms = (density, low[0], low[1], self.resolution, points, motion.increment)
        best = climb(*terms, information, KAPPA, self.first_step, LAST_STEP)
        gained = _curvature(lambda pose: score(*terms, information, KAPPA, pose), best)
        covariance = _covariance(motion.covariance, gained - information)
        return Motion(best, covariance, motion.first, motion.last)

    def _density(self, around: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Hit density (H, W) in the box around the points (n, 2), and its lower-left corner."""
        margin = 10 * self.resolution
        low = around.min(axis=0) - margin
        columns, rows = np.ceil((around.max(axis=0) + margin - low) / self.resolution).astype(int)
        density, layer = np.zeros((rows, columns)), np.zeros((rows, columns))
        for earlier, doubt in self._before:
            blurred = np.maximum(doubt, self.smoothing)
            add_hits(density, layer, low[0], low[1], self.resolution, earlier, blurred)
        return density, low


def hits(scan: RangeScan) -> tuple[np.ndarray, np.ndarray]:
    """Every other hit of a scan in the robot's frame, (n, 2) m, and its doubt (n,) m."""
    r, angle, sigma = (a[::COLUMNS] for a in (scan.range, scan.bearing, scan.sigma))
    # A wall about max_range away shows only those ranges that came out short: it would seem to
    # move along with the robot.
    seen = np.isfinite(r) & (r + 2.0 * np.nan_to_num(sigma) < scan.max_range)
    r, angle = r[seen], angle[seen]
    points = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)
    return placed(np.array(scan.origin), points), sigma[seen]


def placed(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 2) of the frame that stands at `pose` (3,)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return points @ np.array([[c, s], [-s, c]]) + pose[:2]


def _curvature(f: Callable[[np.ndarray], float], at: np.ndarray) -> np.ndarray:
    """Negative Hessian (3, 3) of `f` by central differences."""
    h = np.array([0.01, 0.01, np.radians(0.25)])
    H = np.zeros((3, 3))
    for i in range(3):
        for j in range(i, 3):
            a, b = np.zeros(3), np.zeros(3)
            a[i], b[j] = h[i], h[j]
            rise = f(at + a + b) - f(at + a - b) - f(at - a + b) + f(at - a - b)
            H[i, j] = H[j, i] = rise / (4.0 * h[i] * h[j])
    return -H


def _covariance(odometry: np.ndarray, gained: np.ndarray) -> np.ndarray:
    """Of the matched pose: odometry's (3, 3) less what the information `gained` takes away.

    Directions in which the density curves the wrong way add nothing.
    """
    values, vectors = np.linalg.eigh(gained)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    share = odometry @ root
    return odometry - share @ np.linalg.solve(np.eye(3) + root.T @ share, share.T)
