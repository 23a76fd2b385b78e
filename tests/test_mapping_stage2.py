"""Stage 2: tiles, matching, updating, resampling, the filter and its path."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
from mapping.local_map import LocalMap
from mapping.mapper import HierarchicalMapper
from mapping.particle_filter import (
    ParticleFilter,
    classify,
    log_likelihoods,
    systematic_resample,
)
from mapping.path import join
from mapping.sensor_model import SensorModel, log_odds
from mapping.settings import MappingSettings
from mapping.tiles import NO_TILE, TILE, UNKNOWN, TileMaps
from odometry.motion import Motion, compose, inverse
from tests.test_mapping_stage1 import scan

MODEL = SensorModel.of(MappingSettings())


def local_map(log_odds_grid, origin=(0.0, 0.0), cell=0.05, motion=None):
    L = np.asarray(log_odds_grid, np.float32)
    with np.errstate(invalid="ignore"):
        possible = MODEL.occupied_above < L
    return LocalMap(
        L,
        possible,
        origin,
        cell,
        motion or Motion.none(0),
        0,
        10,
        1.0,
    )


def filled_maps(rng, particles, tiles_each_way=3):
    """Maps with random tiles, some of them missing."""
    maps = TileMaps(particles)
    maps.cover(np.array([-TILE, -TILE]), np.array([tiles_each_way * TILE - TILE - 1] * 2))
    maps.make_writable(rng.random(maps.table.shape) < 0.8)
    maps.tiles[:] = rng.integers(-128, 128, maps.tiles.shape)
    return maps


def random_bits(rng, shape):
    L = np.where(rng.random(shape) < 0.2, np.nan, rng.normal(0, 2, shape))
    blurred = local_map(L)
    return classify(replace(blurred, possible=rng.random(shape) < 0.2), MODEL, 1)


def global_cells(maps, k):
    """(cell centre x, y, flat value) of every cell of particle k's table, unknown included."""
    rows, columns = maps.table.shape[1:]
    for row, column in np.ndindex(rows, columns):
        number = maps.table[k, row, column]
        for i, j in np.ndindex(TILE, TILE):
            y = ((row + maps.corner[0]) * TILE + i + 0.5) * 0.05
            x = ((column + maps.corner[1]) * TILE + j + 0.5) * 0.05
            yield row, column, i, j, x, y, number


def looked_up(bits, pose, x, y, origin):
    d = compose(inverse(pose), np.array([x, y, 0.0]))
    u, v = math.floor((d[0] - origin[0]) / 0.05), math.floor((d[1] - origin[1]) / 0.05)
    inside = 0 <= u < bits.shape[1] and 0 <= v < bits.shape[0]
    return int(bits[v, u]) if inside else 0


def test_match_equals_its_numpy_twin():
    rng = np.random.default_rng(3)
    maps, bits, origin = filled_maps(rng, 2), random_bits(rng, (45, 60)), (-1.0, -0.7)
    poses = np.array([[0.31, 0.42, 0.4], [-0.2, 0.1, -2.0]])
    overlap, matched = match(maps.tiles, maps.table, maps.corner, poses, bits, *origin, 0.05, 20.0)
    for k in range(2):
        S = n = 0
        for _, _, i, j, x, y, number in global_cells(maps, k):
            if number != NO_TILE and maps.tiles[number, i, j] > 20:
                b = looked_up(bits, poses[k], x, y, origin)
                S += bool(b & OBSERVED)
                if b & OBSERVED:
                    n += 1.0 if b & NEAR_OCCUPIED else 0.5 if b & POSSIBLE else 0.0
        assert (overlap[k], matched[k]) == (S, n)
        assert S > 100


def test_update_equals_its_numpy_twin_and_touches_no_shared_tile():
    rng = np.random.default_rng(4)
    maps, bits, origin = filled_maps(rng, 2), random_bits(rng, (45, 60)), (-1.0, -0.7)
    maps.resample(np.array([0, 0]))
    before = [maps.log_odds(k)[0] for k in range(2)]
    np.testing.assert_array_equal(before[0], before[1])
    poses = np.array([[0.31, 0.42, 0.4], [-0.2, 0.1, -2.0]])
    needed = touched(maps.table, maps.corner, poses, bits, *origin, 0.05)
    needed[1] = False  # only the first particle writes
    values = {
        (r, c, i, j): maps.tiles[number, i, j] if number != NO_TILE else UNKNOWN
        for r, c, i, j, _, _, number in global_cells(maps, 0)
    }
    maps.make_writable(needed)
    update(maps.tiles, maps.table, maps.corner, needed, poses, bits, *origin, 0.05, 40, -16)
    for r, c, i, j, x, y, number in global_cells(maps, 0):
        b = looked_up(bits, poses[0], x, y, origin)
        value = int(values[r, c, i, j])
        if b & (OCCUPIED | FREE):
            step = 40 if b & OCCUPIED else -16
            value = min(max((0 if value == UNKNOWN else value) + step, -127), 127)
        assert (maps.tiles[number, i, j] if number != NO_TILE else UNKNOWN) == value
    np.testing.assert_array_equal(maps.log_odds(1)[0], before[1])


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


