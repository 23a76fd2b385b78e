"""HierarchicalMapper: both stages and the path, for one pair after another.

mapper = HierarchicalMapper()
for scan, motion in data:
    pose = mapper.add(scan, motion)
grid, path = mapper.finish()
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mapping.gate import ObservationGate
from mapping.grid import OccupancyGrid
from mapping.local_map import LocalMap, LocalMapper
from mapping.particle_filter import ParticleFilter
from mapping.path import join
from mapping.settings import MappingSettings
from odometry.motion import Motion, compose, inverse
from stereo.scan import RangeScan


class HierarchicalMapper:
    """Scans and motion in, a map and a path out. The first pair stands at (0, 0, 0)."""

    def __init__(self, settings: MappingSettings | None = None, seed: int = 0):
        self.settings = settings or MappingSettings()
        self.local_mapper = LocalMapper(self.settings)
        self.filter = ParticleFilter(self.settings, seed)
        self.on_local_map: Callable[[LocalMap], None] | None = None
        self.stamps: list[int] = []
        self.odometry: list[np.ndarray] = []  # dead reckoning after each pair
        self.online: list[np.ndarray] = []  # the pose as it was known after each pair
        self._nodes: list[int] = [0]  # pairs at which the filter's poses stand

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
        self.local_mapper.move(motion)
        self.online.append(self._predicted())

    def observe(self, scan: RangeScan) -> None:
        """The scan of the pair just moved to; its place is known after `move`."""
        local = self.local_mapper.observe(scan)
        if local is not None:
            self._close(local)

    @property
    def pose(self) -> np.ndarray:
        """The best particle's pose (3,), moved on by odometry since the last local map."""
        return self.online[-1]

    def finish(self) -> tuple[OccupancyGrid, np.ndarray]:
        """Use the last, shorter local map; the best particle's map and path (pairs, 3)."""
        rest = self.local_mapper.flush()
        if rest is not None:
            self._close(rest)
        return self.filter.grid(), self.path()

    def path(self) -> np.ndarray:
        """Poses (n, 3) of all pairs so far on the best particle's history."""
        odometry = np.array(self.odometry).reshape(-1, 3)
        if not len(odometry):
            return odometry
        return join(odometry, np.array(self._nodes), self.filter.path())

    def _predicted(self) -> np.ndarray:
        since = compose(inverse(self.odometry[self._nodes[-1]]), self.odometry[-1])
        return compose(self.filter.poses[self.filter.best], since)

    def _close(self, local: LocalMap) -> None:
        self.filter.add(local)
        self._nodes.append(len(self.odometry) - 1)
        self.online[-1] = self._predicted()
        if self.on_local_map is not None:
            self.on_local_map(local)
