"""Nearest obstacle per column: support, height band, unknown apart from free."""

from __future__ import annotations

import math

import numpy as np
import pytest

from calibration.rig import Mount
from stereo.columns import ALWAYS, Columns, nearest_per_column
from stereo.ranger import StereoRanger
from stereo.rectify import RectifiedCamera
from stereo.settings import StereoSettings
from tests.stereo_rigs import crooked_rig, level_camera, straight_rig, texture
from tests.stereo_scenes import Sheet, facing, see

CAMERA = level_camera(120, 60)
# Each of a column's pixels shows more than three times the noise, 8 units of evidence, of which
# a pixel of support is worth 3: 40 pixels of support are 15 such ones in three columns.
SETTINGS = StereoSettings(support=40)
# Between whole pixels a small window's match errs by up to a fifth of one: of the 5 px of the far
# wall that is 4 %. All columns together err by much less.
SMOOTHING, MIDDLE = 0.04, 0.01
NONE = -16
FAR, NEAR = 5 * 16, 10 * 16  # 2 m and 1 m of `level_camera`
DISPARITIES = 32
BLANK_ROWS = 8
SECANT = np.hypot(1.0, (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.f)


def wall(value: int) -> np.ndarray:
    """Disparities of a wall, but for the first rows, which are blank."""
    disparity = np.full((CAMERA.height, CAMERA.width), value, np.int16)
    disparity[:BLANK_ROWS] = NONE
    return disparity


def images_of(disparity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A textured pair with these disparities, whole pixels; where there is none, blank."""
    left, right = texture(disparity.shape, 1), texture(disparity.shape, 2)
    left[disparity <= 0] = right[:BLANK_ROWS] = 128
    v, u = np.nonzero(disparity > 0)
    order = np.argsort(disparity[v, u], kind="stable")  # the nearest last, before the others
    v, u = v[order], u[order]
    at = u - disparity[v, u] // 16
    right[v[at >= 0], at[at >= 0]] = left[v[at >= 0], u[at >= 0]]
    return left, right


def nearest(
    disparity: np.ndarray,
    settings: StereoSettings = SETTINGS,
    max_range: float = 4.0,
    camera: RectifiedCamera = CAMERA,
) -> Columns:
    seen = np.repeat(np.array([[0], [camera.width]] * 2, np.int32), camera.height, axis=1)
    images = images_of(disparity)
    return nearest_per_column(disparity, images, seen, camera, settings, DISPARITIES, max_range)


def test_a_wall_is_seen_at_its_horizontal_distance():
    found = nearest(wall(FAR))
    assert np.isnan(found.range[:4]).all()  # outside the right image
    answered = np.isfinite(found.range)
    assert answered[8:].all()
    answered[-2:] = False  # half of their neighbours are missing
    assert np.allclose(found.range[answered], 2.0 * SECANT[answered], rtol=SMOOTHING)
    middle = np.median(found.range[answered] / SECANT[answered])
    assert middle == pytest.approx(2.0, rel=MIDDLE)
    assert (found.support[answered] > 100).all()
    assert (found.support[np.isnan(found.range)] == 0).all()


def test_sigma_is_that_of_a_disparity_seen_through_the_geometry():
    sure = math.sqrt(ALWAYS) * SETTINGS.noise
    for value, depth in ((FAR, 2.0), (NEAR, 1.0)):
        sigma = nearest(wall(value)).sigma[20:-4]
        # Z^2 / (f B) times the disparity's; the range is Z times secant.
        least = depth**2 / 10.0 * sure * SECANT[20:-4]
        assert (sigma > 0.99 * least).all()
        assert np.median(sigma / least) < 6.0  # few rows: far from what is sure


@pytest.mark.parametrize(("rows", "seen"), [(3, 2.0), (7, 1.0)])
def test_the_nearer_of_two_wins_with_support_only(rows, seen):
    disparity = wall(FAR)
    disparity[20 : 20 + rows, 40:64] = NEAR
    ranges = nearest(disparity).range
    assert ranges[44:60] == pytest.approx(seen * SECANT[44:60], rel=SMOOTHING)
    beside = np.r_[10:36, 68:118]
    assert ranges[beside] == pytest.approx(2.0 * SECANT[beside], rel=SMOOTHING)


def test_neighbouring_columns_lend_their_support():
    disparity = wall(FAR)
    disparity[20:27, 40:64] = NEAR
    ranges = nearest(disparity).range
    # Seven rows are 21 pixels in three columns, 14 where the thing ends.
    assert (ranges[44:60] < 1.1).all()
    assert not (ranges[[40, 63]] < 1.1).any()


def test_pixels_that_disagree_lend_no_support():
    disparity = wall(FAR)
    disparity[20:23, 40:64] = NEAR
    disparity[23:26, 40:64] = NEAR + 3 * 16
    assert nearest(disparity).range[52] == pytest.approx(2.0, abs=0.01)


def test_what_no_neighbour_confirms_is_unknown():
    disparity = wall(FAR)
    disparity[:, 40:42] = NEAR
    ranges = nearest(disparity).range
    assert np.isnan(ranges[40:42]).all()
    assert (ranges[44:] > 1.9).all()


def test_support_one_is_the_plain_nearest():
    rng = np.random.default_rng(3)
    # Every second disparity, so that no two pixels agree by chance but the same ones.
    disparity = (16 * 2 * rng.integers(3, 12, (CAMERA.height, CAMERA.width))).astype(np.int16)
    disparity[rng.random(disparity.shape) < 0.9] = NONE
    disparity[:, :24] = NONE  # would lie outside the right image
    found = nearest(disparity, StereoSettings(support=1, height_min=-5.0, height_max=5.0))
    with np.errstate(divide="ignore"):
        depth = np.where(disparity > 0, 10.0 * 16 / disparity, np.inf)
    floor = 0.6 + depth * (CAMERA.cy - np.arange(CAMERA.height)[:, None]) / CAMERA.f
    depth[floor < 3.0 * depth * math.hypot(math.tan(math.radians(0.5)), 0.6 * 0.25 / 10.0)] = np.inf
    plain = depth.min(axis=0) * SECANT
    plain[np.isinf(plain)] = np.nan
    plain[plain > 4.0] = np.inf
    assert np.isfinite(plain).sum() > 40
    assert np.allclose(found.range, plain, equal_nan=True)
    finite = np.isfinite(plain)
    assert np.allclose(found.sigma[finite], (plain**2 * 0.25 / (10.0 * SECANT))[finite])


@pytest.mark.parametrize("rig", [straight_rig(), crooked_rig(20.0)])
def test_floor_and_ceiling_are_no_obstacles_but_a_table_is(rig):
    ranger = StereoRanger(rig)
    grain = texture((1200, 900), 7)

    def seen(z: float) -> np.ndarray:
        """Ranges in a hall with a level sheet at that height."""
        level = Sheet((0.2, -6.0, z), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (4.3, 12.0), grain)
        far = facing(ranger.max_range + 1.0)
        return ranger(see(rig, [level, far], noise=1.0, finer=2)).range

    floor = seen(0.0)
    assert np.isposinf(floor).mean() > 0.9
    assert not np.isfinite(floor).any()
    assert not np.isfinite(seen(1.5)).any()
    table = seen(0.25)
    assert np.isfinite(table).mean() > 0.25
    assert not np.isposinf(table).mean() > 0.05


def test_only_what_was_matched_beyond_the_range_is_free():
    disparity = wall(FAR)
    disparity[:, 30:45] = NONE
    disparity[:, 60:70] = NONE
    disparity[20:24, 60:70] = NEAR
    found = nearest(disparity, max_range=1.5)
    assert np.isnan(found.range[30:45]).all()
    assert np.isnan(found.range[60:70]).all()  # four rows: too few for an obstacle or for free
    assert np.isposinf(found.range[[*range(10, 30), *range(45, 60), *range(70, 120)]]).all()
    assert np.isnan(found.sigma).all()


def test_a_lone_near_pixel_before_a_far_wall_does_not_hide_that_the_way_is_free():
    disparity = wall(FAR)
    disparity[30, 37] = NEAR
    assert np.isposinf(nearest(disparity, max_range=1.5).range[37])


def test_a_mount_higher_than_the_band_still_works():
    high = straight_rig(Mount(height=1.5, pitch=math.radians(20.0)))
    camera = StereoRanger(high).camera
    assert camera.height >= 8
