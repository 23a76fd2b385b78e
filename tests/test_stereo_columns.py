"""Nearest obstacle per column: support, height band, unknown apart from free."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from calibration.rig import Mount
from stereo.columns import _column_histogram, _nearest_supported, nearest_per_column
from stereo.ranger import StereoRanger
from stereo.rectify import RectifiedCamera
from stereo.settings import StereoSettings
from tests.stereo_rigs import crooked_rig, level_camera, straight_rig

SETTINGS = StereoSettings(support=8)
# The mean over three columns is not quite the middle one's range.
SMOOTHING = 2e-3
NONE = -16
FAR, NEAR = 5 * 16, 10 * 16  # 2 m and 1 m of `level_camera`
DISPARITIES = 32


def nearest(disparity, settings=SETTINGS, max_range=4.0, camera=None):
    camera = camera or level_camera()
    return nearest_per_column(disparity, camera, settings, DISPARITIES, max_range)


def wall(value: int, camera: RectifiedCamera | None = None) -> np.ndarray:
    camera = camera or level_camera()
    return np.full((camera.height, camera.width), value, np.int16)


def secant(camera: RectifiedCamera) -> np.ndarray:
    """Horizontal distance over depth of each column."""
    return np.hypot(1.0, (np.arange(camera.width) - camera.cx) / camera.f)


def test_a_wall_is_seen_at_its_horizontal_distance():
    ranges, sigmas = nearest(wall(FAR))
    assert np.allclose(ranges, 2.0 * secant(level_camera()), rtol=SMOOTHING)
    # sigma of the depth is Z^2 / (f B) times that of the disparity; the range is Z times secant.
    assert np.allclose(sigmas, 2.0**2 / 10.0 * SETTINGS.noise * secant(level_camera()), rtol=0.01)


@pytest.mark.parametrize(("pixels", "seen"), [(7, 2.0), (8, 1.0)])
def test_the_nearer_of_two_wins_with_support_only(pixels, seen):
    disparity = wall(FAR)
    disparity[20 : 20 + pixels, 20] = NEAR
    ranges, _ = nearest(disparity)
    assert ranges[20] == pytest.approx(seen * secant(level_camera())[20], rel=SMOOTHING)
    assert np.allclose(np.delete(ranges, 20), 2.0, atol=0.05)


def test_neighbouring_columns_lend_their_support():
    disparity = wall(FAR)
    disparity[20:23, 19:22] = NEAR
    ranges, _ = nearest(disparity)
    assert ranges[20] == pytest.approx(1.0, abs=1e-3)
    assert ranges[[19, 21]] == pytest.approx(2.0, abs=0.01)  # 6 pixels are too few


def test_pixels_that_disagree_lend_no_support():
    disparity = wall(FAR)
    disparity[20:24, 20] = NEAR
    disparity[24:28, 20] = NEAR + 3 * 16
    assert nearest(disparity)[0][20] == pytest.approx(2.0, abs=0.01)


def test_support_one_is_the_plain_nearest():
    camera = level_camera()
    rng = np.random.default_rng(3)
    # Every second disparity, so that no two pixels agree by chance but the same ones.
    disparity = (16 * 2 * rng.integers(3, 12, (camera.height, camera.width))).astype(np.int16)
    disparity[rng.random(disparity.shape) < 0.9] = NONE
    settings = StereoSettings(support=1, height_min=-5.0, height_max=5.0)
    ranges, _ = nearest(disparity, settings)
    with np.errstate(divide="ignore"):
        depth = np.where(disparity > 0, 10.0 * 16 / disparity, np.inf)
    plain = depth.min(axis=0) * secant(camera)
    plain[np.isinf(plain)] = np.nan
    assert np.allclose(ranges, plain, rtol=SMOOTHING, equal_nan=True)


def plane_disparity(camera: RectifiedCamera, z: float) -> np.ndarray:
    """Disparity of the horizontal plane at height z on the robot, none above the horizon."""
    v, u = np.indices((camera.height, camera.width))
    rays = np.stack([(u - camera.cx) / camera.f, (v - camera.cy) / camera.f, np.ones(u.shape)])
    upward = np.tensordot(camera.rotation, rays, 1)[2]
    with np.errstate(divide="ignore"):
        Z = (z - camera.position[2]) / upward
    reachable = (Z > 0.3) & (Z < 50.0)
    return np.where(reachable, np.rint(16 * camera.depth_factor / Z), NONE).astype(np.int16)


@pytest.mark.parametrize("rig", [straight_rig(), crooked_rig(0.0), crooked_rig(20.0)])
def test_floor_and_ceiling_are_no_obstacles_but_a_table_is(rig):
    ranger = StereoRanger(rig, SETTINGS)
    camera = ranger.camera

    def seen(z: float) -> np.ndarray:
        ranges, _ = nearest_per_column(
            plane_disparity(camera, z), camera, SETTINGS, ranger.match.disparities, 4.0
        )
        return ranges

    assert np.isnan(seen(0.0)).all()
    assert np.isnan(seen(1.3)).all()
    assert np.isfinite(seen(0.25)).mean() > 0.8


def test_only_what_was_matched_beyond_the_range_is_free():
    disparity = wall(FAR)
    disparity[:, 10:20] = NONE
    disparity[:5, 30] = NEAR
    disparity[5:, 30] = NONE
    ranges, sigmas = nearest(disparity, max_range=1.5)
    assert np.isnan(ranges[10:20]).all()
    assert math.isnan(ranges[30])  # five pixels answer: too few for an obstacle or for free
    beyond = np.delete(np.arange(40), [*range(10, 20), 30])
    assert np.isposinf(ranges[beyond]).all()
    assert np.isnan(sigmas).all()


def test_a_lone_near_pixel_before_a_far_wall_does_not_hide_that_the_way_is_free():
    disparity = wall(FAR)
    disparity[30, 7] = NEAR
    assert np.isposinf(nearest(disparity, max_range=1.5)[0][7])


def histogram_twin(disparity, rotation, intrinsics, height, band, disparities):
    f, cx, cy, baseline = intrinsics
    low, high, tilt, noise = band
    columns = disparity.shape[1]
    v, u = np.indices(disparity.shape)
    valid = disparity > 0
    d = np.where(valid, disparity, 16) / 16.0
    Z = f * baseline / d
    rays = np.stack([(u - cx) / f, (v - cy) / f, np.ones(u.shape)])
    X, Y, up = Z * np.tensordot(rotation, rays, 1)
    up = up + height
    doubt = 3.0 * np.hypot(Z * tilt, height * noise / d)
    valid &= (up >= np.maximum(low, doubt)) & (up <= high) & (X > 0)
    column = np.rint(cx - f * Y / np.where(X > 0, X, 1.0)).astype(int)
    valid &= (column >= 0) & (column < columns)
    count = np.zeros((columns, disparities + 1), np.int32)
    nearness = np.zeros((columns, disparities + 1))
    where = column[valid], np.minimum(np.rint(d[valid]).astype(int), disparities)
    np.add.at(count, where, 1)
    np.add.at(nearness, where, 1.0 / np.hypot(X, Y)[valid])
    return count, nearness


def supported_twin(count, nearness, intrinsics, support, noise, max_range):
    f, cx, baseline = intrinsics
    columns = len(count)
    ranges, sigmas = np.full(columns, np.nan), np.full(columns, np.nan)
    for u in range(columns):
        near = slice(max(u - 1, 0), u + 2)
        for d in np.flatnonzero(count[u])[::-1]:
            agree = slice(max(d - 1, 0), d + 1)
            pixels = count[near, agree].sum()
            if d == 0 or pixels < support:
                continue
            r = pixels / nearness[near, agree].sum()
            ranges[u] = np.inf if r > max_range else r
            if r <= max_range:
                sigmas[u] = r**2 * noise / (f * baseline * np.hypot(1.0, (u - cx) / f))
            break
    return ranges, sigmas


@hypothesis_settings(max_examples=40)
@given(
    arrays(np.int16, (12, 9), elements=st.integers(-16, 16 * 20)),
    st.integers(1, 6),
    st.floats(-0.3, 0.3),
    st.floats(0.5, 8.0),
)
def test_the_kernels_equal_plain_numpy(disparity, support, pitch, max_range):
    c, s = math.cos(pitch), math.sin(pitch)
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    camera = level_camera(9, 12)
    histogram = (
        camera.rotation @ tilt,
        np.array([20.0, camera.cx, camera.cy, 0.5]),
        0.6,
        np.array([0.1, 1.2, 0.01, 0.25]),
        16,
    )
    count, nearness = _column_histogram(disparity, *histogram)
    expected_count, expected_nearness = histogram_twin(disparity, *histogram)
    assert np.array_equal(count, expected_count)
    assert np.allclose(nearness, expected_nearness)
    nearest_of = (np.array([20.0, camera.cx, 0.5]), support, 0.25, max_range)
    for found, expected in zip(
        _nearest_supported(count, nearness, *nearest_of),
        supported_twin(count, nearness, *nearest_of),
        strict=True,
    ):
        assert np.allclose(found, expected, equal_nan=True)


def test_a_mount_higher_than_the_band_still_works():
    high = straight_rig(Mount(height=1.5, pitch=math.radians(20.0)))
    camera = StereoRanger(high, SETTINGS).camera
    assert camera.height >= 8
