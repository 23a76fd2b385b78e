"""The inner loops of stage 2 equal their twins in plain numpy: touched, match, update."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from mapping.global_kernels import (
    FREE,
    NEAR_OCCUPIED,
    OBSERVED,
    OCCUPIED,
    POSSIBLE,
    match,
    touched,
    update,
)
from mapping.local_cells import LocalCells, classify
from mapping.sensor_model import SensorModel
from mapping.settings import MappingSettings
from mapping.tiles import NO_TILE, TILE, UNKNOWN, TileMaps
from odometry.motion import compose, inverse
from tests.mapping_data import CELL, filled_maps, local_map

MODEL = SensorModel.of(MappingSettings())
THRESHOLD = 20.0  # of an obstacle, in steps of int8
HIT, MISS = 40, -16


def marks(tiles: np.ndarray) -> np.ndarray:
    """The bits (n, TILE) of the obstacle cells of tiles (n, TILE, TILE)."""
    bits = np.uint32(1) << np.arange(TILE, dtype=np.uint32)
    return np.bitwise_or.reduce(np.where(tiles > THRESHOLD, bits, np.uint32(0)), axis=2)


def marked_maps(rng: np.random.Generator, particles: int) -> TileMaps:
    """Random maps with their obstacles marked."""
    maps = filled_maps(rng, particles)
    maps.obstacles[:] = marks(maps.tiles)
    return maps


def random_cells(rng: np.random.Generator, few: bool = False) -> LocalCells:
    """A local map of cells of all kinds; `few`: only here and there one that is decided."""
    shape = (45, 60)
    L = np.where(rng.random(shape) < 0.2, np.nan, rng.normal(0, 2, shape))
    if few:
        L = np.where(rng.random(shape) < 0.02, L, 0.0)
    blurred = local_map(L, origin=(-1.0, -0.7))
    return classify(replace(blurred, possible=rng.random(shape) < 0.2), MODEL, 1)


@dataclass(frozen=True)
class Cells:
    """Every cell of one particle's table, flat; `local`: the local map's bits there."""

    row: np.ndarray
    column: np.ndarray
    i: np.ndarray
    j: np.ndarray
    value: np.ndarray
    local: np.ndarray


def global_cells(maps: TileMaps, k: int, pose: np.ndarray, cells: LocalCells) -> Cells:
    """The local map looked up under the middle of every cell, by the poses' algebra."""
    shape = (*maps.table.shape[1:], TILE, TILE)
    row, column, i, j = (a.ravel() for a in np.indices(shape))
    y = ((row + maps.corner[0]) * TILE + i + 0.5) * CELL
    x = ((column + maps.corner[1]) * TILE + j + 0.5) * CELL
    place = compose(inverse(pose), np.stack([x, y, np.zeros_like(x)], axis=1))
    u = np.floor((place[:, 0] - cells.origin[0]) / CELL).astype(int)
    v = np.floor((place[:, 1] - cells.origin[1]) / CELL).astype(int)
    inside = (u >= 0) & (u < cells.bits.shape[1]) & (v >= 0) & (v < cells.bits.shape[0])
    local = np.where(inside, cells.bits[np.where(inside, v, 0), np.where(inside, u, 0)], 0)
    number = maps.table[k, row, column]
    value = np.where(number == NO_TILE, UNKNOWN, maps.tiles[number, i, j])
    return Cells(row, column, i, j, value, local)


POSES = np.array([[0.31, 0.42, 0.4], [-0.2, 0.1, -2.0], [1.9, -1.2, 3.0], [40.0, 0.0, 0.0]])


def test_match_equals_its_numpy_twin():
    rng = np.random.default_rng(3)
    maps, cells = marked_maps(rng, len(POSES)), random_cells(rng)
    overlap, matched = match(
        maps.obstacles, maps.table, maps.corner, POSES, cells.bits, *cells.origin, CELL
    )
    for k, pose in enumerate(POSES):
        twin = global_cells(maps, k, pose, cells)
        S = (twin.value > THRESHOLD) & (twin.local & OBSERVED > 0)
        near = S & (twin.local & NEAR_OCCUPIED > 0)
        possible = S & ~near & (twin.local & POSSIBLE > 0)
        assert overlap[k] == S.sum()
        assert matched[k] == near.sum() + 0.5 * possible.sum()
    assert (overlap[:2] > 300).all()
    assert overlap[3] == 0


@pytest.mark.parametrize("few", [False, True])
def test_touched_are_the_tiles_that_hold_a_decided_cell(few):
    rng = np.random.default_rng(5)
    for _ in range(5):
        maps, cells = marked_maps(rng, 3), random_cells(rng, few)
        poses = rng.uniform([-2.0, -2.0, -4.0], [2.0, 2.0, 4.0], (3, 3))
        needed = touched(
            maps.table, maps.corner, poses, cells.bits, cells.near, *cells.origin, CELL
        )
        for k, pose in enumerate(poses):
            twin = global_cells(maps, k, pose, cells)
            decided = twin.local & (OCCUPIED | FREE) > 0
            expected = np.zeros(needed.shape[1:], bool)
            expected[twin.row[decided], twin.column[decided]] = True
            np.testing.assert_array_equal(needed[k], expected)


@pytest.mark.parametrize("few", [False, True])
def test_update_equals_its_numpy_twin_and_changes_no_other_particles_map(few):
    rng = np.random.default_rng(4)
    for pose in POSES[:3]:
        maps, cells = marked_maps(rng, 2), random_cells(rng, few)
        maps.resample(np.array([0, 0]))
        before, other = global_cells(maps, 0, pose, cells), maps.log_odds(1)[0]
        poses = np.array([pose, pose])
        place = (*cells.origin, CELL)
        needed = touched(maps.table, maps.corner, poses, cells.bits, cells.near, *place)
        needed[1] = False  # only the first particle writes
        maps.make_writable(needed)
        update(
            maps.tiles,
            maps.obstacles,
            maps.table,
            maps.corner,
            needed,
            poses,
            cells.bits,
            cells.near,
            *cells.origin,
            CELL,
            HIT,
            MISS,
            THRESHOLD,
        )
        step = np.where(before.local & OCCUPIED, HIT, np.where(before.local & FREE, MISS, 0))
        assert np.count_nonzero(step) > (3 if few else 500)
        known = np.where(before.value == UNKNOWN, 0, before.value.astype(int))
        expected = np.where(step == 0, before.value, np.clip(known + step, -127, 127))
        np.testing.assert_array_equal(global_cells(maps, 0, pose, cells).value, expected)
        np.testing.assert_array_equal(maps.log_odds(1)[0], other)
        used = np.unique(maps.table[maps.table != NO_TILE])
        np.testing.assert_array_equal(maps.obstacles[used], marks(maps.tiles[used]))


def test_a_local_map_reaches_the_cells_that_it_says():
    """Corners of a turned local map lie within the rows and columns asked for, none in vain."""
    cells = random_cells(np.random.default_rng(0))
    low, high = cells.reached_from(POSES[:3])
    height, width = cells.bits.shape
    x, y = cells.origin
    corners = np.array(
        [[x + i * width * CELL, y + j * height * CELL, 0.0] for i in (0, 1) for j in (0, 1)]
    )
    at = np.array([compose(pose, corner)[1::-1] for pose in POSES[:3] for corner in corners])
    np.testing.assert_array_equal(low, [math.floor(v / CELL) for v in at.min(axis=0)])
    np.testing.assert_array_equal(high, [math.floor(v / CELL) for v in at.max(axis=0)])
