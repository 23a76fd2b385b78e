"""Ego-motion matched on scans: its kernels, what it corrects, what it leaves alone, the mapper."""

import math
from itertools import pairwise

import numpy as np
import pytest

from mapping.density_kernels import add_hits, climb, score
from mapping.ego_motion import MIN_HITS, EgoMotion, hits
from mapping.mapper import HierarchicalMapper
from mapping.settings import MappingSettings
from odometry.motion import Motion, compose, inverse
from tests.test_mapping_stage1 import scan
from tests.test_mapping_stage2 import room_ranges

CELL = 0.05
STEP = 0.17  # travel between observations [m]
BIAS = math.radians(0.5)  # turn that odometry misses at every step
DOUBT = np.array([0.01, 0.01, BIAS])
COVARIANCE = np.diag(DOUBT**2)


def add_hits_twin(density, x0, y0, cell, points, doubt):
    """`add_hits` in plain numpy: the highest bump in every cell that a hit's box touches."""
    low_x = x0 + np.arange(density.shape[1]) * cell
    low_y = y0 + np.arange(density.shape[0])[:, None] * cell
    layer = np.zeros_like(density)
    for (x, y), sd in zip(points, doubt, strict=True):
        reach = 2.5 * sd
        touched = (low_x <= x + reach) & (low_x + cell > x - reach)
        touched = touched & (low_y <= y + reach) & (low_y + cell > y - reach)
        off = (low_x + 0.5 * cell - x) ** 2 + (low_y + 0.5 * cell - y) ** 2
        layer = np.maximum(layer, np.where(touched, np.exp(-0.5 * off / sd**2), 0.0))
    return density + layer


def score_twin(density, x0, y0, cell, points, prior, information, kappa, pose):
    """`score` in plain numpy."""
    placed = compose(pose, np.column_stack([points, np.zeros(len(points))]))
    u, v = (placed[:, 0] - x0) / cell - 0.5, (placed[:, 1] - y0) / cell - 0.5
    column, row = np.floor(u).astype(int), np.floor(v).astype(int)
    inside = (row >= 0) & (row < density.shape[0] - 1)
    inside &= (column >= 0) & (column < density.shape[1] - 1)
    u, v, row, column = u[inside], v[inside], row[inside], column[inside]
    a, b = u - column, v - row
    d = (
        (1 - a) * (1 - b) * density[row, column]
        + a * (1 - b) * density[row, column + 1]
        + (1 - a) * b * density[row + 1, column]
        + a * b * density[row + 1, column + 1]
    )
    off = pose - prior
    return kappa * np.log1p(d).sum() - 0.5 * off @ information @ off


def random_hits(rng, n):
    """Hits in and around the box from (-1, -0.7) to (1, 0.7), and their doubts."""
    return rng.uniform([-1.6, -1.3], [1.6, 1.3], (n, 2)), rng.uniform(0.03, 0.25, n)


def test_hit_density_equals_its_numpy_twin_and_leaves_the_scratch_layer_zero():
    rng = np.random.default_rng(1)
    for _ in range(5):
        density = rng.random((28, 40))
        points, doubt = random_hits(rng, 60)
        expected = add_hits_twin(density, -1.0, -0.7, CELL, points, doubt)
        assert (expected - density > 0.5).any()
        layer = np.zeros_like(density)
        add_hits(density, layer, -1.0, -0.7, CELL, points, doubt)
        np.testing.assert_allclose(density, expected, rtol=1e-12, atol=1e-12)
        assert not layer.any()


def random_terms(rng):
    """Arguments of `score` up to kappa: a density, hits in and around it, a prior."""
    root = rng.normal(0, 5, (3, 3))
    prior = rng.uniform(-0.3, 0.3, 3)
    information = root @ root.T + np.eye(3)
    points, _ = random_hits(rng, 80)
    return 3.0 * rng.random((28, 40)), -1.0, -0.7, CELL, points, prior, information, 0.15


def test_score_equals_its_numpy_twin():
    rng = np.random.default_rng(2)
    for _ in range(20):
        terms = random_terms(rng)
        pose = terms[5] + rng.normal(0, [0.1, 0.1, 0.3])
        assert score(*terms, pose) == pytest.approx(score_twin(*terms, pose), rel=1e-10)


