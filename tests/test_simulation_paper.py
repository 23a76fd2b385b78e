"""The paper's simulator: its errors have the statistics they claim, and its truth is true."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from odometry.motion import compose, inverse, wrap_angle
from simulation.paper import (
    PaperSettings,
    floor_plan,
    positions_on,
    route_poses,
    seen_plan,
    simulate,
)
from simulation.route import Route
from simulation.stereo_errors import StereoErrors
from simulation.world import World, load_world
from simulation.world_sheet import WorldError
from stereo.scan import RangeScan

BEARING = PaperSettings().bearing
FOV = math.radians(66.0)


def blocks(n: int, **settings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth m, width deg, centre rad of n false blocks."""
    chance = np.random.default_rng(5).random((n, 3))
    depth, low, high = StereoErrors(**settings).false_blocks(chance, -FOV / 2.0, FOV / 2.0).T
    return depth, np.degrees(high - low), 0.5 * (low + high)


def test_false_depths_are_the_paper_s_normal_within_the_depth_range():
    depth, _, _ = blocks(20_000)
    assert depth.min() >= 0.0
    assert depth.max() <= 8.0
    mean, sd = 4.886, 1.773
    truncated = stats.truncnorm((0.0 - mean) / sd, (8.0 - mean) / sd, mean, sd)
    assert stats.kstest(depth, truncated.cdf).pvalue > 0.001


def test_a_shorter_depth_range_truncates_sooner():
    depth, _, _ = blocks(5_000, max_range=4.0)
    assert 3.9 < depth.max() <= 4.0


@pytest.mark.parametrize("alpha", [0.0, 1.0, 5.0 / 3.0, 4.0])
def test_widths_follow_equation_12(alpha):
    depth, width, _ = blocks(20_000, alpha=alpha)
    assert width.min() >= 0.0
    for low, high in ((1.0, 3.0), (4.0, 5.0), (6.5, 7.5)):
        near = (depth > low) & (depth < high)
        mean = 3.0 * alpha * (8.0 - depth[near]) / 8.0 + 3.0 * alpha
        # A normal cut at 0: its mean is m Phi(m / sd) + sd phi(m / sd).
        wanted = mean * stats.norm.cdf(mean / 3.0) + 3.0 * stats.norm.pdf(mean / 3.0)
        doubt = 3.0 / math.sqrt(near.sum())
        assert abs(width[near].mean() - wanted.mean()) < 4.0 * doubt


def test_alpha_of_five_thirds_is_equation_11():
    depth, width, _ = blocks(20_000)
    wide = 5.0 * (8.0 - depth) / 8.0 + 5.0
    residual = (width - wide)[wide > 8.0]  # far enough from the cut at 0
    assert residual.mean() == pytest.approx(0.0, abs=0.15)
    assert residual.std() == pytest.approx(3.0, abs=0.15)


def test_centres_are_uniform_in_the_field_of_view():
    _, _, centre = blocks(20_000)
    assert stats.kstest(centre, stats.uniform(-FOV / 2.0, FOV).cdf).pvalue > 0.001


def test_share_of_false_beams_is_that_of_the_blocks():
    errors = StereoErrors(depth_noise=0.0, false_depth="replace")
    true = np.full(265, 7.999)
    measured = np.array([errors.measure(true, BEARING, 3, frame) for frame in range(2_000)])
    _, width, _ = blocks(20_000)
    # A block of width w about a centre in the field F loses w^2 / (4 F) beyond its ends.
    wanted = (width - width**2 / (4.0 * 66.0)).mean() / 66.0
    assert (measured != true).mean() == pytest.approx(wanted, rel=0.03)
    in_one_piece = np.diff((measured != true).astype(int), axis=1)
    assert (np.abs(in_one_piece).sum(axis=1) <= 2).all()
    assert all(np.unique(m[m != true]).size <= 1 for m in measured)


def test_depth_noise_is_gaussian_with_a_share_of_the_depth():
    errors = StereoErrors(blocks=0)
    true = np.linspace(1.0, 6.0, 265)
    measured = np.array([errors.measure(true, BEARING, 3, frame) for frame in range(100)])
    residual = ((measured - true) / true).ravel() / 0.02
    assert stats.kstest(residual, stats.norm.cdf).pvalue > 0.001


