"""Stage 1: the gate, the sensor model and the local map."""

import itertools
import math

import numpy as np
import pytest

from mapping.gate import ObservationGate
from mapping.local_map import LocalMapper, draw
from mapping.mapper import HierarchicalMapper
from mapping.sensor_model import SensorModel, log_odds, probability
from mapping.settings import MappingSettings
from odometry.motion import Motion
from tests.mapping_data import CELL, fed, scan, wall

MODEL = SensorModel.of(MappingSettings())
HERE = np.zeros((1, 3))


def at(log_odds, origin, x, y):
    return log_odds[int((y - origin[1]) / CELL), int((x - origin[0]) / CELL)]


def test_eqs_1_and_2_by_hand():
    """P(O|E) = .54, P(O|notE) = .1: a hit gives .27 / .32, a miss .23 / .68."""

    def p(hits, misses):
        return float(probability(np.array(hits * MODEL.occupied_step + misses * MODEL.free_step)))

    assert p(1, 0) == pytest.approx(0.84375)
    assert p(0, 1) == pytest.approx(0.3382352941)
    assert p(0, 2) == pytest.approx(0.2116 / 1.0216)
    assert p(1, 1) == pytest.approx(0.2484 / 0.3384)
    assert p(0, 2) > 0.2 > p(0, 3)


def test_log_odds_and_probability_are_inverse():
    p = np.array([0.01, 0.2, 0.5, 0.7, 0.99])
    np.testing.assert_allclose(probability(np.array([log_odds(v) for v in p])), p)
    assert log_odds(0.7) == pytest.approx(0.8472978604)


def along_two_cells(seen):
    """A scan just beside the x axis, the cells [0, 1] and [1, 2] m: the index of the cell whose
    middle is hit, or none."""
    ranges = [np.inf if seen is None else seen + 0.5] * 2
    return scan(ranges, sigma=0.0, fov=0.1, max_range=2.0, origin=(0.0, 0.1, 0.0))


def bayes_by_enumeration(looks, hit, false_hit):
    """P(obstacle) of both cells after the looks: all four worlds, weighed by what they explain."""
    worlds = list(itertools.product((False, True), repeat=2))
    weights = []
    for world in worlds:
        weight = 0.25
        for seen in looks:
            last = 1 if seen is None else seen
            for cell in range(last + 1):
                P = hit if world[cell] else false_hit
                weight *= P if cell == seen else 1.0 - P
        weights.append(weight)
    share = np.array(weights) / sum(weights)
    return share @ np.array(worlds, float)


@pytest.mark.parametrize("looks", [[1], [0], [None, None], [1, 1, 0], [None, 0, 1, 1, None]])
def test_the_posterior_of_a_two_cell_world_is_that_of_its_enumeration(looks):
    """Of both maps: a local one of all looks, and the particles' of one look after the other."""
    scans = [along_two_cells(seen) for seen in looks]
    for hit, false_hit in ((0.54, 0.1), (0.8, 0.3)):
        expected = bayes_by_enumeration(looks, hit, false_hit)
        model = SensorModel.of(MappingSettings(hit=hit, false_hit=false_hit))
        sensors = np.tile(scans[0].origin, (len(looks), 1))
        local, _, origin = draw(scans, sensors, 1.0, model)
        np.testing.assert_allclose(two_cells(probability(local), origin), expected, rtol=1e-5)
        settings = MappingSettings(
            cell=1.0, spacing=0.0, method="per-scan", particles=1, hit=hit, false_hit=false_hit
        )
        mapper = fed(HierarchicalMapper(settings), [(s, Motion.none(0)) for s in scans])
        grid = mapper.filter.grid()
        assert len(mapper.filter.health) == len(looks)
        # int8: half a step of log-odds (.021) a look.
        tolerance = 0.25 * 0.022 * len(looks)
        np.testing.assert_allclose(
            two_cells(grid.probability, grid.origin), expected, atol=tolerance
        )


def two_cells(p, origin):
    """The probabilities of the cells [0, 1] and [1, 2] m; .5 where nothing is known."""
    row, column = round(-origin[1]), round(-origin[0])
    known = np.full(2, 0.5)
    seen = p[row, column : column + 2]
    known[: len(seen)] = np.where(np.isnan(seen), 0.5, seen)
    return known


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
    unknown, _, _ = draw([scan(np.full(n, np.nan))], HERE, CELL, MODEL)
    assert np.isnan(unknown).all()
    empty, _, origin = draw([scan(np.full(n, np.inf), max_range=3.0)], HERE, CELL, MODEL)
    assert at(empty, origin, 2.9, 0.01) == pytest.approx(MODEL.free_step)
    assert np.isnan(at(empty, origin, 3.06, 0.01))
    assert not (empty > 0).any()


def test_free_before_the_hit_occupied_at_it_unknown_behind():
    grid, _, origin = draw([scan(wall(2.0))], HERE, CELL, MODEL)
    assert at(grid, origin, 1.5, 0.01) == pytest.approx(MODEL.free_step)
    assert at(grid, origin, 2.01, 0.01) == pytest.approx(MODEL.occupied_step)
    assert np.isnan(at(grid, origin, 2.08, 0.01))


def test_the_sensor_stands_where_its_pose_says():
    """A wall 2 m ahead of a sensor that looks to the left from (1, 0.5)."""
    turned = np.array([[1.0, 0.5, math.radians(90)]])
    grid, _, origin = draw([scan(wall(2.02))], turned, CELL, MODEL)
    assert at(grid, origin, 1.01, 2.52) == pytest.approx(MODEL.occupied_step)
    assert at(grid, origin, 1.01, 1.52) == pytest.approx(MODEL.free_step)


