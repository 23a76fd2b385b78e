"""Windows matched to one another: where do both show the same surfaces, and how do they lie?

A window's surface is the mean hit of each of its obstacle cells. Its hits were placed by the
motion within the window, so that their mean place is known best from the window's middle: the
surface is given in the frame of the observation there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from mapping.density_kernels import bumps, climb, curvature
from mapping.local_map import LocalMap
from mapping.pose_graph import Measurements
from odometry.motion import Motion, compose, inverse, placed, rotation

RESOLUTION = 0.5  # of the density, in cells
# A hit on a surface is so many times likelier than one anywhere.
CONTRAST = 20.0
# Where a surface goes on beyond what the other map has seen of it, a match would be drawn along
# it: only points take part that lie near the middle of what lies AROUND them in the other [m].
AROUND = 0.35
OFF_CENTRE = 0.16
# So many points, and this share of them, must be shared for a match. A map is matched to at most
# PARTNERS later ones, those that share most with it.
LEAST_SHARED = 30
SHARE = 0.25
PARTNERS = 12
# Both maps are bent by what the motion errs from a window's middle to its ends: half of the
# window's covariance. Hits of neighbouring columns and windows share the errors of stereo, too: no
# match is better than this [m, m, rad], however many hits agree.
SHARED_ERROR = np.array([0.03, 0.03, math.radians(0.4)])
# How far from where it was expected a match may lie [m, m, rad].
REACH = np.array([0.3, 0.3, math.radians(4.0)])
LAST_STEP = 0.02  # of the search, as a share of the first
CURVATURE_WIDTH = np.array([0.015, 0.015, math.radians(0.3)])
LEAST_INFORMATION = 1e-3
EMPTY_RIM = 1.0  # around a surface on its grid [m]

# Density (H, W), x and y of its lower-left corner, resolution [m].
Density = tuple[np.ndarray, float, float, float]


@dataclass(frozen=True, eq=False)
class Glimpse:
    """What is kept of a local map: the mean hit (n, 2) of each of its obstacle cells in its own
    frame [m], the number of hits, the share of an independent measurement that each of those is,
    and the motion since the local map before."""

    points: np.ndarray
    hits: int
    kappa: float
    motion: Motion

    @staticmethod
    def of(local: LocalMap) -> Glimpse:
        """Of a local map."""
        mean = _mean_of_cells(local.points, local.cell)
        return Glimpse(mean, len(local.points), local.kappa, local.motion)


@dataclass(frozen=True, eq=False)
class Surface:
    """What a window of observations shows.

    points: (n, 2) mean hit of each obstacle cell in the frame of the window's middle [m];
    kappa: the share of an independent measurement that each of them is;
    middle: (3,) pose of that frame in the one at the window's end; motion: from the end of the
    window before to the end of this one.
    """

    points: np.ndarray
    kappa: float
    middle: np.ndarray
    motion: Motion

    @property
    def bend(self) -> np.ndarray:
        """Covariance (3, 3) of where the surface lies: the motion's over half of the window."""
        return 0.5 * self.motion.covariance


def surface(seen: list[Glimpse], frames: np.ndarray, middle: np.ndarray, cell: float) -> Surface:
    """The surface of a window: of its one local map, or of one for each observation.

    frames: (k, 3) poses of the k local maps' frames, middle: (3,) of the window's middle, all in
    one frame.
    """
    placed_points, motion = [], Motion.none(seen[0].motion.first)
    for one, frame in zip(seen, compose(inverse(middle), frames), strict=True):
        placed_points.append(placed(frame, one.points))
        motion = motion.then(one.motion)
    points = _mean_of_cells(np.concatenate(placed_points), cell)
    # The mean of several hits is worth as much as all of them.
    kappa = sum(one.hits * one.kappa for one in seen) / max(len(points), 1)
    return Surface(points, min(1.0, kappa), compose(inverse(frames[-1]), middle), motion)


def _mean_of_cells(points: np.ndarray, cell: float) -> np.ndarray:
    """The mean (n, 2) of the points in each cell that holds any."""
    _, number = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_inverse=True)
    count = np.bincount(number.ravel())
    return np.stack([np.bincount(number.ravel(), along) / count for along in points.T], axis=1)


def match_surfaces(
    surfaces: list[Surface], poses: np.ndarray, cell: float, width: float
) -> Measurements:
    """Relative poses of all surfaces that show the same walls, as measured by matching.

    poses: (n, 3) of the surfaces' frames, as far as known; width: standard deviation of a surface
    in the density [m].
    """
    found = []
    for base in range(len(surfaces) - 1):
        relative = compose(inverse(poses[base]), poses[base + 1 :])
        later = surfaces[base + 1 :]
        for number, measured in _partners(surfaces[base], later, relative, cell, width):
            found.append((base, base + 1 + number, *measured))
    if not found:
        return Measurements.none()
    base, other, pose, information = (np.array(part) for part in zip(*found, strict=True))
    return Measurements(base, other, pose, information)