def test_of_true_and_false_the_nearer_stands_or_the_false_one():
    true = np.linspace(0.5, 7.5, 265)
    true[::10] = np.inf
    true[5::10] = np.nan
    nearest, other = (
        StereoErrors(depth_noise=0.0, alpha=4.0, false_depth=reading)
        for reading in ("nearest", "replace")
    )
    farther = 0
    for frame in range(200):
        near, false = (errors.measure(true, BEARING, 7, frame) for errors in (nearest, other))
        touched = ~((false == true) | (np.isnan(false) & np.isnan(true)))
        seen = ~np.isnan(true) & np.isfinite(true) & touched
        # With no true range, found or not, the false one stands in either reading.
        assert np.array_equal(near[touched & ~seen], false[touched & ~seen])
        assert (near[seen] <= true[seen]).all()
        assert (near[seen] <= false[seen]).all()
        farther += (false[seen] > true[seen]).sum()
        assert np.array_equal(near[~touched], true[~touched], equal_nan=True)
    assert farther > 0


def test_what_is_measured_beyond_the_range_is_no_return():
    errors = StereoErrors(blocks=0)
    measured = np.concatenate(
        [errors.measure(np.full(265, 8.0), BEARING, 1, frame) for frame in range(20)]
    )
    assert np.isinf(measured).mean() == pytest.approx(0.5, abs=0.03)
    assert measured[np.isfinite(measured)].max() <= 8.0


def test_more_blocks_keep_the_first_ones():
    true = np.full(265, 7.9)
    one, two = (
        StereoErrors(blocks=n, depth_noise=0.0, false_depth="nearest").measure(true, BEARING, 1, 4)
        for n in (1, 2)
    )
    assert (one < 7.9).any()
    assert (two[one < 7.9] <= one[one < 7.9]).all()
    assert (two < one).any()


def test_a_laser_scan_seen_by_the_camera_keeps_its_beams_and_its_ignorance():
    ranges = np.array([1.0, np.nan, np.inf, 4.5, 30.0])
    scan = RangeScan(
        5, (0.1, 0.0, 0.0), np.linspace(-0.5, 0.5, 5), ranges, 0.01 * ranges, max_range=80.0
    )
    seen = StereoErrors(blocks=0).seen(scan, 1, 0)
    assert seen.bearing is scan.bearing
    assert (seen.stamp, seen.origin, seen.max_range) == (5, scan.origin, 8.0)
    assert np.isnan(seen.range[1])
    assert np.isinf(seen.range[[2, 4]]).all()
    np.testing.assert_allclose(seen.range[[0, 3]], [1.0, 4.5], rtol=0.1)
    np.testing.assert_allclose(seen.sigma[[0, 3]], 0.02 * seen.range[[0, 3]])
    short = StereoErrors(blocks=0).seen(replace(scan, max_range=4.0), 1, 0)
    assert short.max_range == 4.0
    assert np.isinf(short.range[3])


@pytest.fixture(scope="module")
def room() -> World:
    """4 x 3 m with closed walls and a box; a shelf hides the cells behind it."""
    solid = np.zeros((60, 80), bool)
    solid[[0, -1]] = solid[:, [0, -1]] = True
    solid[35:45, 40:50] = True
    solid[8:12, 70:74] = True
    solid[9:11, 71:73] = False
    return World("room", solid, 0.05, (-1.0, 0.5), loop())


def loop() -> Route:
    points = np.array([[-0.5, 1.0], [2.0, 1.0], [2.0, 3.0], [-0.5, 3.0], [-0.5, 1.5]])
    return Route.through(points, 0.4, 1.0, math.inf)


def small(**settings) -> PaperSettings:
    return PaperSettings(**{"positions": 35, **settings})


