"""HierarchicalMapper: both stages, the path and its smoothing, for one pair after another.

mapper = HierarchicalMapper()
for scan, motion in data:
    pose = mapper.add(scan, motion)
grid, path = mapper.finish()
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from mapping.ego_motion import EgoMotion
from mapping.footprint import with_footprint
from mapping.gate import ObservationGate
from mapping.grid import OccupancyGrid
from mapping.known_map import KnownMap, tile_maps
from mapping.local_map import LocalMap, LocalMapper
from mapping.localise import locate
from mapping.particle_filter import ParticleFilter
from mapping.path import join
from mapping.settings import MappingSettings
from mapping.smoothing import smooth
from mapping.surface_matching import Glimpse, surface
from odometry.motion import Motion, compose, inverse
from stereo.scan import RangeScan

# Smoothing may cost so much of the matched share of a local map (eq (8)), on average. The filter's
# best particle is chosen by that share and exceeds the true path's by some hundredths.
MAX_LOST = 0.1


class HierarchicalMapper:
    """Scans and motion in, a map and a path out. The first pair stands at (0, 0, 0), or in a map
    made before where that says; where it must be searched, the poses up to the first local map are
    told from (0, 0, 0), and the search may fail with a MappingError. Such a map is gone on with as
    it is: its path is not smoothed.

    Odometry is known at every pair, matched motion at every observation, the filter's pose at
    every local map: each corrects the one before.
    """

    def __init__(
        self, settings: MappingSettings | None = None, seed: int = 0, known: KnownMap | None = None
    ):
        self.settings = settings or MappingSettings()
        self.local_mapper = LocalMapper(self.settings)
        self.filter = ParticleFilter(self.settings, seed)
        self.stamps: list[int] = []
        self.odometry: list[np.ndarray] = []  # dead reckoning after each pair
        self.online: list[np.ndarray] = []  # the pose as it was known after each pair
        self.latest: LocalMap | None = None  # the local map that was closed last
        matched = self.settings.ego_motion == "matched"
        self._ego_motion = None
        if matched:
            correlated = math.radians(self.settings.correlated)
            self._ego_motion = EgoMotion(self.settings.cell, correlated)
        self._since: Motion | None = None  # the observation before
        self._closing = Motion.none(0)  # from the map's origin to where the last local map closed
        self._place = self._closing  # and to the last observation
        # Pairs that were observations, and where matched motion alone puts them.
        self._observed: list[int] = [0]
        self._matched: list[np.ndarray] = [np.zeros(3)]
        # Of those, the ones that closed a local map: there the filter's poses stand.
        self._closed: list[int] = [0]
        self._glimpses: list[Glimpse] = []  # of those local maps, for the smoothing
        # When the run is over: the filter's poses smoothed, and the map drawn along them.
        self._smoothed: tuple[np.ndarray, OccupancyGrid] | None = None
        self._known = known
        if known is not None and known.pose is not None:
            self._begin_at(known, known.pose)

    def add(self, scan: RangeScan, motion: Motion) -> np.ndarray:
        """Take in one pair; the robot's pose (3,) as it is known now."""
        due = self.gate.step(motion.increment)
        self.move(motion)
        if due:
            self.observe(scan)
        return self.pose

    @property
    def gate(self) -> ObservationGate:
        """Tells which pairs are observations; ask it ahead to spare the others' stereo."""
        return self.local_mapper.gate

    def move(self, motion: Motion) -> None:
        """The robot moved to where the next pair is taken."""
        previous = self.odometry[-1] if self.odometry else np.zeros(3)
        self.odometry.append(compose(previous, motion.increment))
        self.stamps.append(motion.last)
        self._since = motion if self._since is None else self._since.then(motion)
        self.online.append(compose(self._place.increment, self._since.increment))

    def observe(self, scan: RangeScan) -> None:
        """The scan of the pair just moved to; its place is known after `move`."""
        motion = self._since
        assert motion is not None, "move() comes before observe()"
        if self._ego_motion is not None:
            motion = self._ego_motion.refine(scan, motion)
        self._since = Motion.none(motion.last)
        self._observed.append(len(self.odometry) - 1)
        self._matched.append(compose(self._matched[-1], motion.increment))
        self.local_mapper.move(motion)
        local = self.local_mapper.observe(scan)
        if local is not None:
            self._close(local)
        self._place = self._closing.then(self.local_mapper.motion)
        self.online[-1] = self._place.increment

    @property
    def pose(self) -> np.ndarray:
        """The pose (3,) as it is known now: the particles' mean where the last local map closed,
        moved on by matched motion, and by odometry since the last observation."""
        return self.online[-1]

    @property
    def covariance(self) -> np.ndarray:
        """Of `pose` (3, 3), in the map's frame."""
        known = self._place if self._since is None else self._place.then(self._since)
        return known.covariance

    def finish(self) -> tuple[OccupancyGrid, np.ndarray]:
        """Use the last, shorter local map, smooth the path; the map and the path (pairs, 3)."""
        rest = self.local_mapper.flush()
        if rest is not None:
            self._close(rest)
        if self._glimpses:
            self._smoothed = self._smooth()
        return self.grid(), self.path()

    @property
    def smoothed(self) -> bool:
        """Whether `finish` smoothed the path."""
        return self._smoothed is not None

    def grid(self) -> OccupancyGrid:
        """The best particle's map; after `finish` drawn along the smoothed path. Where the robot
        has been it is free."""
        grid = self.filter.grid() if self._smoothed is None else self._smoothed[1]
        if self._known is not None and self._known.pose is None and not self.filter.health:
            return grid  # its place is still to be found
        stamps = np.array(self.stamps, np.int64)
        return with_footprint(grid, self.path(), stamps, self.settings.footprint or 0.0)

    def path(self) -> np.ndarray:
        """Poses (n, 3) of all pairs so far on the best particle's history; after `finish`
        smoothed."""
        odometry = np.array(self.odometry).reshape(-1, 3)
        if not len(odometry):
            return odometry
        observed = np.array(self._observed)
        matched = join(odometry, observed, np.array(self._matched))
        closed = self.filter.path() if self._smoothed is None else self._smoothed[0]
        return join(matched, observed[self._closed], closed)

    def _begin_at(self, known: KnownMap, pose: np.ndarray) -> None:
        maps = tile_maps(known.grid, self.settings.particles, self.settings)
        self.filter.begin_in(maps, pose)
        self._closing = self._place = Motion(np.asarray(pose, float))

    def _close(self, local: LocalMap) -> None:
        if self._known is not None and self._known.pose is None and not self.filter.health:
            here = locate(local, self._known.grid, self.settings)
            self._begin_at(self._known, compose(here, inverse(local.motion.increment)))
        self.filter.add(local)
        self._closing = self.filter.estimate()
        self.latest = local
        self._closed.append(len(self._observed) - 1)
        if self.settings.smoothing and self._known is None:
            self._glimpses.append(Glimpse.of(local))

    def _smooth(self) -> tuple[np.ndarray, OccupancyGrid] | None:
        """The filter's poses (steps + 1, 3), smoothed, and the map drawn along them.

        None where too much of what matched along the filter's path then no longer does: the filter
        weighs whole views, free space included, and may know what surfaces alone do not show.
        """
        path = self.filter.path()
        bent = self._bent(path)
        (_, before), (grid, after) = self.filter.redrawn(path), self.filter.redrawn(bent)
        lost = before - after
        if np.isfinite(lost).any() and np.nanmean(lost) > MAX_LOST:
            return None
        return bent, grid

    def _bent(self, path: np.ndarray) -> np.ndarray:
        """The filter's poses (steps + 1, 3), smoothed window by window."""
        steps = len(self._glimpses)
        # Windows of single observations are put together along the filter's path, which knows
        # more of them than the motion.
        known = path if self.settings.per_scan else np.array(self._matched)
        length = self.settings.window if self.settings.per_scan else 1
        ends = np.append(np.arange(0, steps, length), steps)
        surfaces = []
        for i, j in pairwise(ends.tolist()):
            first, last = self._closed[i] + 1, self._closed[j]
            frames = known[np.array(self._closed[i + 1 : j + 1])]
            middle = known[(first + last) // 2]
            surfaces.append(surface(self._glimpses[i:j], frames, middle, self.settings.cell))
        return join(path, ends, smooth(surfaces, path[ends], self.settings.cell))
