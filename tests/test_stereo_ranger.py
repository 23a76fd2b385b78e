"""StereoRanger: image pairs in, range scans out."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from calibration.rig import CameraModel, Mount, StereoRig
from pipeline.recordings import open_recording
from stereo.errors import StereoError
from stereo.pair import StereoPair
from stereo.ranger import USABLE_SIGMA, StereoRanger
from stereo.settings import StereoSettings
from tests.stereo_rigs import (
    BASELINE,
    SHAPE,
    F,
    crooked_rig,
    straight_rig,
    texture,
    wall_pair,
)


@pytest.mark.parametrize("depth", [0.8, 1.5, 2.5])
def test_a_textured_wall_is_ranged_within_sigma(depth):
    rig = straight_rig()
    scan = StereoRanger(rig)(StereoPair(7, *wall_pair(depth)))
    assert scan.stamp == 7
    assert scan.origin == (0.0, 0.0, pytest.approx(0.0))
    expected = depth / np.cos(scan.bearing)
    # The right camera does not see what lies in the left image's first columns.
    inside = scan.bearing < math.atan2(F - F * BASELINE / depth - 90, F)
    answered = np.isfinite(scan.range)
    assert answered[inside].mean() > 0.95
    errors = (scan.range - expected)[answered]
    assert np.sqrt(np.mean(errors**2)) < np.nanmean(scan.sigma)
    assert (np.abs(errors) < 3.0 * scan.sigma[answered]).mean() > 0.98


def test_a_wall_beyond_the_range_is_free_space():
    scan = StereoRanger(straight_rig(), max_range=2.0)(StereoPair(0, *wall_pair(3.0)))
    assert np.isposinf(scan.range).mean() > 0.8
    assert not np.isfinite(scan.range).any()
    assert scan.answered == np.isposinf(scan.range).mean()


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_a_blank_pair_tells_nothing(grey):
    blank = np.full(SHAPE, grey, np.uint8)
    scan = StereoRanger(straight_rig())(StereoPair(0, blank, blank))
    assert np.isnan(scan.range).all()
    assert scan.answered == 0.0


def test_left_and_right_exchanged_are_noticed(office_piece):
    recording = open_recording(office_piece)
    assert recording.rig is not None
    ranger = StereoRanger(recording.rig)
    for files in recording.pairs[::13]:
        pair = files.load()
        assert not ranger.looks_swapped(pair)
        assert ranger.looks_swapped(StereoPair(pair.stamp, pair.right, pair.left))
    blank = np.full(SHAPE, 90, np.uint8)
    assert not ranger.looks_swapped(StereoPair(0, blank, blank))
    noise = (texture(SHAPE, 1), texture(SHAPE, 2))
    assert not ranger.looks_swapped(StereoPair(0, *noise))


def test_points_of_a_wall_lie_on_it_in_its_colours():
    rig = straight_rig(Mount(height=0.6, x=0.1, y=0.06))
    left, right = wall_pair(1.5)
    colour = cv2.merge([left, left // 2, left // 4])
    ranger = StereoRanger(rig)
    points, rgb = ranger.points(ranger.frame(StereoPair(0, colour, right)), colour)
    assert len(points) > 500
    assert np.median(points[:, 0]) == pytest.approx(1.6, abs=0.02)
    assert points.shape == rgb.shape
    assert rgb.dtype == np.uint8
    assert (rgb[:, 2] >= rgb[:, 1]).all()  # blue was the brightest channel
    assert (rgb[:, 1] >= rgb[:, 0]).all()


def test_the_default_range_is_where_sigma_ceases_to_be_usable():
    ranger = StereoRanger(straight_rig())
    sigma = ranger.max_range**2 / (F * BASELINE) * ranger.settings.noise
    assert sigma == pytest.approx(USABLE_SIGMA)


def test_a_range_that_is_hardly_known_is_no_measurement(office_piece):
    recording = open_recording(office_piece)
    assert recording.rig is not None
    pair, rig = recording.pairs[0].load(), recording.rig
    wide, narrow = (StereoRanger(rig, max_range=8.0, usable_sigma=s)(pair) for s in (9.0, 0.05))
    vague = wide.sigma > 0.1
    assert 0 < vague.sum() < 0.9 * np.isfinite(wide.range).sum()
    assert np.isnan(narrow.range[vague]).all()
    np.testing.assert_array_equal(narrow.range[~vague], wide.range[~vague])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (StereoSettings(disparities=50), "stereo.disparities is 50: must be a multiple of 16"),
        (StereoSettings(disparities=320), "must be less than the image's width, 320"),
        (StereoSettings(block=4), "stereo.block is 4: must be odd"),
        (StereoSettings(height_min=1.0, height_max=0.5), "stereo.height_min 1.0 m is not below"),
    ],
)
def test_settings_that_contradict_are_refused(settings, message):
    with pytest.raises(StereoError, match=message):
        StereoRanger(straight_rig(), settings)


def test_a_very_wide_image_is_matched_to_its_right_end():
    camera = CameraModel(800.0, 800.0, 1199.5, 19.5)
    T = np.array([-BASELINE, 0.0, 0.0])
    rig = StereoRig((2400, 40), camera, camera, np.eye(3), T, True, Mount(height=0.6))
    wide = texture((40, 2440))
    pair = StereoPair(0, wide[:, :2400], wide[:, 40:])
    scan = StereoRanger(rig, StereoSettings(disparities=64))(pair)
    assert np.isfinite(scan.range[scan.bearing < math.atan2(-900, 800.0)]).mean() > 0.8


def test_two_threads_make_the_same_scans(office_piece):
    recording = open_recording(office_piece)
    assert recording.rig is not None
    pairs = [files.load() for files in recording.pairs[:12]]
    ranger = StereoRanger(recording.rig)
    alone = [ranger(pair) for pair in pairs]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(ranger, pairs))
    for a, b in zip(alone, together, strict=True):
        assert a.range.tobytes() == b.range.tobytes()
        assert a.sigma.tobytes() == b.sigma.tobytes()


angles = st.floats(-5.0, 5.0)


@hypothesis_settings(max_examples=40)
@given(
    st.tuples(angles, angles, angles),
    st.floats(-30.0, 40.0),
    st.floats(-20.0, 20.0),
    st.floats(-180.0, 180.0),
    st.floats(0.05, 1.5),
    st.integers(0, 2**32 - 1),
)
def test_every_scan_keeps_its_promises(bend, pitch, roll, yaw, height, seed):
    R, _ = cv2.Rodrigues(np.radians(bend))
    camera = CameraModel(60.0, 61.0, 39.0, 29.0, "radtan", (-0.1, 0.05, 0.001, 0.001))
    mount = Mount(height, math.radians(pitch), math.radians(roll), math.radians(yaw), 0.1, -0.2)
    rig = StereoRig((80, 60), camera, camera, R, R @ [-0.1, 0.0, 0.0], mount=mount)
    try:
        ranger = StereoRanger(rig, StereoSettings(disparities=16, support=2))
    except StereoError:
        assume(False)
        return
    wide = texture((60, 90), seed)
    scan = ranger(StereoPair(0, wide[:, :80].copy(), wide[:, 5:85].copy()))
    assert (np.diff(scan.bearing) > 0).all()
    assert len(scan.bearing) == len(scan.range) == len(scan.sigma) == 80
    finite = np.isfinite(scan.range)
    assert ((scan.range > 0) | np.isnan(scan.range)).all()
    assert (scan.range[finite] <= scan.max_range).all()
    assert np.array_equal(np.isfinite(scan.sigma), finite)
    assert (scan.sigma[finite] > 0).all()
    assert scan.origin[:2] == pytest.approx((0.1, -0.2))


def test_the_bearing_of_a_turned_camera_is_carried_by_the_origin():
    level = StereoRanger(straight_rig(Mount(height=0.6)))
    turned = StereoRanger(straight_rig(Mount(height=0.6, yaw=math.radians(90.0))))
    pair = StereoPair(0, *wall_pair(1.5))
    a, b = level(pair), turned(pair)
    assert b.origin[2] == pytest.approx(math.radians(90.0))
    assert np.array_equal(a.bearing, b.bearing)
    assert np.allclose(a.range, b.range, equal_nan=True)


def test_a_crooked_rig_ranges_what_an_ideal_one_does():
    """The wall of the straight rig, seen by distorted cameras through a warp of the images."""
    rig = crooked_rig(10.0)
    ranger = StereoRanger(rig)
    assert rig.mount is not None
    depth, sheet = 1.5, texture((1200, 1600), 5)
    images = []
    for camera, R, T in ((rig.left, np.eye(3), np.zeros(3)), (rig.right, rig.R, rig.T)):
        v, u = np.indices(SHAPE).astype(np.float64)
        pixels = np.stack([u.ravel(), v.ravel()], 1)[:, None]
        flat = cv2.undistortPoints(pixels, camera.K, camera.D).reshape(-1, 2)
        rays = np.column_stack([flat, np.ones(len(flat))]) @ R @ rig.mount.rotation.T
        centre = rig.mount.position - rig.mount.rotation @ R.T @ T
        # Where each ray meets the wall X = depth on the robot, in steps of 5 mm.
        hit = centre + rays * ((depth - centre[0]) / rays[:, :1])
        at = (hit[:, 1:] / 0.005 + [800, 600]).astype(np.float32).reshape(*SHAPE, 2)
        images.append(cv2.remap(sheet, at[..., 0], at[..., 1], cv2.INTER_LINEAR))
    scan = ranger(StereoPair(0, *images))
    x, y, yaw = scan.origin
    reached = x + scan.range * np.cos(yaw + scan.bearing)
    answered = np.isfinite(reached)
    assert answered.mean() > 0.7
    assert np.abs(reached[answered] - depth).mean() < np.nanmean(scan.sigma)
    assert y == pytest.approx(0.06)


def test_a_rig_without_a_mount_is_taken_as_level():
    without = StereoRanger(straight_rig(mount=None)).camera
    level = StereoRanger(straight_rig(Mount())).camera
    assert np.array_equal(without.rotation, level.rotation)
    assert without.position[2] == 0.3


def test_images_of_another_size_are_refused():
    ranger = StereoRanger(replace(straight_rig(), image_size=(640, 480)))
    with pytest.raises(StereoError, match=r"320x240.*640x480"):
        ranger(StereoPair(0, *wall_pair(1.5)))
