"""The point cloud of a run: right, readable, and no larger in memory for a longer run."""

from __future__ import annotations

import errno
import tempfile
import tracemalloc
from collections import defaultdict

import numpy as np

from mapping.clouds import import_open3d, map_points, write_ply
from mapping.grid import OccupancyGrid
from odometry.motion import compose
from pipeline.key_frames import KeyFrame, KeyFrames


def frames(count: int, points: int, apart: float = 0.5) -> tuple[KeyFrames, np.ndarray]:
    """Key frames along a straight path, their points within 4 m; and the path."""
    rng = np.random.default_rng(1)
    path = np.column_stack([apart * np.arange(count), np.zeros(count), np.full(count, 0.1)])
    kept = KeyFrames()
    for index in range(count):
        cloud = rng.uniform((0.3, -2.0, 0.0), (4.0, 2.0, 1.0), (points, 3)).astype(np.float32)
        kept.append(KeyFrame(index, cloud, rng.integers(0, 256, (points, 3), dtype=np.uint8)))
    return kept, path


def test_points_in_one_cube_become_their_mean(tmp_path):
    kept, path = frames(40, 200)
    wanted = defaultdict(list)
    for number in range(len(kept)):
        frame = kept[number]
        for (x, y, z), colour in zip(frame.points.astype(float), frame.colours, strict=True):
            px, py, _ = compose(path[frame.index], np.array([x, y, 0.0]))
            cube = tuple(np.floor(np.array([px, py, z]) / 0.25).astype(int))
            wanted[cube].append([px, py, z, *(colour / 255.0)])
    parts = list(kept.merged(path, 0.25))
    found = np.vstack([np.hstack(part) for part in parts])
    assert len(parts) > 3
    assert len(found) == len(wanted)
    means = {cube: np.mean(rows, axis=0) for cube, rows in wanted.items()}
    cubes = [tuple(row) for row in np.floor(found[:, :3] / 0.25).astype(int)]
    np.testing.assert_allclose(found, [means[cube] for cube in cubes], atol=1e-9)
    assert write_ply(tmp_path / "cloud.ply", parts) == len(found)
    cloud = import_open3d().io.read_point_cloud(tmp_path / "cloud.ply")
    np.testing.assert_array_equal(np.asarray(cloud.points), found[:, :3])
    np.testing.assert_allclose(np.asarray(cloud.colors), found[:, 3:], atol=0.5 / 255 + 1e-9)


def test_a_map_as_points(tmp_path):
    probability = np.full((600, 3), np.nan, np.float32)
    probability[0, 0], probability[599, 2] = 1.0, 0.25
    count = write_ply(
        tmp_path / "map.ply", map_points(OccupancyGrid(probability, (-1.0, 2.0), 0.5))
    )
    assert count == 2
    cloud = import_open3d().io.read_point_cloud(tmp_path / "map.ply")
    np.testing.assert_allclose(np.asarray(cloud.points), [[-0.75, 2.25, 0.0], [0.25, 301.75, 0.0]])
    np.testing.assert_allclose(np.asarray(cloud.colors)[:, 0], [0.0, 1.0])
    assert write_ply(tmp_path / "map.ply", []) == 0
    assert b"element vertex 0\n" in (tmp_path / "map.ply").read_bytes()


def test_memory_does_not_grow_with_the_run(tmp_path):
    peaks = []
    for count in (20, 200):
        kept, path = frames(count, 3000)
        tracemalloc.start()
        write_ply(tmp_path / "cloud.ply", kept.merged(path))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert (tmp_path / "cloud.ply").stat().st_size > peaks[1]
    assert peaks[1] < 1.5 * peaks[0]


def test_a_full_disk_costs_frames_that_are_counted(monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    kept, path = frames(3, 10)
    assert (len(kept), kept.lost) == (0, 3)
    assert list(kept.merged(path)) == []
