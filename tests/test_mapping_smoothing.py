"""The finished path: windows matched to one another, and the path bent to agree."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mapping.smoothing
from mapping.local_cells import PackedCells, classify
from mapping.mapper import HierarchicalMapper
from mapping.pose_graph import Measurements, relax
from mapping.sensor_model import SensorModel
from mapping.settings import MappingSettings
from mapping.surface_matching import (
    SHARED_ERROR,
    Glimpse,
    Surface,
    centred,
    match_surfaces,
    surface,
)
from odometry.motion import Motion, compose, inverse, placed, wrap_angle
from pipeline.evaluate_path import align
from tests.mapping_data import CELL, drive, fed, local_map, round_the_room

poses = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)


def measured(pairs, true, sigma=0.01, rng=None):
    """Relative poses of the pairs (base, other) of true poses, with noise if there is an rng."""
    base, other = np.array(pairs).T
    relative = compose(inverse(true[base]), true[other])
    if rng is not None:
        relative = relative + sigma * rng.standard_normal(relative.shape)
    return Measurements(base, other, relative, np.tile(np.eye(3) / sigma**2, (len(base), 1, 1)))


def square_drive(n=20):
    """Poses (n, 3) round a square, back to the start."""
    increments = np.tile([1.0, 0.0, 0.0], (n - 1, 1))
    increments[4::5, 2] = math.pi / 2
    path = [np.zeros(3)]
    for increment in increments:
        path.append(compose(path[-1], increment))
    return np.array(path)


def steps(n):
    return [(i, i + 1) for i in range(n - 1)]


@given(st.lists(poses, min_size=2, max_size=6), poses)
def test_a_chain_without_contradiction_is_found_from_anywhere_near(increments, off):
    true = [np.zeros(3)]
    for increment in increments:
        true.append(compose(true[-1], increment))
    true = np.array(true)
    start = true + 0.05 * off * (np.arange(len(true)) > 0)[:, None]
    found = relax(start, measured(steps(len(true)), true), Measurements.none())
    np.testing.assert_allclose(found[:, :2], true[:, :2], atol=1e-6)
    np.testing.assert_allclose(wrap_angle(found[:, 2] - true[:, 2]), 0.0, atol=1e-6)


def test_a_closed_loop_spreads_its_error_and_halves_it():
    true = square_drive()
    errors = []
    for seed in range(40):
        moved = measured(steps(20), true, 0.02, np.random.default_rng(seed))
        dead = [np.zeros(3)]
        for increment in moved.relative:
            dead.append(compose(dead[-1], increment))
        dead = np.array(dead)
        loop = measured([(0, 19), (1, 18), (0, 18)], true, 0.005, np.random.default_rng(seed + 99))
        smoothed = relax(dead, moved, loop)
        errors.append([np.hypot(*(p - true)[:, :2].T).mean() for p in (dead, smoothed)])
    dead, smoothed = np.mean(errors, axis=0)
    assert smoothed < 0.5 * dead


def test_one_false_match_does_not_bend_the_path():
    true = square_drive()
    moved = measured(steps(20), true, 0.01)
    false = measured([(2, 17)], true)
    false.relative[0] += (1.0, -0.5, 0.4)
    good = measured([(0, 19), (1, 18), (3, 16)], true)
    found = relax(true, moved, good.followed_by(false))
    assert np.hypot(*(found - true)[:, :2].T).max() < 0.02
    # Taken for sure it would have.
    assert np.hypot(*(relax(true, moved.followed_by(false), good) - true)[:, :2].T).max() > 0.1


def room_surface(rng, noise=0.01):
    """Points of three walls and a pillar, seen with noise."""
    along = np.arange(0.0, 4.0, 0.05)
    walls = [
        np.stack([along, np.zeros_like(along)], axis=1),
        np.stack([np.zeros_like(along), along], axis=1),
        np.stack([np.full_like(along, 4.0), along], axis=1),
        np.array([1.5, 1.2]) + 0.15 * np.stack([np.cos(along * 1.6), np.sin(along * 1.6)], axis=1),
    ]
    points = np.concatenate(walls)
    return points + noise * rng.standard_normal(points.shape)


@pytest.mark.parametrize("width", [3.0, 1.0])
def test_two_views_of_the_same_walls_are_matched_to_their_true_place(width):
    rng = np.random.default_rng(4)
    offset = np.array([0.6, -0.3, 0.5])
    seen = [room_surface(rng), placed(inverse(offset), room_surface(rng))]
    surfaces = [Surface(p, 0.2, np.zeros(3), Motion.none(0)) for p in seen]
    expected = np.array([np.zeros(3), offset + np.array([0.08, -0.06, 0.03])])
    found = match_surfaces(surfaces, expected, CELL, width * CELL)
    assert found.base.tolist() == [0]
    assert found.other.tolist() == [1]
    np.testing.assert_allclose(found.relative[0], offset, atol=0.012)
    assert np.linalg.eigvalsh(found.information[0]).min() > 0


def test_walls_that_only_one_of_them_sees_are_not_matched():
    rng = np.random.default_rng(4)
    walls = room_surface(rng)
    elsewhere = walls + np.array([20.0, 0.0])
    surfaces = [Surface(p, 0.2, np.zeros(3), Motion.none(0)) for p in (walls, elsewhere)]
    assert not len(match_surfaces(surfaces, np.zeros((2, 3)), CELL, CELL).base)


def test_a_wall_that_goes_on_does_not_draw_the_match_along():
    """A corridor seen from further on shows more of its walls: nothing says how much further."""
    rng = np.random.default_rng(1)
    along = np.arange(0.0, 6.0, 0.05)
    both = np.concatenate([np.stack([along, np.full_like(along, y)], axis=1) for y in (-1.0, 1.0)])
    views = [both + 0.01 * rng.standard_normal(both.shape) for _ in range(2)]
    surfaces = [Surface(p, 0.2, np.zeros(3), Motion.none(0)) for p in views]
    expected = np.array([np.zeros(3), [2.0, 0.0, 0.0]])
    found = match_surfaces(surfaces, expected, CELL, CELL)
    assert found.relative[0, 0] == pytest.approx(2.0, abs=0.05)
    # Across the hits tell, along hardly anything does but the noise of single hits.
    along, across = np.diag(np.linalg.inv(found.information[0]) - np.diag(SHARED_ERROR**2))[:2]
    assert along > 10 * across


def test_points_at_the_end_of_a_wall_are_not_centred():
    number, middle = np.zeros((40, 40)), np.zeros((40, 40, 2))
    number[10, 10:20] = 5
    middle[10, :, 0], middle[10, :, 1] = 0.7, 0.525
    points = np.array([[0.7, 0.525], [0.95, 0.525], [1.5, 1.5], [-9.0, 0.0]])
    use = centred(points, np.array([0, 4]), np.zeros((1, 3)), number, middle, 0.0, 0.0, CELL, 0.16)
    assert use.tolist() == [True, False, False, False]


def glimpse(points, hits=None, motion=None):
    return Glimpse(np.array(points), hits or len(points), 0.1, motion or Motion.none(0))


def test_a_glimpse_is_the_mean_hit_of_every_obstacle_cell():
    local = replace(
        local_map(np.zeros((60, 60))), points=np.array([[1.01, 0.51], [1.03, 0.53], [2.02, 0.02]])
    )
    seen = Glimpse.of(local)
    np.testing.assert_allclose(seen.points, [[1.02, 0.52], [2.02, 0.02]], atol=1e-12)
    assert seen.hits == 3
    alone = surface([seen], np.zeros((1, 3)), np.zeros(3), CELL)
    assert alone.kappa == pytest.approx(0.1 * 3 / 2)


def test_a_surface_is_seen_from_the_middle_of_its_window():
    world = np.array([[3.0, 1.0], [2.0, -1.0], [4.0, 0.5]])
    frames = np.array([[1.0, 0.0, 0.0], [1.5, 0.1, 0.4]])
    middle = np.array([1.2, 0.0, 0.2])
    first = glimpse(placed(inverse(frames[0]), world[:2]), motion=Motion(frames[0]))
    second = glimpse(
        placed(inverse(frames[1]), world[2:]),
        motion=Motion(compose(inverse(frames[0]), frames[1])),
    )
    joined = surface([first, second], frames, middle, CELL)
    seen = placed(inverse(middle), world)
    np.testing.assert_allclose(
        joined.points[np.lexsort(joined.points.T)], seen[np.lexsort(seen.T)], atol=1e-12
    )
    np.testing.assert_allclose(joined.motion.increment, frames[1])
    np.testing.assert_allclose(compose(frames[1], joined.middle), middle, atol=1e-12)


@pytest.mark.parametrize("method", ["hierarchical", "per-scan"])
def test_smoothing_brings_a_noisy_drive_nearer_to_the_truth(method):
    true = round_the_room(150, 0.17)
    ratio = []
    for seed in range(3):
        errors = []
        for smoothing in (False, True):
            settings = MappingSettings(
                method=method, proposal="motion", particles=30, smoothing=smoothing, window=5
            )
            mapper = fed(HierarchicalMapper(settings, seed), drive(true, (0.02, 0.012), seed, 133))
            off = compose(align(mapper.path(), true), mapper.path()) - true
            errors.append(np.hypot(off[:, 0], off[:, 1]).mean())
        ratio.append(errors[1] / errors[0])
    assert np.mean(ratio) < 0.8


def test_the_map_drawn_anew_along_the_best_particles_path_is_that_particles_map():
    settings = MappingSettings(particles=8, smoothing=False, window=5)
    drive_ = drive(round_the_room(60), (0.01, 0.01), 3)
    mapper = fed(HierarchicalMapper(settings, 1), drive_)
    (drawn, _), kept = mapper.filter.redrawn(mapper.filter.path()), mapper.filter.grid()
    assert drawn.origin == kept.origin
    np.testing.assert_array_equal(drawn.probability, kept.probability)


def sure_of(motion, count):
    """The same motion `count` times in a row."""
    first = np.arange(count)
    return Measurements(
        first,
        first + 1,
        np.tile(motion.increment, (count, 1)),
        np.tile(np.linalg.inv(motion.covariance), (count, 1, 1)),
    )


def test_a_set_of_false_loops_that_agree_with_each_other_does_not_bend_the_path(monkeypatch):
    """Two like rooms: every window of the second matches one of the first."""
    true = np.column_stack([np.arange(31.0), np.zeros(31), np.zeros(31)])
    motion = Motion(np.array([1.0, 0.0, 0.0]), np.diag([0.03, 0.03, 0.01]) ** 2)
    surfaces = [Surface(np.zeros((40, 2)), 0.2, np.zeros(3), motion) for _ in range(30)]
    first = np.arange(12)
    false = Measurements(
        first,
        first + 18,
        np.tile([15.0, 0.0, 0.0], (12, 1)),  # 18 m by the motion
        np.tile(np.diag([6400.0, 6400.0, 40_000.0]), (12, 1, 1)),
    )

    def match_surfaces(surfaces, nodes, *_):
        return false if nodes[-1, 0] < 28.0 else Measurements.none()

    monkeypatch.setattr(mapping.smoothing, "match_surfaces", match_surfaces)
    start = true.copy()
    start[19:, 0] -= 3.0  # where the filter went wrong
    believed = relax(start, sure_of(motion, 30), false.shifted(1))
    assert believed[-1, 0] < 28.0, "single weights refuse them"
    np.testing.assert_allclose(mapping.smoothing.smooth(surfaces, start, CELL), true, atol=1e-6)


def test_smoothing_by_which_less_matches_is_refused(monkeypatch):
    settings = MappingSettings(particles=20, window=5)
    mapper = HierarchicalMapper(settings, 1)
    true = round_the_room(150, 0.17)

    def bent(path):
        return compose(
            path, np.column_stack([np.zeros((len(path), 2)), 0.02 * np.arange(len(path))])
        )

    monkeypatch.setattr(mapper, "_bent", bent)
    fed(mapper, drive(true, (0.01, 0.005), 3))
    assert not mapper.smoothed
    off = compose(align(mapper.path(), true), mapper.path()) - true
    assert np.hypot(off[:, 0], off[:, 1]).mean() < 0.1


def test_a_match_of_windows_is_no_better_than_their_motion():
    rng = np.random.default_rng(1)
    corner = np.concatenate(
        [np.column_stack([np.arange(0, 3, 0.05), np.zeros(60)]),
         np.column_stack([np.zeros(60), np.arange(0, 3, 0.05)])]
    )  # fmt: skip
    drift = np.diag([0.2, 0.1, 0.05]) ** 2
    for covariance in (np.zeros((3, 3)), drift):
        motion = Motion(np.zeros(3), covariance)
        views = [corner + 0.01 * rng.standard_normal(corner.shape) for _ in range(2)]
        surfaces = [Surface(view, 1.0, np.zeros(3), motion) for view in views]
        found = match_surfaces(surfaces, np.zeros((2, 3)), CELL, CELL)
        least = np.diag(SHARED_ERROR**2) + covariance
        known = np.linalg.inv(found.information[0])
        assert np.linalg.eigvalsh(known - least).min() > -1e-9
        assert np.all(np.diag(known) < 2.0 * np.diag(least))


def test_cells_are_packed_without_loss():
    rng = np.random.default_rng(0)
    L = np.where(rng.random((30, 50)) < 0.4, np.nan, rng.normal(0, 2, (30, 50)))
    cells = classify(local_map(L, (-1.0, 2.0)), SensorModel.of(MappingSettings()), 1)
    again = PackedCells.of(cells).cells()
    np.testing.assert_array_equal(again.bits, cells.bits)
    np.testing.assert_array_equal(again.near, cells.near)
    assert (again.origin, again.cell) == (cells.origin, cells.cell)