def test_a_perfect_run_is_exact(room):
    run = simulate(room, loop(), small(), seed=1, perfect=True)
    assert len(run.scans) == len(run.motions) == 35
    np.testing.assert_allclose(run.odometry, run.truth, atol=1e-12)
    np.testing.assert_allclose(compose(run.poses[0], run.truth), _wrapped(run.poses), atol=1e-12)
    assert not any(motion.covariance.any() for motion in run.motions)
    first = run.scans[0]
    assert first.bearing[[0, 132, -1]] == pytest.approx(np.radians([-33.0, 0.0, 33.0]))
    # Straight ahead of (-0.5, 1.0) the box's near face stands at x = 2.5: cell 70.
    assert first.range[132] == pytest.approx(3.0)
    assert np.nanmax(first.sigma) == 0.0
    assert first.stamp == 1_000_000_000_000
    assert run.scans[1].stamp - first.stamp == 500_000_000


def _wrapped(poses: np.ndarray) -> np.ndarray:
    return np.column_stack([poses[:, :2], wrap_angle(poses[:, 2])])


def test_positions_are_evenly_spaced_whatever_the_speed(room):
    slow = replace(loop(), speed=np.linspace(0.2, 0.5, len(loop().speed)))
    np.testing.assert_allclose(
        route_poses(room, slow, small()), route_poses(room, loop(), small()), atol=1e-9
    )


def test_odometry_errors_have_the_stated_spread():
    world = load_world("flat")
    assert world.route is not None
    settings = PaperSettings(beams=2, blocks=0)
    errors = []
    for seed in range(5):
        run = simulate(world, world.route, settings, seed)
        true = compose(inverse(run.truth[:-1]), run.truth[1:])
        made = np.array([motion.increment for motion in run.motions[1:]])
        errors.append(made - true)
        chained = compose(run.odometry[:-1], made)
        np.testing.assert_allclose(chained, run.odometry[1:], atol=1e-12)
    scaled = np.concatenate(errors) / settings.odometry_noise
    for axis in range(3):
        assert stats.kstest(scaled[:, axis], stats.norm.cdf).pvalue > 0.001
    assert np.abs(np.corrcoef(scaled.T) - np.eye(3)).max() < 0.08
    np.testing.assert_allclose(
        run.motions[1].covariance, np.diag([0.02**2, 0.02**2, math.radians(0.7) ** 2])
    )
    assert not run.motions[0].increment.any()
    assert run.motions[1].first == run.scans[0].stamp
    assert run.motions[1].last == run.scans[1].stamp


def test_dead_reckoning_alone_is_lost_in_the_first_world():
    world = load_world("flat")
    assert world.route is not None
    settings = PaperSettings(beams=2, blocks=0)
    errors = []
    for seed in range(20):
        run = simulate(world, world.route, settings, seed)
        found, true = (p[:, 0] + 1j * p[:, 1] for p in (run.odometry, run.truth))
        found, true = found - found.mean(), true - true.mean()
        turn = np.vdot(found, true)
        aligned = found * turn / abs(turn)
        errors.append(math.sqrt(np.mean(np.abs(aligned - true) ** 2)))
    assert 0.4 < float(np.median(errors)) < 2.0


def test_one_kind_of_error_does_not_change_the_others(room):
    base = simulate(room, loop(), small(), seed=3)
    for changed in (
        small(alpha=4.0), small(blocks=3), small(false_depth="replace"), small(depth_noise=0.05),
    ):  # fmt: skip
        run = simulate(room, loop(), changed, seed=3)
        assert np.array_equal(run.odometry, base.odometry)
    fewer = simulate(room, loop(), small(positions=10), seed=3)
    assert np.array_equal(fewer.odometry, base.odometry[:10])
    for few, scan in zip(fewer.scans, base.scans, strict=False):
        assert np.array_equal(few.range, scan.range)
    none, wide = (
        simulate(room, loop(), small(blocks=b, false_depth="replace"), seed=3) for b in (0, 1)
    )
    same = [(a.range == b.range).mean() for a, b in zip(none.scans, wide.scans, strict=True)]
    assert 0.6 < np.mean(same) < 0.999
    other = simulate(room, loop(), small(), seed=4)
    assert not np.array_equal(other.odometry[1:], base.odometry[1:])


