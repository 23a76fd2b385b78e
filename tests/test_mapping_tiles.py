"""The particles' maps: tiles shared by copy on write behave as maps of their own."""

import numpy as np
import pytest

from mapping.sensor_model import CLAMP, SensorModel
from mapping.settings import MappingSettings
from mapping.tiles import NO_TILE, STEPS_PER_LOG_ODDS, TILE, UNKNOWN, TileMaps

N = 5


class Twin:
    """The same maps, every particle with a whole dense array of its own around cell (0, 0)."""

    def __init__(self, reach: int):
        self.reach = reach
        side = 2 * reach * TILE
        self.values = np.full((N, side, side), UNKNOWN, np.int8)
        self.obstacles = np.zeros((N, side, side), bool)

    def tile(self, row: int, column: int) -> tuple[slice, slice]:
        """Where the tile (row, column) of the global grid lies."""
        i, j = (row + self.reach) * TILE, (column + self.reach) * TILE
        return slice(i, i + TILE), slice(j, j + TILE)


def bits_of(marks: np.ndarray) -> np.ndarray:
    """(TILE,) uint32 as (TILE, TILE) bool."""
    return (marks[:, None] >> np.arange(TILE, dtype=np.uint32)) & 1 == 1


def write(maps: TileMaps, twin: Twin, needed: np.ndarray, rng: np.random.Generator) -> None:
    """Random values into the tiles `needed` of both, a few cells a tile."""
    maps.make_writable(needed)
    for k, row, column in np.argwhere(needed):
        place = twin.tile(row + maps.corner[0], column + maps.corner[1])
        number = maps.table[k, row, column]
        for i, j in rng.integers(0, TILE, (4, 2)):
            value, obstacle = rng.integers(-127, 128), rng.random() < 0.5
            maps.tiles[number, i, j] = value
            twin.values[k][place][i, j] = value
            bit = np.uint32(1) << np.uint32(j)
            mark = maps.obstacles[number, i]
            maps.obstacles[number, i] = mark | bit if obstacle else mark & ~bit
            twin.obstacles[k][place][i, j] = obstacle


def check(maps: TileMaps, twin: Twin) -> None:
    """Every particle sees its twin's map, and the references are those of the table."""
    counted = np.bincount(maps.table[maps.table != NO_TILE], minlength=len(maps.references))
    np.testing.assert_array_equal(maps.references, counted)
    assert maps.tiles_in_use == len(np.unique(maps.table[maps.table != NO_TILE]))
    for k in range(N):
        values = np.full_like(twin.values[k], UNKNOWN)
        obstacles = np.zeros_like(twin.obstacles[k])
        for row, column in np.ndindex(*maps.table.shape[1:]):
            number = maps.table[k, row, column]
            if number != NO_TILE:
                place = twin.tile(row + maps.corner[0], column + maps.corner[1])
                values[place], obstacles[place] = (
                    maps.tiles[number],
                    bits_of(maps.obstacles[number]),
                )
        np.testing.assert_array_equal(values, twin.values[k])
        np.testing.assert_array_equal(obstacles, twin.obstacles[k])


@pytest.mark.parametrize("seed", range(3))
def test_any_mix_of_writing_resampling_and_growing_equals_dense_maps(seed):
    rng = np.random.default_rng(seed)
    maps, twin = TileMaps(N), Twin(reach=4)
    for _ in range(25):
        low = rng.integers(-3 * TILE, TILE, 2)
        maps.cover(low, low + rng.integers(1, 2 * TILE, 2))
        write(maps, twin, rng.random(maps.table.shape) < rng.choice([0.05, 0.5]), rng)
        if rng.random() < 0.5:
            ancestors = np.sort(rng.integers(0, N, N))
            maps.resample(ancestors)
            twin.values, twin.obstacles = twin.values[ancestors], twin.obstacles[ancestors]
        check(maps, twin)


def test_tiles_are_shared_by_resampling_and_freed_when_nobody_holds_them():
    maps = TileMaps(4)
    maps.cover(np.array([0, 0]), np.array([TILE - 1, 2 * TILE - 1]))
    maps.make_writable(np.ones(maps.table.shape, bool))
    assert maps.tiles_in_use == 8
    maps.resample(np.array([1, 1, 1, 1]))
    assert maps.tiles_in_use == 2
    one = np.zeros(maps.table.shape, bool)
    one[2, 0, 1] = True
    maps.make_writable(one)
    assert maps.tiles_in_use == 3
    assert len(np.unique(maps.table[:, 0, 1])) == 2


def test_resampling_copies_no_tile_and_takes_no_memory():
    maps = TileMaps(50)
    maps.cover(np.array([0, 0]), np.array([4 * TILE - 1, 4 * TILE - 1]))
    maps.make_writable(np.ones(maps.table.shape, bool))
    pool, size = maps.tiles, maps.bytes
    maps.resample(np.zeros(50, int))
    assert maps.tiles is pool
    assert maps.bytes == size
    assert maps.tiles_in_use == 16


def test_a_particle_alone_writes_in_place():
    maps = TileMaps(2)
    maps.cover(np.array([0, 0]), np.array([TILE - 1, TILE - 1]))
    needed = np.ones(maps.table.shape, bool)
    maps.make_writable(needed)
    table = maps.table.copy()
    maps.make_writable(needed)
    np.testing.assert_array_equal(maps.table, table)


def test_a_tile_that_is_used_again_tells_nothing_of_its_past():
    maps = TileMaps(1)
    maps.cover(np.array([0, 0]), np.array([TILE - 1, TILE - 1]))
    maps.make_writable(np.ones((1, 1, 1), bool))
    maps.tiles[:], maps.obstacles[:] = 100, 0xFFFFFFFF
    maps.table[:] = NO_TILE
    maps.resample(np.array([0]))
    maps.make_writable(np.ones((1, 1, 1), bool))
    assert np.isnan(maps.log_odds(0)[0]).all()
    assert not maps.obstacles[maps.table[0, 0, 0]].any()


def test_the_grid_grows_in_every_direction_and_keeps_its_cells():
    maps = TileMaps(1)
    maps.cover(np.array([5, 5]), np.array([6, 6]))
    maps.make_writable(np.ones(maps.table.shape, bool))
    maps.tiles[maps.table[0, 0, 0], 5, 6] = 100
    maps.cover(np.array([-100, -40]), np.array([90, 70]))
    grid, corner = maps.log_odds(0)
    row, column = np.argwhere(grid == np.nanmax(grid))[0]
    assert (row + corner[1], column + corner[0]) == (5, 6)
    assert np.count_nonzero(~np.isnan(grid)) == 1


def test_steps_of_int8_keep_eqs_1_and_2():
    """The clamp is the last step; one hit or miss is off by half a step at most."""
    model = SensorModel.of(MappingSettings())
    assert pytest.approx(127) == STEPS_PER_LOG_ODDS * CLAMP
    for step in (model.occupied_step, model.free_step):
        stored = round(step * STEPS_PER_LOG_ODDS) / STEPS_PER_LOG_ODDS
        assert abs(stored - step) < 0.015
