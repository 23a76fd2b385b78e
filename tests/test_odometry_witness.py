"""What is wrong with odometry, found from the scans: recovered within its uncertainty, or not
told."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.odometry_witness import OdometryErrors, OdometryWitness
from mapping.settings import MappingSettings
from odometry.motion import Motion, compose, inverse
from stereo.scan import RangeScan
from tests.scan_logs import BEAMS, FIELD_OF_VIEW, look

NOISE = 0.02  # m, of the ranges
STEP = 0.17  # m
SPOILT = [(0.03, 0.03, 0.0), (-0.05, 0.0, 0.0), (0.0, -0.08, 0.0), (0.0, 0.0, math.radians(-2.0))]


@pytest.fixture(scope="module")
def drive() -> tuple[np.ndarray, list[RangeScan]]:
    """True poses (n, 3) round the pillar, now this way and now that, with what is seen there."""
    turn = np.linspace(0.01, 0.01 + 2.0 * math.pi, 52, endpoint=False)  # no beam along a wall
    to_the_left = [_on_the_way(a, 1.0) for a in turn]
    to_the_right = [_on_the_way(-a, -1.0) for a in turn]
    poses = np.array((to_the_left * 2 + to_the_right * 2) * 2 + to_the_left)
    rng = np.random.default_rng(5)
    bearing = -FIELD_OF_VIEW / 2 + np.arange(BEAMS) * FIELD_OF_VIEW / BEAMS
    sigma = np.full(BEAMS, NOISE)
    scans = [
        RangeScan(0, (0.0, 0.0, 0.0), bearing, look(pose) + rng.normal(0, NOISE, BEAMS), sigma, 9.0)
        for pose in poses
    ]
    return poses, scans


def _on_the_way(angle: float, way: float) -> tuple[float, float, float]:
    """On the ellipse round the pillar, weaving a little."""
    reach = 1.0 + 0.08 * math.sin(7.0 * angle)
    heading = math.atan2(1.1 * math.sin(angle) * way, 1.8 * math.cos(angle) * way)
    return 1.8 * reach * math.sin(angle), -1.1 * reach * math.cos(angle), heading


def witnessed(poses, scans, spoilt, seed=1) -> OdometryErrors | None:
    """What the witness says of odometry that is off by (distance, rotation, drift)."""
    distance, rotation, drift = spoilt
    rng = np.random.default_rng(seed)
    witness = OdometryWitness(MappingSettings())
    steps = compose(inverse(poses[:-1]), poses[1:])
    witness.move(Motion.none(0))
    witness.observe(scans[0])
    for step, scan in zip(steps, scans[1:], strict=True):
        travel = math.copysign(math.hypot(*step[:2]), step[0])
        told = step * (1.0 + distance, 1.0 + distance, 1.0 + rotation) + (0.0, 0.0, drift * travel)
        told += rng.normal(0.0, 1.0, 3) * (0.01 * travel, 0.003 * travel, math.radians(0.2))
        witness.move(Motion(told))
        witness.observe(scan)
    return witness.errors()


@pytest.mark.parametrize("spoilt", SPOILT)
def test_errors_of_odometry_are_recovered_within_their_uncertainty(drive, spoilt):
    poses, scans = drive
    errors = witnessed(poses, scans, spoilt)
    assert errors is not None
    assert (np.abs(errors.value - spoilt) < 2.0 * errors.error).all()
    assert (errors.error < (0.008, 0.008, math.radians(0.3))).all()
    assert errors.significant.tolist() == [value != 0.0 for value in spoilt]


def test_a_wheel_too_large_turns_the_other_way_in_reverse(drive):
    poses, scans = drive
    half = len(poses) // 2
    there_and_back = [*range(half), *range(half - 2, -1, -1)]
    drift = math.radians(3.0)
    errors = witnessed(poses[there_and_back], [scans[k] for k in there_and_back], (0, 0, drift))
    assert errors is not None
    assert abs(errors.value[2] - drift) < 3.0 * errors.error[2]
    assert errors.significant[2]


def test_good_odometry_is_not_blamed(drive):
    poses, scans = drive
    errors = witnessed(poses, scans, (0.0, 0.0, 0.0), seed=2)
    assert errors is not None
    assert not errors.significant.any()


def test_a_few_slips_do_not_spoil_the_estimate(drive):
    poses, scans = drive
    moved = poses.copy()
    for at in range(60, 400, 80):  # the wheels spin, the robot stands
        slip = compose(compose(moved[at], np.array([0.3, 0.0, 0.1])), inverse(moved[at]))
        moved[at:] = compose(slip, moved[at:])
    errors = witnessed(moved, scans, (0.03, 0.0, 0.0))
    assert errors is not None
    assert abs(errors.value[0] - 0.03) < min(2.0 * errors.error[0], 0.01)


def test_short_runs_and_robots_that_see_nothing_or_never_turn_tell_nothing(drive):
    poses, scans = drive
    assert OdometryWitness(MappingSettings()).errors() is None
    assert witnessed(poses[:100], scans[:100], (0.1, 0.0, 0.0)) is None
    nothing = np.full(BEAMS, np.nan)
    blind = [RangeScan(0, s.origin, s.bearing, nothing, nothing, 9.0) for s in scans]
    assert witnessed(poses, blind, (0.1, 0.0, 0.0)) is None
    at_rest = np.tile(poses[0], (100, 1))
    assert witnessed(at_rest, [scans[0]] * 100, (0.0, 0.0, 0.0)) is None


def test_nothing_small_or_doubtful_is_significant():
    errors = OdometryErrors(np.array([0.05, 0.005, 0.0]), np.array([0.03, 0.0001, 0.0]))
    assert errors.significant.tolist() == [False, False, False]