def test_beams_far_apart_leave_no_gaps_in_what_is_free_and_no_obstacle_between():
    """Five beams over 60 deg with nothing in 3 m: all cells of the sector are free."""
    grid, _, origin = draw([scan(np.full(5, np.inf), fov=60, max_range=3.0)], HERE, CELL, MODEL)
    rows, columns = np.indices(grid.shape)
    x, y = origin[0] + (columns + 0.5) * CELL, origin[1] + (rows + 0.5) * CELL
    inner = (np.hypot(x, y) < 2.9) & (np.abs(np.arctan2(y, x)) < math.radians(29)) & (x > 0.1)
    assert inner.sum() > 1500
    np.testing.assert_allclose(grid[inner], MODEL.free_step, rtol=1e-6)
    # Between a near and a far hit nothing is free beyond the near one.
    grid, _, origin = draw([scan([1.0, 3.0], fov=20)], HERE, CELL, MODEL)
    assert at(grid, origin, 0.8, 0.01) == pytest.approx(MODEL.free_step)
    assert np.isnan(at(grid, origin, 1.5, 0.01))


def test_a_wall_has_no_gaps_between_neighbouring_beams():
    grid, _, origin = draw([scan(wall(2.0, n=101), sigma=0.001)], HERE, CELL, MODEL)
    column = int((2.01 - origin[0]) / CELL)
    rows = slice(int((-1.2 - origin[1]) / CELL), int((1.2 - origin[1]) / CELL))
    assert (np.nanmax(grid[rows, column - 1 : column + 2], axis=1) > 0).all()


def test_hits_close_together_are_one_wall_and_others_are_not_joined():
    """Eleven beams over 30 deg meet a wall 2 m away 0.1 m apart, or every second of them does."""
    bearing = np.linspace(-math.radians(15), math.radians(15), 11)
    joined, _, origin = draw([scan(2.01 / np.cos(bearing), 0.0, 30)], HERE, CELL, MODEL)
    rows = slice(int((-0.45 - origin[1]) / CELL), int((0.45 - origin[1]) / CELL))
    column = int((2.01 - origin[0]) / CELL)
    assert (joined[rows, column] > 0).all()
    steps = np.where(np.arange(11) % 2, 2.4, 2.01) / np.cos(bearing)
    apart, _, origin = draw([scan(steps, 0.0, 30)], HERE, CELL, MODEL)
    column = int((2.2 - origin[0]) / CELL)
    assert not (apart[:, column] > 0).any()


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
    occupied = local.log_odds > MODEL.local_occupied_above
    rows, columns = np.nonzero(occupied)
    x = local.origin[0] + (columns + 0.5) * CELL
    y = local.origin[1] + (rows + 0.5) * CELL
    wall_x = 4.0 - 0.17 * 9
    near_axis = np.abs(y) < 1.0
    assert (np.abs(x[near_axis] - wall_x) < 0.1).mean() > 0.95
    across = np.unique(rows[near_axis & (np.abs(x - wall_x) < 0.1)])
    assert len(across) >= 0.9 * 2.0 / CELL
    assert local.motion.increment[0] == pytest.approx(1.53)
    # Nor do they pull at particles: hits are those on the wall.
    assert len(local.points) > 1000
    assert (np.abs(local.points[:, 0] - wall_x) < 0.1).mean() > 0.95


def test_a_far_wall_does_not_dissolve():
    """Sigma as of f = 493 px, 60 mm, 0.25 px at 4 m: half a cell's width times five."""
    rng = np.random.default_rng(2)
    sigma = 4.0**2 / (493 * 0.06) * 0.25
    sensors = np.array([[0.02 * i, 0.0, 0.0] for i in range(10)])
    scans = []
    for x in sensors[:, 0]:
        true = wall(4.0 - x)
        scans.append(scan(true + rng.normal(0, sigma, true.size), sigma=sigma))
    grid, _, origin = draw(scans, sensors, CELL, MODEL)
    column = int((4.0 - origin[0]) / CELL)
    rows = slice(int((-2.0 - origin[1]) / CELL), int((2.0 - origin[1]) / CELL))
    band = grid[rows, column - 1 : column + 2]
    assert (np.nanmax(band, axis=1) > MODEL.local_occupied_above).mean() >= 0.9
    assert (band < MODEL.local_free_below).mean() <= 0.03


def test_hits_that_are_not_spread_are_points():
    """Whatever the doubt of their ranges: the paper's own way."""
    possible = {}
    for spread in (True, False):
        mapper = LocalMapper(MappingSettings(spread=spread, window=1))
        local = mapper.add(scan(wall(4.02), sigma=0.17), Motion.none(0))
        assert local is not None
        possible[spread] = local.possible.sum(axis=1).max()
    assert possible[True] >= 9
    assert possible[False] == 1


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
    assert (local.motion.first, local.motion.last) == (0, 3)
    rest = mapper.add(scan(wall(2.6)), Motion(np.array([0.2, 0, 0]), first=3, last=4))
    rest = rest or mapper.flush()
    assert rest is not None
    assert (rest.motion.first, rest.motion.last) == (3, 4)
    assert rest.motion.increment[0] == pytest.approx(0.2)


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
    ahead = np.abs(local.origin[1] + (np.arange(local.log_odds.shape[0]) + 0.5) * CELL) < 1.5
    occupied = (local.log_odds > MODEL.local_occupied_above)[ahead]
    assert local.possible[ahead].sum(axis=1).mean() > 6
    assert 0.8 < occupied.sum(axis=1).mean() < 2.5
    _, columns = np.nonzero(occupied)
    x = local.origin[0] + (columns + 0.5) * CELL
    assert abs(np.median(x) - (4.0 - 0.18)) < 0.05