def test_the_climb_ends_no_lower_than_it_starts_where_no_last_step_helps():
    rng = np.random.default_rng(3)
    first_step, last = np.array([0.02, 0.02, 0.01]), 0.25
    for _ in range(10):
        terms = random_terms(rng)
        best = climb(*terms, first_step, last)
        height = score(*terms, best)
        assert height >= score(*terms, terms[5])
        for step in np.diag(last * first_step):
            assert score(*terms, best + step) <= height
            assert score(*terms, best - step) <= height


def round_the_room(n, step=STEP):
    """True poses (n, 3) on an ellipse in the room of `room_ranges`, about `step` [m] apart."""
    angle = np.arange(n) * step / 1.5
    heading = np.arctan2(1.2 * np.cos(angle), -1.9 * np.sin(angle))
    return np.stack([1.9 * np.cos(angle), 1.2 * np.sin(angle), heading], axis=1)


def room_scan(pose, rng):
    return scan(room_ranges(pose) + rng.normal(0, 0.01, 265))


def with_false_block(seen, rng):
    """The scan with a sixth of its columns pulled to one near distance, as a false match does."""
    ranges = seen.range.copy()
    start = rng.integers(0, ranges.size - 44)
    ranges[start : start + 44] = np.minimum(ranges[start : start + 44], rng.uniform(0.6, 1.5))
    return scan(ranges)


def biased_odometry(true):
    """Motions between true poses, each with BIAS too much turn and a covariance that says so."""
    turned = np.array([0.0, 0.0, BIAS])
    return [Motion(compose(inverse(a), b) + turned, COVARIANCE) for a, b in pairwise(true)]


def refined(scans, motions):
    """All motions after the first scan, matched one after another."""
    ego = EgoMotion(CELL)
    ego.refine(scans[0], Motion.none(0))
    return [ego.refine(s, m) for s, m in zip(scans[1:], motions, strict=True)]


def heading_error(motions, true):
    """Of the motions in a row, over the whole way [rad]."""
    pose = true[0]
    for motion in motions:
        pose = compose(pose, motion.increment)
    return abs(compose(inverse(true[-1]), pose)[2])


@pytest.mark.parametrize("seed", range(5))
def test_a_turn_that_odometry_misses_is_recovered_despite_false_matches(seed):
    rng = np.random.default_rng(seed)
    true = round_the_room(11)
    scans = [room_scan(pose, rng) for pose in true]
    motions = biased_odometry(true)
    missed = heading_error(motions, true)
    assert missed == pytest.approx(10 * BIAS)
    clean = heading_error(refined(scans, motions), true)
    assert clean < 0.5 * missed
    scans = [with_false_block(s, rng) for s in scans]
    with_blocks = heading_error(refined(scans, motions), true)
    assert with_blocks < 0.55 * missed
    assert with_blocks < clean + 0.1 * missed


def test_odometry_that_is_right_stays_right():
    rng = np.random.default_rng(7)
    true = round_the_room(11)
    motions = [Motion(compose(inverse(a), b), COVARIANCE) for a, b in pairwise(true)]
    matched = refined([room_scan(pose, rng) for pose in true], motions)
    assert heading_error(matched, true) < BIAS


def test_covariance_is_positive_definite_and_never_larger_than_odometrys():
    rng = np.random.default_rng(4)
    true = round_the_room(11)
    scans = [with_false_block(room_scan(pose, rng), rng) for pose in true]
    motions = biased_odometry(true)
    matched = refined(scans, motions)
    for motion, C in zip(motions, (m.covariance for m in matched), strict=True):
        np.testing.assert_allclose(C, C.T, rtol=1e-9, atol=1e-15)
        assert np.linalg.eigvalsh(C).min() > 0.0
        odometry = motion.covariance
        assert np.linalg.eigvalsh(odometry - C).min() >= -1e-9
    assert matched[-1].covariance[2, 2] < 0.8 * BIAS**2


def corridor_scan(y, rng, half_width=0.8, max_range=4.0):
    """Two blank walls along the robot's way; the end of the corridor is out of range."""
    angle = np.linspace(-math.radians(33), math.radians(33), 265)
    s = np.sin(angle)
    with np.errstate(divide="ignore"):
        ranges = np.where(s > 0, half_width - y, half_width + y) / np.abs(s)
    ranges = ranges + rng.normal(0, 0.01, ranges.size)
    return scan(np.where(ranges < max_range, ranges, np.inf), max_range=max_range)


