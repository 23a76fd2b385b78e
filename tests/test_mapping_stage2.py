"""Stage 2: what a local map decides, eqs (6) to (8), resampling, the path between local maps."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.global_kernels import FREE, MARGIN, NEAR_OCCUPIED, OBSERVED, OCCUPIED, POSSIBLE
from mapping.local_cells import classify
from mapping.particle_filter import ParticleFilter, log_likelihoods, systematic_resample
from mapping.path import join
from mapping.sensor_model import SensorModel, log_odds
from mapping.settings import MappingSettings
from mapping.tiles import STEPS_PER_LOG_ODDS
from odometry.motion import Motion, compose, inverse
from tests.mapping_data import CELL, local_map

MODEL = SensorModel.of(MappingSettings())
PAPER = MappingSettings(particles=4, match_tolerance=0)


def decided(probabilities, model, tolerance):
    """The bits of a local map of probabilities, without its margin, and its cells."""
    p = np.array(probabilities)
    with np.errstate(divide="ignore"):
        cells = classify(local_map(np.log(p / (1 - p))), model, tolerance)
    return cells.bits[MARGIN:-MARGIN, MARGIN:-MARGIN], cells


def test_classify_by_the_thresholds_with_tolerance_one():
    p = [[0.5, 0.71, 0.69], [0.19, 0.21, np.nan], [0.5, 0.5, 0.5], [0.5, 0.5, 0.5]]
    bits, _ = decided(p, MODEL, 1)
    assert (bits & OCCUPIED > 0).tolist() == [[False, True, False]] + [[False] * 3] * 3
    assert (bits & FREE > 0)[1].tolist() == [True, False, False]
    assert (bits & OBSERVED > 0)[1].tolist() == [True, True, False]
    assert (bits & NEAR_OCCUPIED > 0).tolist() == [[True] * 3] * 2 + [[False] * 3] * 2
    exact, cells = decided(p, MODEL, 0)
    assert ((exact & NEAR_OCCUPIED > 0) == (exact & OCCUPIED > 0)).all()
    # Beyond the local map nothing was observed, and its corner has moved out by that margin.
    assert np.count_nonzero(cells.bits) == np.count_nonzero(exact)
    np.testing.assert_allclose(cells.origin, -MARGIN * CELL)


def test_a_single_look_decides_for_the_per_scan_method_only():
    """One hit gives .84, one miss .34: by .7 and .2 alone no single look would free a cell."""
    looks = [[0.84375, 0.3382, np.nan]]
    both, _ = decided(looks, MODEL, 0)
    assert (both[0] & OCCUPIED > 0).tolist() == [True, False, False]
    assert not (both[0] & FREE).any()
    per_scan = SensorModel.of(MappingSettings(method="per-scan"))
    bits, _ = decided(looks, per_scan, 0)
    assert (bits[0] & OCCUPIED > 0).tolist() == [True, False, False]
    assert (bits[0] & FREE > 0).tolist() == [False, True, False]
    undecided, _ = decided([[0.5]], per_scan, 0)
    assert undecided[0, 0] == OBSERVED


def test_what_is_possible_is_marked_within_the_tolerance():
    L = np.zeros((5, 7))
    possible = np.zeros((5, 7), bool)
    possible[2, 3] = True
    cells = classify(replace(local_map(L), possible=possible), MODEL, 1)
    marked = cells.bits[MARGIN:-MARGIN, MARGIN:-MARGIN] & POSSIBLE > 0
    assert np.argwhere(marked).tolist() == [[i, j] for i in (1, 2, 3) for j in (2, 3, 4)]


def test_eq_8_rewards_matching_and_the_unjudged_get_the_mean():
    overlap = np.array([100, 100, 200, 10, 0])
    matched = np.array([100, 50, 150, 10, 0])
    log_l = log_likelihoods(overlap, matched, MappingSettings(match_weight=50.0))
    np.testing.assert_allclose(log_l[:3], [0.0, -25.0, -12.5])
    mean = math.log((1.0 + math.exp(-25.0) + math.exp(-12.5)) / 3.0)
    np.testing.assert_allclose(log_l[3:], mean)
    assert (log_likelihoods(overlap[3:], matched[3:], MappingSettings()) == 0).all()


def two_walls(shift: int) -> np.ndarray:
    """Log-odds of 100 obstacle cells in column 5 and as many in column 15 + shift, free between."""
    L = np.full((100, 40), log_odds(0.1))
    L[:, [5, 15 + shift]] = log_odds(0.9)
    return L


def test_eqs_6_to_8_of_a_filter_by_hand():
    """Of 200 obstacle cells that particles 0 and 1 see again 200 and 100 match."""
    f = ParticleFilter(MappingSettings(particles=2, match_tolerance=0, match_weight=4.0))
    f.add(local_map(two_walls(0)))
    assert (f.log_weights == 0).all()  # nothing to match yet
    f.poses = np.array([[0.0, 0.0, 0.0], [10 * CELL, 0.0, 0.0]])
    # Particle 1 holds the map's walls at columns 5 and 15 against its own at 15 and 25: S counts
    # the one that lies on an observed cell.
    health = f.add(local_map(two_walls(3)))
    np.testing.assert_allclose(f.log_likelihood, [-4.0 * 0.5, 0.0])
    assert health.overlap == 100
    assert health.matched == 1.0
    w = np.exp([-2.0, 0.0])
    w /= w.sum()
    assert health.n_eff == pytest.approx(1.0 / (w**2).sum())
    assert not health.resampled


def test_eqs_1_and_2_in_the_global_map():
    f = ParticleFilter(PAPER)
    walls = local_map(two_walls(0))
    for seen in range(1, 4):
        f.add(walls)
        grid = f.grid()
        row, column = (round(-v / CELL) for v in (grid.origin[1], grid.origin[0]))
        L = np.log(grid.probability / (1.0 - grid.probability))[row : row + 100, column:]
        tolerance = seen * 0.5 / STEPS_PER_LOG_ODDS
        np.testing.assert_allclose(L[:, [5, 15]], seen * MODEL.occupied_step, atol=tolerance)
        np.testing.assert_allclose(L[:, 6:15], seen * MODEL.free_step, atol=tolerance)


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
    st.lists(st.one_of(st.just(0.0), st.floats(1e-9, 1)), min_size=1, max_size=50).filter(
        lambda w: sum(w) > 1e-6
    ),
    st.floats(0, 1, exclude_max=True),
)
@settings(max_examples=200)
def test_resampling_always_names_existing_particles_of_weight(weights, offset):
    w = np.array(weights) / sum(weights)
    chosen = systematic_resample(w, offset)
    assert len(chosen) == len(w)
    assert (w[chosen] > 0).all()
    counts = np.bincount(chosen, minlength=len(w))
    assert (np.abs(counts - len(w) * w) < 1 + 1e-6).all()


def test_rounding_draws_no_particle_without_weight():
    """Ten tenths add up to a little less than one: what is left is not the last particle's."""
    weights = np.array([0.1] * 10 + [0.0])
    assert np.cumsum(weights)[-1] < 1.0
    assert systematic_resample(weights, np.nextafter(1.0, 0.0)).max() < 10