def test_eq_8_rewards_matching_and_the_unjudged_get_the_mean():
    overlap = np.array([100, 100, 200, 10, 0])
    matched = np.array([100, 50, 150, 10, 0])
    log_l = log_likelihoods(overlap, matched, MappingSettings(match_weight=50.0))
    np.testing.assert_allclose(log_l[:3], [0.0, -25.0, -12.5])
    mean = math.log((1.0 + math.exp(-25.0) + math.exp(-12.5)) / 3.0)
    np.testing.assert_allclose(log_l[3:], mean)
    assert (log_likelihoods(overlap[3:], matched[3:], MappingSettings()) == 0).all()


def test_classify_by_the_thresholds_with_tolerance_one():
    p = np.array([[0.5, 0.71, 0.69], [0.19, 0.21, np.nan], [0.5, 0.5, 0.5], [0.5, 0.5, 0.5]])
    with np.errstate(invalid="ignore"):
        L = np.log(p / (1 - p))
    bits = classify(local_map(L), MODEL, 1)
    assert (bits & OCCUPIED > 0).tolist() == [[False, True, False]] + [[False] * 3] * 3
    assert (bits & FREE > 0)[1].tolist() == [True, False, False]
    assert (bits & OBSERVED > 0)[1].tolist() == [True, True, False]
    assert (bits & NEAR_OCCUPIED > 0).tolist() == [[True] * 3] * 2 + [[False] * 3] * 2
    exact = classify(local_map(L), MODEL, 0)
    assert ((exact & NEAR_OCCUPIED > 0) == (exact & OCCUPIED > 0)).all()


def test_resampling_is_unbiased_within_its_statistical_error():
    rng = np.random.default_rng(0)
    weights = rng.random(20)
    weights /= weights.sum()
    runs = 4000
    counts = np.zeros(20)
    for _ in range(runs):
        counts += np.bincount(systematic_resample(weights, rng.random()), minlength=20)
    expected = 20 * weights
    fraction = expected % 1.0
    error = np.sqrt(np.maximum(fraction * (1 - fraction), 1e-9) / runs)
    assert (np.abs(counts / runs - expected) <= 4 * error + 1e-6).all()


@given(
    st.lists(st.floats(0, 1), min_size=1, max_size=50).filter(lambda w: sum(w) > 1e-6),
    st.floats(0, 1, exclude_max=True),
)
@settings(max_examples=200, deadline=None)
def test_resampling_always_names_existing_particles_of_weight(weights, offset):
    w = np.array(weights) / sum(weights)
    chosen = systematic_resample(w, offset)
    assert len(chosen) == len(w)
    assert ((chosen >= 0) & (chosen < len(w))).all()
    counts = np.bincount(chosen, minlength=len(w))
    assert (np.abs(counts - len(w) * w) < 1 + 1e-6).all()


def room_ranges(pose, n=265, fov=66.0):
    """Exact ranges in a 6 x 4 m room with a pillar in it, from a pose in the room's frame."""
    angles = pose[2] + np.linspace(-math.radians(fov) / 2, math.radians(fov) / 2, n)
    c, s = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = [(3.0 - pose[0]) / c, (-3.0 - pose[0]) / c, (2.0 - pose[1]) / s, (-2.0 - pose[1]) / s]
        t = np.where(np.array(t) > 1e-9, t, np.inf).min(axis=0)
        b = (pose[0] - 0.5) * c + (pose[1] - 0.4) * s
        gap = b * b - ((pose[0] - 0.5) ** 2 + (pose[1] - 0.4) ** 2 - 0.25**2)
        hit = np.where((gap > 0) & (b < 0), -b - np.sqrt(np.maximum(gap, 0)), np.inf)
    return np.minimum(t, hit)


def drive(settings_, seed, noise, steps=160):
    """Once and a half round the room with noisy odometry; the mapper and the true path."""
    rng = np.random.default_rng(100 + seed)
    mapper = HierarchicalMapper(settings_, seed)
    angle = np.arange(steps + 1) * 0.12 / 1.2
    true = np.stack([1.9 * np.cos(angle), 1.2 * np.sin(angle), np.zeros_like(angle)], axis=1)
    true[:, 2] = np.arctan2(1.2 * np.cos(angle), -1.9 * np.sin(angle))
    covariance = np.diag([noise[0] ** 2, noise[0] ** 2, noise[1] ** 2])
    previous = true[0]
    for i, pose in enumerate(true):
        step = compose(inverse(previous), pose)
        if i:
            step = step + rng.normal(0, 1, 3) * [noise[0], noise[0], noise[1]]
        mapper.add(
            scan(room_ranges(pose), max_range=8.0),
            Motion(step, covariance if i else np.zeros((3, 3)), max(i - 1, 0), i),
        )
        previous = pose
    return mapper, compose(inverse(true[0]), true)


