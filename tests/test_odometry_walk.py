"""Motion between odometry poses: increments that lead back to them, doubt as on encoders' arcs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from odometry.differential_drive import drive
from odometry.motion import Motion, compose
from odometry.settings import OdometrySettings
from odometry.walk import LEAST, leaps, step_covariances, walk

TRACK = 0.3
coordinate = st.floats(-6.0, 6.0)  # no two of them a leap apart
pose = st.tuples(coordinate, coordinate, st.floats(-math.pi, math.pi))


@given(st.lists(pose, min_size=1, max_size=8))
def test_the_motions_lead_from_pose_to_pose(poses):
    stamps = np.arange(len(poses), 0, -1) * 10  # times may run backwards
    motions = walk(stamps, np.array(poses), OdometrySettings())
    assert [m.last for m in motions] == stamps.tolist()
    assert [m.first for m in motions] == [stamps[0], *stamps[:-1]]
    assert not motions[0].increment.any()
    assert not motions[0].covariance.any()
    at = np.array(poses[0])
    for motion, goal in zip(motions, poses, strict=True):
        at = compose(at, motion.increment)
        assert at[:2] == pytest.approx(goal[:2], abs=1e-6)
        assert math.cos(at[2] - goal[2]) == pytest.approx(1.0)
        assert np.linalg.eigvalsh(motion.covariance)[0] >= 0.0


@pytest.mark.parametrize("paths", [(0.2, 0.2), (0.18, 0.22), (-0.1, -0.11)])
def test_a_step_is_doubted_as_the_same_arc_of_the_wheels(paths):
    settings = OdometrySettings(along=0.03, across=0.01, heading=1.0, turn=2.0)
    increment, covariance = drive(np.array([paths]), TRACK, np.zeros(2), settings)
    (walked,) = step_covariances(increment[None], settings)
    # The chord of an arc is a little shorter than the arc.
    assert walked == pytest.approx(covariance, rel=0.01, abs=1e-9)


def test_doubt_grows_as_a_random_walk():
    settings = OdometrySettings(along=0.03, across=0.02, heading=1.0, turn=0.0)
    poses = np.zeros((41, 3))
    poses[:, 0] = np.linspace(0.0, 4.0, 41)
    total = Motion.none(0)
    for motion in walk(np.arange(41), poses, settings):
        total = total.then(motion)
    assert math.sqrt(total.covariance[0, 0]) == pytest.approx(0.03 * 2.0, rel=1e-3)
    assert math.degrees(math.sqrt(total.covariance[2, 2])) == pytest.approx(2.0, rel=1e-3)


def test_standing_still_is_hardly_doubted_and_never_without_doubt():
    (still,) = step_covariances(np.zeros((1, 3)), OdometrySettings())
    assert (np.diag(still) > 0.0).all()
    assert (np.sqrt(np.diag(still)) < 1e-3).all()
    assert still[0, 0] == pytest.approx(OdometrySettings().along ** 2 * LEAST)


def test_settings_of_zero_make_odometry_exact():
    exact = OdometrySettings(along=0, across=0, heading=0, turn=0)
    moves = np.array([[0.2, 0.0, 0.3], [0.0, 0.0, 0.0]])
    assert not step_covariances(moves, exact).any()


def test_no_poses_no_motions():
    assert walk(np.zeros(0, int), np.zeros((0, 3)), OdometrySettings()) == []


def test_a_leap_of_odometry_is_no_motion():
    poses = np.array([[0, 0, 0], [0.2, 0, 0], [5000, 0, 0], [0.4, 0, 0], [0.6, 0, 0.1]], float)
    assert leaps(poses).tolist() == [False, True, True, False]
    motions = walk(np.arange(5), poses, OdometrySettings())
    assert not motions[2].increment.any()
    assert not motions[3].increment.any()
    assert math.sqrt(motions[3].covariance[0, 0]) > 0.1
    assert motions[4].increment == pytest.approx([0.2, 0.0, 0.1])
