"""Stage 1: the gate, the sensor model, the kernel and the local map."""

import math

import numpy as np
import pytest

from mapping.gate import ObservationGate
from mapping.local_kernels import (
    FREE_BEFORE,
    HIT_WITHIN,
    THIN_REACH,
    WITHIN_CELL,
    add_observation,
    thin,
)
from mapping.local_map import LocalMapper, draw
from mapping.sensor_model import CLAMP, SensorModel, probability
from mapping.settings import MappingSettings
from odometry.motion import Motion
from stereo.scan import RangeScan

MODEL = SensorModel.of(MappingSettings())


def scan(ranges, sigma=0.01, fov=66.0, max_range=8.0, origin=(0.0, 0.0, 0.0)):
    ranges = np.asarray(ranges, float)
    half = math.radians(fov) / 2
    return RangeScan(
        stamp=0,
        origin=origin,
        bearing=np.linspace(-half, half, ranges.size),
        range=ranges,
        sigma=np.where(np.isfinite(ranges), sigma, np.nan),
        max_range=max_range,
    )


def wall(distance, n=265, fov=66.0):
    """Ranges to a flat wall across the robot's way."""
    return distance / np.cos(np.linspace(-math.radians(fov) / 2, math.radians(fov) / 2, n))


def at(log_odds, origin, x, y, cell=0.05):
    return log_odds[int((y - origin[1]) / cell), int((x - origin[0]) / cell)]


def test_one_hit_and_misses_give_the_probabilities_of_eqs_1_and_2():
    def p(hits, misses):
        return float(probability(np.array(hits * MODEL.occupied_step + misses * MODEL.free_step)))

    assert p(1, 0) == pytest.approx(0.54 / 0.64)
    assert p(0, 1) == pytest.approx(0.46 / 1.36)
    assert p(0, 2) == pytest.approx(0.46**2 / (0.46**2 + 0.9**2))
    assert p(0, 2) > 0.2 > p(0, 3)


def test_gate_opens_by_travel_or_turn_and_never_for_a_standing_robot():
    gate = ObservationGate(0.17, math.radians(10))
    assert gate.step(np.zeros(3))
    assert not any(gate.step(np.zeros(3)) for _ in range(100))
    assert [gate.step(np.array([0.06, 0.0, 0.0])) for _ in range(6)] == [False, False, True] * 2
    assert [gate.step(np.array([0.0, 0.0, math.radians(4)])) for _ in range(3)] == [
        False,
        False,
        True,
    ]


def test_unknown_is_never_free_and_nothing_in_range_is_free_up_to_max_range():
    n = 101
    unknown, _, _ = draw([scan(np.full(n, np.nan))], [np.zeros(3)], 0.05, MODEL)
    assert np.isnan(unknown).all()
    empty, _, origin = draw([scan(np.full(n, np.inf), max_range=3.0)], [np.zeros(3)], 0.05, MODEL)
    assert at(empty, origin, 2.9, 0.01) == pytest.approx(MODEL.free_step)
    assert np.isnan(at(empty, origin, 3.06, 0.01))
    assert not (empty > 0).any()


def test_free_before_the_hit_occupied_at_it_unknown_behind():
    grid, _, origin = draw([scan(wall(2.0))], [np.zeros(3)], 0.05, MODEL)
    assert at(grid, origin, 1.5, 0.01) == pytest.approx(MODEL.free_step)
    assert at(grid, origin, 2.01, 0.01) == pytest.approx(MODEL.occupied_step)
    assert np.isnan(at(grid, origin, 2.08, 0.01))


def test_a_wall_has_no_gaps_between_neighbouring_beams():
    grid, _, origin = draw([scan(wall(2.0, n=101), sigma=0.001)], [np.zeros(3)], 0.05, MODEL)
    column = int((2.01 - origin[0]) / 0.05)
    rows = slice(int((-1.2 - origin[1]) / 0.05), int((1.2 - origin[1]) / 0.05))
    assert (np.nanmax(grid[rows, column - 1 : column + 2], axis=1) > 0).all()


