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
from dataclasses import dataclass

import numpy as np

from mapping.density_kernels import accumulate, bumps, climb, curvature, joined
from odometry.motion import Motion, compose, inverse, placed, rotation
from stereo.scan import RangeScan

REMEMBERED = 20  # scans that make up the density
LEAST_SPACING = np.radians(0.5)  # hits closer together than this are thinned out
MIN_HITS = 15  # with fewer odometry alone leads
# Neighbouring hits closer than this [m] lie on one surface, which is drawn between them: single
# dots would attract the dots of the next scan, which the robot takes along.
ONE_SURFACE = 0.5
# Resolution of the density and least doubt of a hit in it, in cells of the map.
RESOLUTION = 0.4
SMOOTHING = 0.3
# First steps of the search along x and y [cells of the map] and theta [rad]; halved down to
# LAST_STEP of them.
FIRST_STEP = (0.4, 0.4, np.radians(0.5))
LAST_STEP = 0.03
# Widths of the differences that measure curvature [m, m, rad].
CURVATURE_WIDTH = np.array([0.01, 0.01, np.radians(0.25)])
# The grid reaches so far beyond the hits, and further when it is drawn anew [m].
MARGIN = 0.5
TRAVEL = 3.0
# Keeps the information of odometry finite in directions it claims to know exactly [m, m, rad].
LEAST_DOUBT = np.array([1e-4, 1e-4, 2e-5])


@dataclass(frozen=True)
class _Remembered:
    """An earlier scan on the grid.

    points: (n, 2) hits and what joins them [m]; doubt: (n,) of each along the line of sight [m];
    eye: (2,) where the sensor stood [m]; cells, values: (m,) its share of the density.
    """

    points: np.ndarray
    doubt: np.ndarray
    eye: np.ndarray
    cells: np.ndarray
    values: np.ndarray


class EgoMotion:
    """Turns the odometry between observations into matched motion.

    cell: of the map [m]; correlated: angle over which ranges share their errors [rad].

    The density lies on a grid that stands still while the robot drives on it. It is drawn anew
    around the robot when a scan reaches beyond it.
    """

    def __init__(self, cell: float, correlated: float) -> None:
        self.correlated = correlated
        self.resolution = RESOLUTION * cell
        self.smoothing = SMOOTHING * cell
        self.first_step = np.array([FIRST_STEP[0] * cell, FIRST_STEP[1] * cell, FIRST_STEP[2]])
        self._pose = np.zeros(3)  # of the robot, in the frame of the grid
        self._before: deque[_Remembered] = deque()
        self._low = np.zeros(2)  # lower-left corner of the grid [m]
        self._density = np.zeros((0, 0))
        self._layer = np.zeros((0, 0))

    def refine(self, scan: RangeScan, motion: Motion) -> Motion:
        """`motion` since the scan before, corrected by matching `scan` where it can be."""
        points, doubt, kappa = hits(scan, self.correlated)
        prior = compose(self._pose, motion.increment)
        self._reach(placed(prior, points), prior)
        exact = not motion.covariance.any()
        if len(points) >= MIN_HITS and self._before and not exact:
            motion = self._match(points, kappa, motion, prior)
        self._pose = compose(self._pose, motion.increment)
        surface, doubt = joined(points, doubt, ONE_SURFACE, self.resolution)
        eye = compose(self._pose, np.array(scan.origin))[:2]
        self._remember(placed(self._pose, surface), np.maximum(doubt, self.smoothing), eye)
        return motion

    def _match(self, points: np.ndarray, kappa: float, motion: Motion, prior: np.ndarray) -> Motion:
        turn = np.eye(3)
        turn[:2, :2] = rotation(self._pose[2])
        odometry = turn @ motion.covariance @ turn.T
        information = np.linalg.inv(odometry + np.diag(LEAST_DOUBT**2))
        grid = (self._density, self._low[0], self._low[1], self.resolution, points)
        # The search must be able to leave a local maximum beside a poor prediction.
        doubt = np.sqrt(np.diag(odometry))
        first_step = np.maximum(self.first_step, doubt)
        last_step = LAST_STEP * float(np.min(self.first_step / first_step))
        best = climb(*grid, prior, information, kappa, first_step, last_step)
        gained = curvature(*grid, kappa, best, CURVATURE_WIDTH)
        covariance = turn.T @ _covariance(odometry, gained) @ turn
        return Motion(compose(inverse(self._pose), best), covariance, motion.first, motion.last)

    def _remember(self, points: np.ndarray, doubt: np.ndarray, eye: np.ndarray) -> None:
        if len(self._before) == REMEMBERED:
            oldest = self._before.popleft()
            accumulate(self._density, oldest.cells, oldest.values, -1.0)
        self._before.append(self._drawn(points, doubt, eye))

    def _drawn(self, points: np.ndarray, doubt: np.ndarray, eye: np.ndarray) -> _Remembered:
        x0, y0 = self._low
        cells, values = bumps(
            self._layer, x0, y0, self.resolution, points, eye, doubt, self.smoothing
        )
        accumulate(self._density, cells, values, 1.0)
        return _Remembered(points, doubt, eye, cells, values)

    def _reach(self, points: np.ndarray, pose: np.ndarray) -> None:
        """Make sure that the grid holds the points (n, 2) of the scan taken at a robot pose."""
        if not len(points):
            return
        rows, columns = self._density.shape
        high = self._low + self.resolution * np.array([columns, rows])
        if (points.min(axis=0) - MARGIN >= self._low).all() and (
            points.max(axis=0) + MARGIN <= high
        ).all():
            return
        # All round the robot: it may turn.
        reach = float(np.abs(points - pose[:2]).max()) + TRAVEL
        self._low = pose[:2] - reach
        cells = int(np.ceil(2.0 * reach / self.resolution))
        self._density, self._layer = np.zeros((cells, cells)), np.zeros((cells, cells))
        self._before = deque(
            self._drawn(scan.points, scan.doubt, scan.eye) for scan in self._before
        )


def hits(scan: RangeScan, correlated: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Hits of a scan in the robot's frame, (n, 2) m, their doubt (n,) m, and kappa: the share of
    an independent measurement that each of them is."""
    spacing = scan.spacing
    stride = max(1, round(LEAST_SPACING / spacing)) if spacing > 0.0 else 1
    r, angle, sigma = (a[::stride] for a in (scan.range, scan.bearing, scan.sigma))
    # A wall about max_range away shows only those ranges that came out short: it would seem to
    # move along with the robot.
    seen = np.isfinite(r) & (r + 2.0 * np.nan_to_num(sigma) < scan.max_range)
    r, angle = r[seen], angle[seen]
    points = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)
    kappa = min(1.0, stride * spacing / correlated)
    return placed(np.array(scan.origin), points), sigma[seen], kappa


def _covariance(odometry: np.ndarray, gained: np.ndarray) -> np.ndarray:
    """Of the matched pose: odometry's (3, 3) less what the information `gained` takes away.

    Directions in which the density curves the wrong way add nothing.
    """
    values, vectors = np.linalg.eigh(gained)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    share = odometry @ root
    return odometry - share @ np.linalg.solve(np.eye(3) + root.T @ share, share.T)