@pytest.mark.parametrize("seed", range(5))
def test_a_blank_corridor_helps_across_and_in_heading_and_leaves_the_way_along_alone(seed):
    rng = np.random.default_rng(seed)
    scans = [corridor_scan(0.1, rng) for _ in range(11)]
    true, off = np.array([STEP, 0.0, 0.0]), np.array([0.0, 0.01, BIAS])
    motions = [Motion(true + off, COVARIANCE)] * 10
    matched = refined(scans, motions)
    along, across, heading = np.abs([m.increment - true for m in matched]).T
    assert along.max() < 0.002
    assert across.mean() < 0.5 * off[1]
    assert heading.mean() < 0.5 * off[2]
    share = np.array([np.diag(m.covariance) / DOUBT**2 for m in matched])
    assert share[:, 0].min() > 0.95
    assert share[:, 1:].max() < 0.95
    with_memory = share[5:].mean(axis=0)
    assert with_memory[1] < 0.85
    assert with_memory[2] < 0.5


def test_exact_odometry_is_left_untouched():
    rng = np.random.default_rng(6)
    ego = EgoMotion(CELL)
    for pose in round_the_room(4):
        motion = Motion(np.array([STEP, 0.01, 0.02]))
        assert ego.refine(room_scan(pose, rng), motion) is motion


def test_a_matched_motion_keeps_its_stamps():
    rng = np.random.default_rng(6)
    ego = EgoMotion(CELL)
    first, second = round_the_room(2)
    ego.refine(room_scan(first, rng), Motion.none(10))
    odometry = Motion(compose(inverse(first), second), COVARIANCE, 10, 20)
    matched = ego.refine(room_scan(second, rng), odometry)
    assert matched is not odometry
    assert (matched.first, matched.last) == (10, 20)


def sparse(n):
    """A scan of a wall 2 m ahead with `n` hits that count; all other columns are unknown."""
    ranges = np.full(265, np.nan)
    ranges[100 : 100 + 2 * n] = 2.0
    return scan(ranges)


@pytest.mark.parametrize(("n", "left_alone"), [(MIN_HITS - 1, True), (MIN_HITS, False)])
def test_a_scan_with_too_few_hits_leaves_the_motion_untouched(n, left_alone):
    ego = EgoMotion(CELL)
    ego.refine(room_scan(np.zeros(3), np.random.default_rng(0)), Motion.none(0))
    motion = Motion(np.array([STEP, 0.0, 0.0]), COVARIANCE)
    assert (ego.refine(sparse(n), motion) is motion) == left_alone


@pytest.mark.parametrize("nothing", [np.nan, np.inf])
def test_scans_without_a_hit_pass_the_motion_on_and_harm_no_later_match(nothing):
    rng = np.random.default_rng(8)
    blind = scan(np.full(265, nothing))
    motion = Motion(np.array([STEP, 0.0, 0.0]), COVARIANCE)
    ego = EgoMotion(CELL)
    assert ego.refine(blind, motion) is motion
    assert ego.refine(blind, motion) is motion

    true = round_the_room(11)
    scans = [room_scan(pose, rng) for pose in true]
    scans[4] = blind
    motions = biased_odometry(true)
    matched = refined(scans, motions)
    assert matched[3] is motions[3]
    assert heading_error(matched, true) < 0.6 * heading_error(motions, true)


def test_a_first_scan_has_nothing_to_be_matched_with():
    motion = Motion(np.array([STEP, 0.0, 0.0]), COVARIANCE)
    assert (
        EgoMotion(CELL).refine(room_scan(np.zeros(3), np.random.default_rng(0)), motion) is motion
    )


def test_hits_about_max_range_away_are_left_out():
    ranges = np.array([3.0, 0.0, 3.79, 0.0, 3.81, 0.0, 4.0, 0.0, np.inf, 0.0, np.nan])
    points, doubt = hits(scan(ranges, sigma=0.1, max_range=4.0))
    np.testing.assert_allclose(np.hypot(*points.T), [3.0, 3.79])
    np.testing.assert_allclose(doubt, 0.1)