def test_resampling_takes_poses_likelihoods_and_maps_along():
    """All weight on one particle: the others go on as copies of it."""
    f = ParticleFilter(PAPER)
    f.add(local_map(two_walls(0)))
    f.poses[:] = np.array([[0.0, 0, 0], [7 * CELL, 0, 0], [2 * CELL, 0, 0], [-3 * CELL, 0, 0]])
    f.log_likelihood = np.array([1.0, 2.0, 3.0, 4.0])
    f.log_weights = np.array([-1e3, -1e3, 0.0, -1e3])
    health = f.add(local_map(two_walls(0), motion=Motion(np.array([CELL, 0.0, 0.0]))))
    assert health.resampled
    assert health.n_eff == pytest.approx(1.0)
    np.testing.assert_allclose(f.poses, [[3 * CELL, 0.0, 0.0]] * 4)
    assert (f.log_weights == 0).all()
    assert len(set(f.log_likelihood)) == 1
    maps = [f.grid(k).probability for k in range(4)]
    for other in maps[1:]:
        np.testing.assert_array_equal(other, maps[0])
    np.testing.assert_allclose(f.path(0)[-2:, 0], [2 * CELL, 3 * CELL])


@given(
    st.lists(
        st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)), min_size=6, max_size=12
    )
)
@settings(max_examples=50)
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
