"""What the robot's body has driven through is free, and nothing else is changed."""

from __future__ import annotations

import numpy as np

from mapping.footprint import with_footprint
from mapping.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

CELL = 0.1
STRAIGHT = np.array([[0.25, 1.05, 0.0], [0.85, 1.05, 0.0], [1.45, 1.05, 0.0]])
STAMPS = np.array([0, 1, 2], np.int64) * 10**8


def wall() -> OccupancyGrid:
    """Known obstacles from x = 0 to 2 m and y = 0 to 2 m."""
    return OccupancyGrid(np.full((20, 20), 0.9, np.float32), (0.0, 0.0), CELL)


def free(grid: OccupancyGrid) -> np.ndarray:
    """Middles (n, 2) of the free cells [m]."""
    rows, columns = np.nonzero(grid.classes == FREE)
    return (np.stack([columns, rows], axis=1) + 0.5) * grid.cell + grid.origin


def test_the_way_between_two_poses_is_free_as_wide_as_the_body():
    grid = with_footprint(wall(), STRAIGHT, STAMPS, 0.22)
    x, y = free(grid).T
    along = np.clip(x, 0.25, 1.45)
    away = np.hypot(x - along, y - 1.05)
    assert away.max() < 0.22 + CELL / 4
    # Every cell whose middle lies well within is free; all others are what they were.
    rows, columns = np.indices(grid.classes.shape)
    x, y = (columns + 0.5) * CELL, (rows + 0.5) * CELL
    away = np.hypot(x - np.clip(x, 0.25, 1.45), y - 1.05)
    assert (grid.classes[away < 0.22 - CELL / 4] == FREE).all()
    assert (grid.classes[away > 0.22 + CELL / 4] == OCCUPIED).all()


def test_without_a_body_the_cells_under_the_path_are_free():
    x, y = free(with_footprint(wall(), STRAIGHT, STAMPS, 0.0)).T
    assert sorted(set(y.round(3))) == [1.05]
    np.testing.assert_allclose(np.sort(x), np.arange(0.25, 1.46, 0.1))


def test_the_map_grows_where_the_robot_leaves_it():
    path = np.array([[-0.35, 0.55, 0.0], [0.25, 2.33, 0.0]])
    before = wall()
    grid = with_footprint(before, path, STAMPS[:2], 0.1)
    np.testing.assert_allclose(np.round(np.array(grid.origin) / CELL) * CELL, grid.origin)
    for x, y in path[:, :2]:
        column, row = np.floor((np.array([x, y]) - grid.origin) / CELL).astype(int)
        assert grid.classes[row, column] == FREE
    assert (grid.classes == UNKNOWN).any()
    assert (before.classes == OCCUPIED).all()  # a copy


def test_over_a_gap_in_time_no_way_is_made_up():
    stamps = np.array([0, 1, 2, 60, 61], np.int64) * 10**8
    path = np.array([[0.15, 0.15, 0], [0.15, 0.25, 0], [0.15, 0.35, 0], [1.75, 1.75, 0],
                     [1.75, 1.85, 0]])  # fmt: skip
    cells = free(with_footprint(wall(), path, stamps, 0.0))
    assert len(cells) == 5
    assert not ((cells > 0.5) & (cells < 1.6)).any()


def test_no_pose_or_one():
    grid = wall()
    assert with_footprint(grid, np.empty((0, 3)), np.empty(0, np.int64), 0.2) is grid
    assert len(free(with_footprint(grid, STRAIGHT[:1], STAMPS[:1], 0.0))) == 1