def test_hits_stand_in_the_robots_frame():
    turned = scan([2.0, 2.0, 2.0], fov=180.0, origin=(0.1, -0.2, math.radians(90)))
    points, _ = hits(turned)
    np.testing.assert_allclose(points, [[2.1, -0.2], [-1.9, -0.2]], atol=1e-12)


BETWEEN = 3  # pairs from one observation to the next
PAIRS = 60


def biased_pairs():
    """Scan and odometry of every pair of a drive round the room, BETWEEN pairs a STEP."""
    rng = np.random.default_rng(9)
    true = round_the_room(PAIRS, STEP / BETWEEN)
    turned = np.array([0.0, 0.0, BIAS / BETWEEN])
    motions = [Motion.none(0)] + [
        Motion(compose(inverse(a), b) + turned, COVARIANCE / BETWEEN, i, i + 1)
        for i, (a, b) in enumerate(pairwise(true))
    ]
    return [(room_scan(pose, rng), motion) for pose, motion in zip(true, motions, strict=True)]


def mapper_of(ego_motion):
    return HierarchicalMapper(MappingSettings(ego_motion=ego_motion, particles=20, window=5), 1)


@pytest.mark.parametrize("ego_motion", ["raw", "matched"])
def test_every_pair_gets_a_pose_and_at_a_closing_it_is_the_best_particles(ego_motion):
    mapper, closings = mapper_of(ego_motion), 0
    for pair in biased_pairs():
        before = len(mapper.filter.health)
        pose = mapper.add(*pair)
        np.testing.assert_array_equal(pose, mapper.online[-1])
        if len(mapper.filter.health) > before:
            closings += 1
            best = mapper.filter.poses[mapper.filter.best]
            np.testing.assert_allclose(mapper.online[-1], best, rtol=0, atol=1e-12)
    assert closings >= 3
    _, path = mapper.finish()
    assert path.shape == np.array(mapper.online).shape == (PAIRS, 3)
    assert np.isfinite(path).all()


def test_matched_motion_leads_the_pairs_between_local_maps_better_than_raw_odometry():
    true = round_the_room(PAIRS, STEP / BETWEEN)
    turn = compose(inverse(true[0]), true)[:, 2]
    errors = {}
    for ego_motion in ("raw", "matched"):
        mapper = mapper_of(ego_motion)
        for seen, motion in biased_pairs()[: 4 * BETWEEN]:
            mapper.add(seen, motion)
        assert not mapper.filter.health, "a local map closed"
        errors[ego_motion] = abs(mapper.path()[-1, 2] - turn[4 * BETWEEN - 1])
    assert errors["matched"] < 0.8 * errors["raw"]


def test_between_observations_the_pose_moves_on_by_odometry():
    mapper, previous, between = mapper_of("matched"), np.zeros(3), 0
    for seen, motion in biased_pairs():
        due = mapper.gate.step(motion.increment)
        mapper.move(motion)
        step = compose(inverse(previous), mapper.pose)
        np.testing.assert_allclose(step, motion.increment, rtol=0, atol=1e-12)
        if due:
            mapper.observe(seen)
        between += not due
        previous = mapper.pose
    assert between > PAIRS / 2


def test_the_path_spreads_a_correction_over_the_pairs_before_it():
    """No step of the path differs from odometry's by more than its whole interval does."""
    mapper, observed = mapper_of("matched"), []
    for i, (seen, motion) in enumerate(biased_pairs()):
        due = mapper.gate.step(motion.increment)
        mapper.move(motion)
        if due:
            mapper.observe(seen)
            observed.append(i)
    path, odometry = mapper.path(), np.array(mapper.odometry)

    def corrected(i, j):
        steps = [compose(inverse(p[i]), p[j]) for p in (path, odometry)]
        return np.abs(compose(inverse(steps[1]), steps[0]))

    tolerance = np.array([1e-3, 1e-3, 1e-9])
    whole = [corrected(i, j) for i, j in pairwise(observed)]
    for (i, j), most in zip(pairwise(observed), whole, strict=True):
        for k in range(i, j):
            assert (corrected(k, k + 1) <= most + tolerance).all()
    assert np.max(whole, axis=0)[2] > 0.5 * BIAS
