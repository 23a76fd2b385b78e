"""Ego-motion matched on scans: what it corrects, what it leaves alone, its covariance."""

import math
from itertools import pairwise

import numpy as np
import pytest

from mapping.ego_motion import MIN_HITS, EgoMotion, hits
from mapping.settings import MappingSettings
from odometry.motion import Motion, compose, inverse
from simulation.paper import PaperSettings, simulate
from simulation.world import load_world
from tests.mapping_data import (
    CELL,
    MIRROR,
    mirrored,
    room_ranges,
    round_the_room,
    scan,
    wall,
)

CORRELATED = math.radians(MappingSettings().correlated)
STEP = 0.17  # travel between observations [m]
BIAS = math.radians(0.5)  # turn that odometry misses at every step
DOUBT = np.array([0.01, 0.01, BIAS])
COVARIANCE = np.diag(DOUBT**2)


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
    ego = EgoMotion(CELL, CORRELATED)
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


def test_the_robots_frame_is_that_of_its_odometrys_doubt():
    """The same drive on a grid that lies a quarter turn aside: odometry is doubtful along the
    robot's way, wherever that leads on the grid."""
    rng = np.random.default_rng(3)
    true = round_the_room(12)
    scans = [room_scan(pose, rng) for pose in true]
    doubt = np.diag([0.03, 0.003, BIAS]) ** 2
    ahead = np.array([0.02, 0.0, 0.0])
    motions = [Motion(compose(inverse(a), b) + ahead, doubt) for a, b in pairwise(true)]
    first = [Motion.none(0), Motion(np.array([0.0, 0.0, math.pi / 2]))]
    drives = []
    for start in first:
        ego = EgoMotion(CELL, CORRELATED)
        ego.refine(scans[0], start)
        drives.append([ego.refine(s, m) for s, m in zip(scans[1:], motions, strict=True)])
    sd = np.sqrt([[np.diag(m.covariance) for m in drive] for drive in drives])
    np.testing.assert_allclose(sd[0], sd[1], rtol=0.3)
    off = np.array([a.increment - b.increment for a, b in zip(*drives, strict=True)])
    assert (np.abs(off) < sd[0]).all()
    assert (sd[0][:, 1] < 0.003 + 1e-9).all()


def test_exact_odometry_is_left_untouched():
    rng = np.random.default_rng(6)
    ego = EgoMotion(CELL, CORRELATED)
    for pose in round_the_room(4):
        motion = Motion(np.array([STEP, 0.01, 0.02]))
        assert ego.refine(room_scan(pose, rng), motion) is motion


def test_a_matched_motion_keeps_its_stamps():
    rng = np.random.default_rng(6)
    ego = EgoMotion(CELL, CORRELATED)
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
    ego = EgoMotion(CELL, CORRELATED)
    ego.refine(room_scan(np.zeros(3), np.random.default_rng(0)), Motion.none(0))
    motion = Motion(np.array([STEP, 0.0, 0.0]), COVARIANCE)
    assert (ego.refine(sparse(n), motion) is motion) == left_alone


@pytest.mark.parametrize("nothing", [np.nan, np.inf])
def test_scans_without_a_hit_pass_the_motion_on_and_harm_no_later_match(nothing):
    rng = np.random.default_rng(8)
    blind = scan(np.full(265, nothing))
    motion = Motion(np.array([STEP, 0.0, 0.0]), COVARIANCE)
    ego = EgoMotion(CELL, CORRELATED)
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
        EgoMotion(CELL, CORRELATED).refine(room_scan(np.zeros(3), np.random.default_rng(0)), motion)
        is motion
    )


def test_hits_about_max_range_away_are_left_out():
    ranges = np.array([3.0, 3.79, 3.81, 4.0, np.inf, np.nan])
    points, doubt, _ = hits(scan(ranges, sigma=0.1, max_range=4.0), CORRELATED)
    np.testing.assert_allclose(np.hypot(*points.T), [3.0, 3.79])
    np.testing.assert_allclose(doubt, 0.1)