def test_false_matches_wash_out_and_the_wall_stands():
    """One false block a scan at changing places, as in the paper's Fig. 3."""
    rng = np.random.default_rng(5)
    mapper = LocalMapper(MappingSettings())
    local = None
    for i in range(10):
        ranges = wall(4.0 - 0.17 * i)
        start = rng.integers(0, 215)
        ranges[start : start + 40] = np.minimum(ranges[start : start + 40], rng.uniform(1.0, 2.0))
        step = np.array([0.17 if i else 0.0, 0.0, 0.0])
        local = mapper.add(scan(ranges), Motion(step, np.zeros((3, 3)), i, i))
    assert local is not None
    occupied = local.log_odds > MODEL.occupied_above
    rows, columns = np.nonzero(occupied)
    x = local.origin[0] + (columns + 0.5) * 0.05
    y = local.origin[1] + (rows + 0.5) * 0.05
    wall_x = 4.0 - 0.17 * 9
    near_axis = np.abs(y) < 1.0
    assert (np.abs(x[near_axis] - wall_x) < 0.1).mean() > 0.95
    across = np.unique(rows[near_axis & (np.abs(x - wall_x) < 0.1)])
    assert len(across) >= 0.9 * 2.0 / 0.05
    assert local.motion.increment[0] == pytest.approx(1.53)


def test_a_far_wall_does_not_dissolve():
    """Sigma as of f = 493 px, 60 mm, 0.25 px at 4 m: half a cell's width times five."""
    rng = np.random.default_rng(2)
    sigma = 4.0**2 / (493 * 0.06) * 0.25
    scans, poses = [], []
    for i in range(10):
        true = wall(4.0 - 0.02 * i)
        scans.append(scan(true + rng.normal(0, sigma, true.size), sigma=sigma))
        poses.append(np.array([0.02 * i, 0.0, 0.0]))
    grid, _, origin = draw(scans, poses, 0.05, MODEL)
    column = int((4.0 - origin[0]) / 0.05)
    rows = slice(int((-2.0 - origin[1]) / 0.05), int((2.0 - origin[1]) / 0.05))
    band = grid[rows, column - 1 : column + 2]
    assert (np.nanmax(band, axis=1) > MODEL.occupied_above).mean() >= 0.9
    assert (band < MODEL.free_below).mean() <= 0.03


def test_flush_gives_the_last_shorter_map_once():
    mapper = LocalMapper(MappingSettings())
    assert mapper.flush() is None
    assert mapper.add(scan(wall(3.0)), Motion.none(0)) is None
    rest = mapper.flush()
    assert rest is not None
    assert rest.observations == 1
    assert mapper.flush() is None


def test_motion_of_a_local_map_spans_the_pairs_between_observations():
    mapper = LocalMapper(MappingSettings(window=2))
    mapper.add(scan(wall(3.0)), Motion.none(0))
    for i in range(1, 4):
        covariance = np.diag([1e-4, 1e-4, 1e-6])
        step = Motion(np.array([0.06, 0.0, 0.0]), covariance, i - 1, i)
        local = mapper.add(scan(wall(3.0 - 0.06 * i)), step)
    assert local is not None
    assert local.motion.increment[0] == pytest.approx(0.18)
    assert local.motion.covariance[0, 0] == pytest.approx(3e-4)
    assert local.motion.last == 3


def numpy_twin(grid, likely, low, cell, sensor, s: RangeScan, model):
    """`add_observation` cell by cell, in plain numpy."""
    out, density = grid.copy(), likely.copy()
    n = s.bearing.size
    half_gap = 0.5 * (s.bearing[-1] - s.bearing[0]) / max(n - 1, 1)
    finite = np.isfinite(s.range)
    reach = max(
        (s.range[finite] + 3.0 * s.sigma[finite] + cell).max(initial=0.0),
        s.max_range if np.isposinf(s.range).any() else 0.0,
    )
    for row, column in np.ndindex(grid.shape):
        d = np.array([low[0] + (column + 0.5) * cell, low[1] + (row + 0.5) * cell]) - sensor[:2]
        r = math.hypot(*d)
        if r > reach:
            continue
        angle = math.atan2(
            -math.sin(sensor[2]) * d[0] + math.cos(sensor[2]) * d[1],
            math.cos(sensor[2]) * d[0] + math.sin(sensor[2]) * d[1],
        )
        width = max(math.atan2(0.5 * cell, r), half_gap)
        beams = (s.bearing >= angle - width) & (s.bearing <= angle + width)
        z, doubt = s.range[beams], s.sigma[beams]
        with np.errstate(invalid="ignore"):
            hits = np.abs(r - z) < np.maximum(0.5 * cell, HIT_WITHIN * doubt)
            free = np.where(
                np.isposinf(z), r < s.max_range, r < z - np.maximum(FREE_BEFORE * doubt, 0.5 * cell)
            )
            spread = np.hypot(doubt, WITHIN_CELL * cell)
            bump = np.exp(-0.5 * ((r - z) / spread) ** 2) / spread
        near = np.isfinite(z) & (np.abs(r - z) < 3.0 * spread)
        density[row, column] += bump[near].sum() / max(beams.sum(), 1)
        if hits.any():
            evidence = model.occupied_step
        elif 2 * (free & ~hits).sum() > beams.sum():
            evidence = model.free_step
        else:
            continue
        value = 0.0 if np.isnan(out[row, column]) else out[row, column]
        out[row, column] = np.clip(value + evidence, -CLAMP, CLAMP)
    return out, density


