"""Key frames of the point cloud: kept on the disk, merged place by place, in bounded memory.

The path still moves when the run is over, so that points are kept as the robot saw them and put
together at the end. What is in memory then is one square of the map, however long the run was.
"""

from __future__ import annotations

import os
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from mapping.clouds import VOXEL
from odometry.motion import compose

SQUARE = 8.0  # side of what is put together at a time [m]
BATCH = 200_000  # points between two mergings


@dataclass
class KeyFrame:
    """Points (n, 3) float32 on the robot [m] with colours (n, 3) uint8, seen at pair `index`."""

    index: int
    points: np.ndarray
    colours: np.ndarray


class KeyFrames:
    """Key frames in a temporary file without a name: it is gone with the process.

    lost: frames that found no room on the disk.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._file: BinaryIO | None = None
        self._places: list[tuple[int, int, int]] = []  # index of the pair, offset, points
        self._end = 0

    def __len__(self) -> int:
        return len(self._places)

    def append(self, frame: KeyFrame) -> None:
        """Keep a frame; one for which there is no room is counted."""
        points = np.ascontiguousarray(frame.points, np.float32)
        data = points.tobytes() + np.ascontiguousarray(frame.colours, np.uint8).tobytes()
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(dir=_disk())  # noqa: SIM115 - for the whole run
            self._file.seek(self._end)
            self._file.write(data)
            self._file.flush()
        except OSError:
            self.lost += 1
            return
        self._places.append((frame.index, self._end, len(points)))
        self._end += len(data)

    def __getitem__(self, number: int) -> KeyFrame:
        index, offset, count = self._places[number]
        assert self._file is not None
        self._file.seek(offset)
        data = self._file.read(15 * count)
        points = np.frombuffer(data, np.float32, 3 * count).reshape(-1, 3)
        colours = np.frombuffer(data, np.uint8, offset=12 * count).reshape(-1, 3)
        return KeyFrame(index, points, colours)

    def merged(
        self, path: np.ndarray, voxel: float = VOXEL
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """All points along the path (pairs, 3), those in one cube of side `voxel` [m] made one.

        Yields (points (n, 3) [m], colours (n, 3) in 0..1), square by square.
        """
        size = max(1, round(SQUARE / voxel))  # cubes along a square's side
        seen_from: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
        for number in range(len(self)):
            squares = np.floor_divide(_cubes(self[number], path, voxel)[0][:, :2], size)
            for x, y in np.unique(squares, axis=0).tolist():
                seen_from[x, y].append(number)
        for square in sorted(seen_from):
            cubes = _Cubes()
            for number in seen_from[square]:
                keys, values = _cubes(self[number], path, voxel)
                inside = (np.floor_divide(keys[:, :2], size) == square).all(axis=1)
                cubes.add(keys[inside], values[inside])
            yield cubes.means()


class _Cubes:
    """Sums over the points in each cube; few points more than cubes are in memory."""

    def __init__(self) -> None:
        self._keys = [np.empty((0, 3), np.int32)]
        self._sums = [np.empty((0, 7))]
        self._waiting = 0

    def add(self, keys: np.ndarray, values: np.ndarray) -> None:
        """Points in the cubes `keys` (n, 3): position and colour (n, 6)."""
        self._keys.append(keys)
        self._sums.append(np.column_stack([values, np.ones(len(values))]))
        self._waiting += len(keys)
        if self._waiting > BATCH:
            self._merge()

    def means(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean positions (n, 3) and colours (n, 3), in order of the cubes."""
        self._merge()
        sums = self._sums[0]
        means = sums[:, :6] / sums[:, 6:]
        return means[:, :3], means[:, 3:]

    def _merge(self) -> None:
        keys, sums = np.concatenate(self._keys), np.concatenate(self._sums)
        order = np.lexsort(keys.T)
        keys, sums = keys[order], sums[order]
        first = np.ones(len(keys), bool)
        first[1:] = (np.diff(keys, axis=0) != 0).any(axis=1)
        begins = np.flatnonzero(first)
        self._keys = [keys[begins]]
        self._sums = [np.add.reduceat(sums, begins) if len(begins) else sums]
        self._waiting = 0


def _cubes(frame: KeyFrame, path: np.ndarray, voxel: float) -> tuple[np.ndarray, np.ndarray]:
    """Of each point the cube (n, 3) int32 that it lies in, and its position and colour (n, 6)."""
    planar = np.column_stack([frame.points[:, :2], np.zeros(len(frame.points))])
    xy = compose(path[frame.index], planar)[:, :2]
    world = np.column_stack([xy, frame.points[:, 2]])
    cubes = np.floor(world / voxel).astype(np.int32)
    return cubes, np.column_stack([world, frame.colours / 255.0])


def _disk() -> Path | None:
    """Where there is room: /tmp is memory on many a small machine."""
    large = Path("/var/tmp")
    return large if "TMPDIR" not in os.environ and os.access(large, os.W_OK) else None
