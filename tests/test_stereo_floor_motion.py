"""Motion over the floor from what the camera sees, held against the truth of the recording."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from calibration.hand_eye import solve_hand_eye
from odometry.motion import compose, inverse
from pipeline.recordings import open_recording
from stereo.disparity import SUBPIXEL, DisparityMatcher
from stereo.floor_motion import Features, find_features, motion_between
from stereo.rectify import Rectifier
from stereo.settings import StereoSettings
from tests.stereo_rigs import SHAPE, straight_rig


@pytest.fixture(scope="module")
def frames(office_piece):
    """Features of some pairs of the office, the camera, and the true poses of its foot."""
    recording = open_recording(office_piece)
    rig = recording.rig
    assert rig is not None
    assert rig.mount is not None
    assert recording.poses is not None
    place = np.array([rig.mount.x, rig.mount.y, rig.mount.yaw])
    rectify = Rectifier(rig, (-1e3, 1e3), 0.1)
    match = DisparityMatcher(rectify.camera, StereoSettings())
    found, poses = [], []
    for number in range(0, 30, 2):
        files = recording.pairs[number]
        pair = files.load()
        left, right = rectify(pair.left, pair.right)
        disparity = match(left, right).astype(np.float32) / SUBPIXEL
        found.append(find_features(left, disparity, rectify.camera))
        at = np.searchsorted(recording.poses.stamps, files.stamp)
        poses.append(compose(recording.poses.poses[at], place))
    return found, rectify.camera, np.array(poses)


def test_the_motion_is_the_true_one(frames):
    features, camera, poses = frames
    true = compose(inverse(poses[:-1]), poses[1:])
    assert np.hypot(*true[:, :2].T).max() > 0.1
    errors = []
    for a, b, motion in zip(features[:-1], features[1:], true, strict=True):
        seen = motion_between(a, b, camera)
        assert seen is not None
        errors.append(seen.increment - motion)
    errors = np.array(errors)
    assert abs(errors[:, :2]).max() < 0.04
    assert np.median(abs(errors[:, :2])) < 0.012
    assert np.degrees(abs(errors[:, 2])).max() < 0.6


def test_seen_motion_tells_where_the_camera_sits(frames):
    features, camera, poses = frames
    # A robot whose origin lies elsewhere and which looks aside of where the camera looks.
    place = np.array([0.15, -0.08, math.radians(-25.0)])
    robot = compose(poses, inverse(place))
    wheels = compose(inverse(robot[:-1]), robot[1:])
    seen = [motion_between(a, b, camera) for a, b in itertools.pairwise(features)]
    assert all(seen)
    found = solve_hand_eye(
        wheels,
        np.array([motion.increment for motion in seen if motion]),
        np.array([motion.covariance[:2, :2] for motion in seen if motion]),
        (0.0, 0.0, 0.0),
    )
    error = np.array([found.x, found.y, found.yaw]) - place
    assert (abs(error) < 4.0 * found.sigma).all()
    assert abs(error[:2]).max() < 0.03
    assert math.degrees(abs(error[2])) < 1.5


def test_the_same_bytes_each_time(frames):
    features, camera, _ = frames
    first, second = (motion_between(features[0], features[1], camera) for _ in range(2))
    assert first is not None
    assert second is not None
    assert first.increment.tobytes() == second.increment.tobytes()


def test_where_nothing_matches_there_is_no_motion(frames):
    features, camera, _ = frames
    level = Rectifier(straight_rig(), (-1e3, 1e3), 0.1).camera
    blank = find_features(np.full(SHAPE, 90, np.uint8), np.full(SHAPE, 9.0, np.float32), level)
    assert len(blank.pixels) == 0
    assert motion_between(blank, features[0], camera) is None
    chance = np.random.default_rng(0)
    foreign = Features(
        features[0].pixels,
        features[0].points,
        chance.integers(0, 256, features[0].descriptors.shape).astype(np.uint8),
    )
    assert motion_between(foreign, features[1], camera) is None