def test_kernel_equals_its_numpy_twin():
    rng = np.random.default_rng(1)
    for trial in range(4):
        ranges = rng.uniform(0.4, 2.5, 40)
        ranges[rng.random(40) < 0.2] = np.nan
        ranges[rng.random(40) < 0.2] = np.inf
        s = scan(ranges, sigma=rng.uniform(0.005, 0.2), max_range=2.0)
        sensor = np.array([*rng.uniform(-0.3, 0.3, 2), rng.uniform(-3, 3)])
        low = np.array([-2.0, -2.0])
        grid = np.where(rng.random((80, 80)) < 0.5, np.nan, rng.normal(0, 3, (80, 80)))
        grid = grid.astype(np.float32)
        likely = rng.random((80, 80)).astype(np.float32)
        expected = numpy_twin(grid, likely, low, 0.05, sensor, s, MODEL)
        add_observation(
            grid,
            likely,
            low[0],
            low[1],
            0.05,
            sensor,
            s.bearing,
            s.range,
            s.sigma,
            s.max_range,
            MODEL.occupied_step,
            MODEL.free_step,
            CLAMP,
        )
        for name, value, twin in zip(("grid", "likely"), (grid, likely), expected, strict=True):
            np.testing.assert_allclose(value, twin, 1e-5, 1e-6, err_msg=f"{name}, trial {trial}")


def thin_twin(grid, likely, low, cell, eye, above):
    """`thin` cell by cell, in plain numpy."""
    out = grid.copy()
    for row, column in np.argwhere(grid > above):
        d = np.array([low[0] + (column + 0.5) * cell, low[1] + (row + 0.5) * cell]) - eye
        d = d / max(np.hypot(*d), cell)
        steps = np.arange(-THIN_REACH, THIN_REACH + 1)
        i, j = np.round(row + steps * d[1]).astype(int), np.round(column + steps * d[0]).astype(int)
        inside = (i >= 0) & (i < grid.shape[0]) & (j >= 0) & (j < grid.shape[1])
        if (likely[i[inside], j[inside]] > likely[row, column]).any():
            out[row, column] = 0.0
    return out


def test_thinning_equals_its_numpy_twin():
    rng = np.random.default_rng(9)
    grid = rng.normal(0, 3, (40, 50)).astype(np.float32)
    grid[rng.random(grid.shape) < 0.3] = np.nan
    likely = rng.random(grid.shape).astype(np.float32)
    low, eye = np.array([-1.0, -1.0]), np.array([-0.3, 0.2])
    expected = thin_twin(grid, likely, low, 0.05, eye, MODEL.occupied_above)
    got = thin(grid, likely, -1.0, -1.0, 0.05, -0.3, 0.2, MODEL.occupied_above)
    np.testing.assert_array_equal(got, expected)


def test_a_far_wall_comes_out_thin_where_it_stands():
    """Ranges doubted by 0.17 m: the wall is possible in 11 cells, drawn in one or two."""
    rng = np.random.default_rng(3)
    sigma = 0.17
    mapper, local = LocalMapper(MappingSettings(spacing=0.02)), None
    for i in range(10):
        ranges = wall(4.0 - 0.02 * i)
        ranges = ranges + rng.normal(0, sigma, ranges.size)
        step = np.array([0.02 if i else 0.0, 0.0, 0.0])
        local = mapper.add(scan(ranges, sigma=sigma), Motion(step, np.zeros((3, 3)), i, i))
    assert local is not None
    ahead = np.abs(local.origin[1] + (np.arange(local.log_odds.shape[0]) + 0.5) * 0.05) < 1.5
    occupied = (local.log_odds > MODEL.occupied_above)[ahead]
    assert local.possible[ahead].sum(axis=1).mean() > 6
    assert 0.8 < occupied.sum(axis=1).mean() < 2.5
    _, columns = np.nonzero(occupied)
    x = local.origin[0] + (columns + 0.5) * 0.05
    assert abs(np.median(x) - (4.0 - 0.18)) < 0.05