def test_hits_stand_in_the_robots_frame():
    turned = scan([2.0, np.nan, 2.0], fov=180.0, origin=(0.1, -0.2, math.radians(90)))
    points, _, _ = hits(turned, CORRELATED)
    np.testing.assert_allclose(points, [[2.1, -0.2], [-1.9, -0.2]], atol=1e-12)


@pytest.mark.parametrize(
    ("beams", "used", "share"), [(265, 133, 0.5 / 3.0), (67, 67, 1.0 / 3.0), (12, 12, 1.0)]
)
def test_dense_beams_are_thinned_and_count_by_the_angle_that_shares_an_error(beams, used, share):
    """Over 66 deg, every half degree is enough; errors are shared over three."""
    points, _, kappa = hits(scan(wall(2.0, beams)), math.radians(3.0))
    assert len(points) == used
    assert kappa == pytest.approx(share)


@pytest.fixture(scope="module")
def paper_run():
    """The paper's robot on the first part of its way: 400 positions, 80 m."""
    world = load_world("flat")
    assert world.route is not None
    return simulate(world, world.route, PaperSettings(positions=400), 1)


@pytest.fixture(scope="module")
def paper_motions(paper_run):
    """Its matched motions; the simulated errors of neighbouring beams are independent."""
    ego = EgoMotion(CELL, math.radians(0.6))
    return [ego.refine(*pair) for pair in zip(paper_run.scans, paper_run.motions, strict=True)]


def errors(motions, true):
    """Of the increments to poses (n, 3), (n - 1, 3), and their covariances."""
    off = np.array([m.increment for m in motions[1:]]) - compose(inverse(true[:-1]), true[1:])
    return off, np.array([m.covariance for m in motions[1:]])


def nees(motions, true):
    """Normalised squared errors (n - 1,): chi-square with 3 degrees of freedom when fair."""
    off, covariance = errors(motions, true)
    return (off * np.linalg.solve(covariance, off[:, :, None])[..., 0]).sum(axis=1)


def test_the_covariance_is_that_of_the_errors(paper_run, paper_motions):
    """NEES averages 3 for a fair covariance, with a standard error of .12 over 400 steps."""
    fair = nees(paper_run.motions, paper_run.truth)
    assert fair.mean() == pytest.approx(3.0, abs=0.5)
    matched = nees(paper_motions, paper_run.truth)
    assert 2.0 < matched.mean() < 4.5
    assert np.mean(matched < 7.815) > 0.9  # 95 % of chi-square


def test_matching_mends_the_papers_odometry(paper_run, paper_motions):
    raw, covariance = errors(paper_run.motions, paper_run.truth)
    matched, smaller = errors(paper_motions, paper_run.truth)
    rms = np.sqrt((matched**2).mean(axis=0) / (raw**2).mean(axis=0))
    assert (rms < (0.7, 0.8, 0.7)).all()
    assert np.linalg.det(smaller).mean() < 0.1 * np.linalg.det(covariance).mean()


def assert_alike(increments, motions):
    """Increments (n, 3) are those of the motions, but for the raster of the density: on it they
    scatter by a fraction of their doubt, without favouring a side."""
    off = (increments - np.array([m.increment for m in motions]))[1:]
    off /= np.sqrt([np.diag(m.covariance) for m in motions[1:]])
    assert (np.sqrt((off**2).mean(axis=0)) < 0.4).all()
    assert (np.abs(off) < 2.0).all()
    assert (np.abs(off.mean(axis=0)) < 0.06).all()


def test_where_the_grid_lies_does_not_matter(paper_run, paper_motions, monkeypatch):
    """Nor whether it is drawn anew: a wider one need not be."""
    monkeypatch.setattr("mapping.ego_motion.TRAVEL", 20.0)
    ego = EgoMotion(CELL, math.radians(0.6))
    pairs = zip(paper_run.scans, paper_run.motions, strict=True)
    assert_alike([ego.refine(seen, motion).increment for seen, motion in pairs], paper_motions)


def test_a_mirrored_drive_gives_mirrored_motions(paper_run, paper_motions):
    ego = EgoMotion(CELL, math.radians(0.6))
    pairs = mirrored(list(zip(paper_run.scans, paper_run.motions, strict=True)))
    assert_alike([ego.refine(*pair).increment * MIRROR for pair in pairs], paper_motions)