def rmse(a, b):
    return float(np.sqrt(np.mean(np.sum((a[:, :2] - b[:, :2]) ** 2, axis=1))))


def test_perfect_odometry_gives_the_exact_path_and_straight_walls():
    mapper, true = drive(MappingSettings(particles=1), 0, (0.0, 0.0))
    grid, path = mapper.finish()
    np.testing.assert_allclose(path, true, atol=1e-9)
    occupied = grid.probability > 0.7
    assert 200 < occupied.sum() < 1200


def test_after_three_laps_the_filter_beats_dead_reckoning():
    """The first lap's drift goes into the map; what is driven on it again drifts no further."""
    errors = []
    for seed in (1, 2, 3):
        settings_ = MappingSettings(particles=100)
        mapper, true = drive(settings_, seed, (0.01, math.radians(0.4)), steps=300)
        _, path = mapper.finish()
        errors.append((rmse(path, true), rmse(np.array(mapper.odometry), true)))
    filtered, dead = np.mean(errors, axis=0)
    assert dead > 0.25
    assert filtered < 0.6 * dead


def test_best_path_ends_where_the_best_particle_is_and_health_is_complete():
    mapper, _ = drive(MappingSettings(particles=20), 2, (0.01, math.radians(0.6)))
    mapper.finish()
    f = mapper.filter
    path = f.path()
    np.testing.assert_array_equal(path[-1], f.poses[f.best])
    assert len(path) == len(f.health) + 1
    assert all(1.0 - 1e-9 <= h.n_eff <= 20.0 + 1e-9 for h in f.health)
    assert any(h.resampled for h in f.health)


def test_a_rotated_world_gives_the_same_run():
    """The start is (0, 0, 0) whatever the room's frame: the map depends on the data alone."""
    a, _ = drive(MappingSettings(particles=5), 3, (0.01, 0.01), steps=40)
    b, _ = drive(MappingSettings(particles=5), 3, (0.01, 0.01), steps=40)
    np.testing.assert_array_equal(a.finish()[1], b.finish()[1])
    np.testing.assert_array_equal(a.filter.grid().probability, b.filter.grid().probability)


def test_threads_do_not_change_a_byte():
    import numba

    results = []
    for threads in (1, numba.get_num_threads()):
        numba.set_num_threads(threads)
        mapper, _ = drive(MappingSettings(particles=10), 4, (0.01, 0.01), steps=60)
        grid, path = mapper.finish()
        results.append((grid.probability.tobytes(), path.tobytes()))
    assert results[0] == results[1]


def test_weights_that_all_vanish_stay_numbers():
    f = ParticleFilter(MappingSettings(particles=4, match_weight=1e6))
    wall = np.full((60, 60), log_odds(0.9))
    f.add(local_map(wall, motion=Motion.none(0)))
    f.add(local_map(-wall, motion=Motion.none(1)))
    assert np.isfinite(f.log_weights).all()
    assert np.isfinite(f.health[-1].n_eff)


@given(
    st.lists(
        st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)), min_size=6, max_size=12
    )
)
@settings(max_examples=50, deadline=None)
def test_a_path_joined_at_its_own_poses_is_the_odometry(steps):
    odometry = [np.zeros(3)]
    for step in steps:
        odometry.append(compose(odometry[-1], np.array(step)))
    odometry = np.array(odometry)
    nodes = np.array([0, 3, len(odometry) - 2])
    path = join(odometry, nodes, odometry[nodes])
    difference = compose(inverse(odometry), path)
    np.testing.assert_allclose(difference, 0.0, atol=1e-9)


def test_a_joined_path_passes_the_filters_poses():
    odometry = np.stack([np.arange(7.0), np.zeros(7), np.zeros(7)], axis=1)
    poses = np.array([[0.0, 0.0, 0.0], [3.0, 0.6, 0.3], [5.0, 1.0, 0.0]])
    path = join(odometry, np.array([0, 3, 5]), poses)
    np.testing.assert_allclose(path[[0, 3, 5]], poses, atol=1e-12)
    np.testing.assert_allclose(path[6], [6.0, 1.0, 0.0], atol=1e-12)
    assert (np.diff(path[:4, 1]) > 0).all()


def test_a_single_particle_works():
    mapper, _ = drive(MappingSettings(particles=1), 5, (0.01, 0.01), steps=30)
    grid, path = mapper.finish()
    assert np.isfinite(path).all()
    assert pytest.approx(1.0) == mapper.filter.health[-1].n_eff
    assert grid.probability.size > 100
