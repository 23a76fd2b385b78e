"""The mapper between its observations and local maps: where it puts the pairs, and the path."""

import math
from itertools import pairwise

import numpy as np
import pytest

from mapping.mapper import HierarchicalMapper
from mapping.settings import MappingSettings
from odometry.motion import Motion, compose, inverse
from tests.mapping_data import room_ranges, round_the_room, scan

STEP = 0.17  # travel between observations [m]
BIAS = math.radians(0.5)  # turn that odometry misses at every step
COVARIANCE = np.diag([0.01, 0.01, BIAS]) ** 2
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
    return [
        (scan(room_ranges(pose) + rng.normal(0, 0.01, 265)), motion)
        for pose, motion in zip(true, motions, strict=True)
    ]


def mapper_of(ego_motion):
    return HierarchicalMapper(MappingSettings(ego_motion=ego_motion, particles=20, window=5), 1)


@pytest.mark.parametrize("ego_motion", ["raw", "matched"])
def test_every_pair_gets_a_pose_and_at_a_closing_it_is_the_particles_mean(ego_motion):
    mapper, closings = mapper_of(ego_motion), 0
    for pair in biased_pairs():
        before = len(mapper.filter.health)
        pose = mapper.add(*pair)
        np.testing.assert_array_equal(pose, mapper.online[-1])
        if len(mapper.filter.health) > before:
            closings += 1
            mean = mapper.filter.estimate().increment
            np.testing.assert_allclose(mapper.online[-1], mean, rtol=0, atol=1e-12)
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