def test_sigma_is_the_noise_of_the_measured_range(room):
    run = simulate(room, loop(), small(), seed=3)
    for scan in run.scans:
        found = np.isfinite(scan.range)
        np.testing.assert_allclose(scan.sigma[found], 0.02 * scan.range[found])
        assert np.isnan(scan.sigma[~found]).all()


def test_a_route_that_cannot_be_driven_is_refused(room):
    with pytest.raises(WorldError, match="room for 4 positions"):
        simulate(room, Route.through(np.array([[0, 1], [0.7, 1]]), 0.1, 1.0, 1.0), small(), 1)
    through = Route.through(np.array([[0.0, 2.4], [2.5, 2.4]]), 0.1, 1.0, 1.0)
    with pytest.raises(WorldError, match=r"through a wall .* at \(1\.\d+, 2\.40\)"):
        simulate(room, through, small(positions=10), 1)
    outside = Route.through(np.array([[0.0, 1.0], [0.0, -9.0]]), 0.1, 1.0, 1.0)
    with pytest.raises(WorldError, match="out of the world"):
        simulate(room, outside, small(), 1)


def test_a_route_s_end_is_a_position_too():
    assert positions_on(Route.through(np.array([[0, 0], [0.6, 0]]), 0.1, 1.0, 1.0), 0.2) == 4


def test_the_floor_plan_lies_on_the_world_s_own_cells(room):
    first = route_poses(room, loop(), small())[0]
    plan = floor_plan(room, first)
    assert plan.origin == (-0.5, -0.5)
    assert np.array_equal(plan.probability == 1.0, room.solid)
    assert np.isnan(plan.probability[9:11, 71:73]).all()  # shut in: nobody gets there
    assert (plan.probability[~room.solid] == 0.0).sum() == (~room.solid).sum() - 4


@pytest.mark.parametrize("heading", [0.5 * np.pi, np.pi, -0.5 * np.pi])
def test_a_turned_start_turns_the_plan_cell_by_cell(room, heading):
    start = np.array([-0.5, 1.0, heading])
    turned = np.rot90(room.solid, round(heading / (0.5 * np.pi)))
    assert np.array_equal(floor_plan(room, start).probability == 1.0, turned)


def test_from_any_start_the_plan_tells_the_same_of_every_place(room):
    start = np.array([-0.487, 1.013, 0.6])
    plan = floor_plan(room, start)
    rows, columns = np.nonzero(~np.isnan(plan.probability))
    middle = np.array(plan.origin) + 0.05 * (np.column_stack([columns, rows]) + 0.5)
    there = compose(start, np.column_stack([middle, np.zeros(len(middle))]))
    row, column, inside = room.index(there[:, :2])
    assert inside.all()
    assert np.array_equal(plan.probability[rows, columns] == 1.0, room.solid[row, column])
    assert len(rows) == pytest.approx(room.solid.size, rel=0.01)


def test_seen_is_the_part_of_the_plan_that_perfect_sensors_see(room):
    settings = small(positions=8, max_range=2.5)
    poses = route_poses(room, loop(), settings)
    plan, seen = floor_plan(room, poses[0]), seen_plan(room, poses, settings)
    known = ~np.isnan(seen.probability)
    assert seen.origin == plan.origin
    assert np.array_equal(seen.probability[known], plan.probability[known])
    assert 0.1 < known.mean() < 0.9
    # Every hit of a perfect run is a solid cell that is seen.
    run = simulate(room, loop(), settings, seed=1, perfect=True)
    for scan, pose in zip(run.scans, run.truth, strict=True):
        hit = np.isfinite(scan.range)
        angle = pose[2] + scan.bearing[hit]
        reach = scan.range[hit] + 1e-6
        x, y = pose[0] + reach * np.cos(angle), pose[1] + reach * np.sin(angle)
        column, row = np.floor((x + 0.5) / 0.05 + 1e-9), np.floor((y + 0.5) / 0.05 + 1e-9)
        assert (seen.probability[row.astype(int), column.astype(int)] == 1.0).mean() > 0.99
    # Behind the robot, and out of reach.
    assert np.isnan(seen.probability[10, 2])
    assert np.isnan(seen.probability[50, 75])