def _partners(
    base: Surface, later: list[Surface], relative: np.ndarray, cell: float, width: float
) -> Iterator[tuple[int, tuple[np.ndarray, np.ndarray]]]:
    """Numbers of the later surfaces matched to the base, with (pose (3,), information (3, 3))."""
    if len(base.points) < LEAST_SHARED:
        return
    low = base.points.min(axis=0) - EMPTY_RIM
    number, middle = _around(base.points, low, cell)
    where = (number, middle, low[0], low[1], cell, OFF_CENTRE)
    points = np.concatenate([one.points for one in later])
    first = np.cumsum([0] + [len(one.points) for one in later])
    use = centred(points, first, relative, *where)
    count = np.add.reduceat(np.append(use, 0), first[:-1]) * (np.diff(first) > 0)
    enough = np.maximum(LEAST_SHARED, SHARE * np.diff(first))
    most = np.argsort(-count, kind="stable")[:PARTNERS]
    chosen = most[count[most] >= enough[most]]
    if not len(chosen):
        return
    grid = _density(base.points, low, cell, width)
    for k in chosen.tolist():
        one = slice(first[k], first[k + 1])
        shared = points[one][use[one]]
        measured = _matched(grid, shared, later[k].kappa, relative[k], cell, width)
        if measured is not None:
            pose, covariance = measured
            bent = base.bend + _turned(later[k].bend, pose[2]) + np.diag(SHARED_ERROR**2)
            yield k, (pose, np.linalg.inv(covariance + bent))


def _matched(
    grid: Density,
    points: np.ndarray,
    kappa: float,
    expected: np.ndarray,
    cell: float,
    width: float,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Pose (3,) of the points on the density, and its covariance; None: too far away."""
    first_step = np.array([width, width, math.radians(width / cell)])
    information = np.diag(1.0 / REACH**2)
    pose = climb(*grid, points, expected, information, kappa, first_step, LAST_STEP)
    if (np.abs(pose - expected) > REACH).any():
        return None
    gained = curvature(*grid, points, kappa, pose, CURVATURE_WIDTH * width / cell)
    values, vectors = np.linalg.eigh(gained)
    return pose, (vectors / np.maximum(values, LEAST_INFORMATION)) @ vectors.T


def _turned(covariance: np.ndarray, angle: float) -> np.ndarray:
    """A covariance (3, 3) of x, y, theta in a frame turned by an angle [rad]."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(angle)
    return turn @ covariance @ turn.T


def _density(points: np.ndarray, low: np.ndarray, cell: float, width: float) -> Density:
    """Density of a surface (n, 2), from its lower-left corner on."""
    resolution = RESOLUTION * cell
    shape = np.ceil((points.max(axis=0) + EMPTY_RIM - low) / resolution).astype(int)[::-1]
    density = np.zeros(shape)
    doubt = np.full(len(points), width)
    cells, values = bumps(density, low[0], low[1], resolution, points, np.zeros(2), doubt, width)
    density.reshape(-1)[cells] = CONTRAST * values
    return density, float(low[0]), float(low[1]), resolution


def _around(points: np.ndarray, low: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Number (H, W) and mean place (H, W, 2) [m] of the points within AROUND of each cell."""
    at = np.floor((points - low) / cell).astype(np.int64)
    shape = tuple(np.ceil((points.max(axis=0) + EMPTY_RIM - low) / cell).astype(int)[::-1])
    moments = np.zeros((*shape, 3))
    np.add.at(moments, (at[:, 1], at[:, 0]), np.column_stack([np.ones(len(points)), points]))
    size = 2 * round(AROUND / cell) + 1
    moments = cv2.boxFilter(
        moments, -1, (size, size), normalize=False, borderType=cv2.BORDER_CONSTANT
    )
    number = np.round(moments[:, :, 0])
    return number, moments[:, :, 1:] / np.maximum(number, 1.0)[:, :, None]


@njit(cache=True, nogil=True)
def centred(points, first, poses, number, middle, x0, y0, cell, most):
    """Which points (n, 2) lie within `most` of the mean place of what is around them; points
    first[k] to first[k + 1] are seen from poses[k] (3,)."""
    rows, columns = number.shape
    use = np.zeros(len(points), np.bool_)
    for k in range(len(poses)):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        for i in range(first[k], first[k + 1]):
            x = poses[k, 0] + c * points[i, 0] - s * points[i, 1]
            y = poses[k, 1] + s * points[i, 0] + c * points[i, 1]
            row, column = math.floor((y - y0) / cell), math.floor((x - x0) / cell)
            if 0 <= row < rows and 0 <= column < columns and number[row, column] > 0:
                off = math.hypot(middle[row, column, 0] - x, middle[row, column, 1] - y)
                use[i] = off < most
    return use
