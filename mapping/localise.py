"""Where in a known map is the robot? The first local map is laid over it, everywhere.

Coarse to fine (Olson 2009): headings and places on a grid, scored on a blurred map; the best of
them climb on a sharp one. A hit counts where the map has an obstacle, and against a pose where the
map is free; so does free space where the map has obstacles. The answer must stand out: places that
look alike are an error, not a guess.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from mapping.errors import MappingError
from mapping.grid import FREE, OCCUPIED, OccupancyGrid
from mapping.local_map import LocalMap
from mapping.sensor_model import log_odds
from mapping.settings import MappingSettings
from odometry.motion import placed, wrap_angle

HEADINGS = 96
SPACING = 0.15  # m between the places looked at first
COARSE, SHARP = 0.15, 0.06  # m: how far from an obstacle a hit still counts
ON_FREE = -0.5  # what a hit counts where the map is free
SEEN_THROUGH = -4.0  # what a free cell counts, as a share of all, where the map has an obstacle
MOST_HITS, MOST_FREE = 150, 400
CANDIDATES = 40
STEPS = (0.08, 0.04, 0.02, 0.01)  # m; radians are as many
MOST_MOVES = 20  # of one length
# Poses nearer than this are the same answer [m, rad].
APART = (0.5, math.radians(20.0))
LEAST = 0.45  # score of a good match: 1 is every hit on an obstacle
DISTINCT = 0.85  # of the best score, that the second best may have
NEED = "give --pose x,y,deg, or start where more can be seen"


def locate(local: LocalMap, grid: OccupancyGrid, settings: MappingSettings) -> np.ndarray:
    """Pose (3,) in the map of the robot at the end of a local map.

    Raises:
        MappingError: nothing fits, or several places do.
    """
    hits = _thinned(local.points, MOST_HITS)
    if len(hits) < 15:
        raise MappingError(f"too few obstacles in view to find the place in the map: {NEED}")
    sharp = _Sharp(hits, _free_cells(local, settings), grid, settings)
    found = sorted(map(sharp.climb, _candidates(hits, grid, settings)), key=lambda f: -f[0])
    best_score, best = found[0]
    if best_score < LEAST:
        raise MappingError(
            f"what is seen fits nowhere in the map (best match {best_score:.0%}): is it the right "
            f"map? {NEED}"
        )
    for score, pose in found[1:]:
        apart = np.hypot(*(pose - best)[:2]) > APART[0]
        turned = abs(float(wrap_angle(pose[2] - best[2]))) > APART[1]
        if (apart or turned) and score > DISTINCT * best_score:
            raise MappingError(f"the map looks alike at {_told(best)} and {_told(pose)}: {NEED}")
    return best


def _told(pose: np.ndarray) -> str:
    return f"({pose[0]:.1f}, {pose[1]:.1f} m, {math.degrees(pose[2]):.0f} deg)"


def _thinned(points: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the points (n, 2), evenly."""
    chosen = np.linspace(0, len(points) - 1, min(most, len(points))).round().astype(int)
    return points[chosen]


def _free_cells(local: LocalMap, settings: MappingSettings) -> np.ndarray:
    """Middles (n, 2) of cells that the local map knows to be free [m]."""
    free = np.nan_to_num(local.log_odds, nan=0.0) < log_odds(settings.free)
    rows, columns = np.nonzero(free)
    middles = (np.stack([columns, rows], axis=1) + 0.5) * local.cell + local.origin
    return _thinned(middles, MOST_FREE)


def _field(grid: OccupancyGrid, settings: MappingSettings, reach: float) -> np.ndarray:
    """What a hit counts in every cell (H, W) float32."""
    classes = grid.classes
    away = cv2.distanceTransform(
        np.where(classes == OCCUPIED, 0, 1).astype(np.uint8),
        cv2.DIST_L2,
        5,
    )
    near = np.exp(-0.5 * (away * grid.cell / reach) ** 2)
    return np.where((classes == FREE) & (near < 0.1), ON_FREE, near).astype(np.float32)


def _scores(
    field: np.ndarray, grid: OccupancyGrid, turned: np.ndarray, places: np.ndarray
) -> np.ndarray:
    """Mean count (m,) of hits (n, 2), turned already, from each of the places (m, 2)."""
    at = np.floor((places[:, None] + turned[None] - grid.origin) / grid.cell).astype(np.int64)
    height, width = field.shape
    inside = (at >= 0).all(axis=2) & (at[..., 0] < width) & (at[..., 1] < height)
    values = field[np.clip(at[..., 1], 0, height - 1), np.clip(at[..., 0], 0, width - 1)]
    return np.where(inside, values, 0.0).mean(axis=1)


def _candidates(
    hits: np.ndarray, grid: OccupancyGrid, settings: MappingSettings
) -> list[np.ndarray]:
    """The best poses of the coarse search, no two of them close together."""
    field = _field(grid, settings, COARSE)
    stride = max(1, round(SPACING / grid.cell))
    # A robot stands where the map is free.
    rows, columns = np.nonzero(grid.classes[::stride, ::stride] == FREE)
    places = (np.stack([columns, rows], axis=1) * stride + 0.5) * grid.cell + grid.origin
    if not len(places):
        raise MappingError("the map has no free place for the robot to stand")
    headings = np.arange(HEADINGS) * (2.0 * math.pi / HEADINGS) - math.pi
    scores = np.stack(
        [_scores(field, grid, placed(np.array([0.0, 0.0, h]), hits), places) for h in headings]
    )
    found: list[np.ndarray] = []
    for index in np.argsort(scores, axis=None)[::-1]:
        heading, place = divmod(int(index), len(places))
        pose = np.array([*places[place], headings[heading]])
        if all(_apart(pose, other) for other in found):
            found.append(pose)
        if len(found) == CANDIDATES:
            break
    return found


def _apart(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(
        np.hypot(*(a - b)[:2]) > 2.0 * SPACING
        or abs(float(wrap_angle(a[2] - b[2]))) > 4.0 * math.pi / HEADINGS
    )


class _Sharp:
    """The score of a pose on the sharp map, and the way up from it."""

    def __init__(
        self, hits: np.ndarray, free: np.ndarray, grid: OccupancyGrid, settings: MappingSettings
    ) -> None:
        self._hits, self._free, self._grid = hits, free, grid
        self._field = _field(grid, settings, SHARP)
        taken = np.nan_to_num(grid.probability, nan=0.0) > settings.occupied
        self._through = np.where(taken, SEEN_THROUGH, 0.0).astype(np.float32)

    def score(self, pose: np.ndarray) -> float:
        """1 where every hit falls on an obstacle and no free space does."""
        turn, place = pose * (0.0, 0.0, 1.0), pose[None, :2]
        score = _scores(self._field, self._grid, placed(turn, self._hits), place)[0]
        if len(self._free):
            score += _scores(self._through, self._grid, placed(turn, self._free), place)[0]
        return float(score)

    def climb(self, pose: np.ndarray) -> tuple[float, np.ndarray]:
        """Score and pose (3,) of the summit near a pose."""
        moves = np.concatenate([np.eye(3), -np.eye(3)])
        score = self.score(pose)
        for step in STEPS:
            for _ in range(MOST_MOVES):
                scores = [self.score(tried) for tried in pose + step * moves]
                if max(scores) <= score:
                    break
                score, pose = max(scores), pose + step * moves[int(np.argmax(scores))]
        return score, np.array([pose[0], pose[1], float(wrap_angle(pose[2]))])
