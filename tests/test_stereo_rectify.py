"""Rectification: points land on one row, disparity gives their depth, columns their bearing."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import cv2
import numpy as np
import pytest

from calibration.rig import CameraModel, Mount
from stereo.errors import StereoError
from stereo.rectify import Rectifier
from tests.stereo_rigs import SHAPE, SIZE, crooked_rig, project, straight_rig, texture

HEIGHTS = (0.1, 1.2)
SPREAD = 2.5  # of the spots [px]


def spot(at: np.ndarray) -> np.ndarray:
    """A bright spot in a dark image (H, W) uint8."""
    v, u = np.indices(SHAPE)
    return np.rint(
        250.0 * np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2.0 * SPREAD**2))
    ).astype(np.uint8)


def centroid(image: np.ndarray) -> tuple[float, float]:
    """Column and row of the spot; NaN unless it lies wholly inside."""
    weight = image.astype(float)
    edge = max(weight[0].max(), weight[-1].max(), weight[:, 0].max(), weight[:, -1].max())
    if edge > 1.0 or weight.sum() < 1000.0:
        return math.nan, math.nan
    v, u = np.indices(image.shape)
    return float((u * weight).sum() / weight.sum()), float((v * weight).sum() / weight.sum())


@pytest.mark.parametrize("pitch", [-5.0, 0.0, 10.0, 25.0])
def test_points_of_a_crooked_rig_come_out_where_they_are(pitch):
    rig = crooked_rig(pitch)
    rectify = Rectifier(rig, HEIGHTS, nearest=0.5)
    camera = rectify.camera
    seen = 0
    for X, bearing, Z in product((0.9, 1.5, 3.0), (-0.35, 0.0, 0.3), (0.2, 0.5, 0.8)):
        true = np.array([X, bearing * X, Z])
        raw = project(rig, true)
        if not all((at > 12.0).all() and (at < np.array(SIZE) - 13.0).all() for at in raw):
            continue  # a spot cut by the image's edge has another middle
        left, right = rectify(*map(spot, raw))
        (u, v), (u_right, v_right) = centroid(left), centroid(right)
        if math.isnan(u + u_right):
            continue
        seen += 1
        assert v_right == pytest.approx(v, abs=0.05)
        ahead = camera.rotation.T @ (true - camera.position)
        assert u - u_right == pytest.approx(camera.depth_factor / ahead[2], abs=0.06)
        ray = np.array([(u - camera.cx) / camera.f, (v - camera.cy) / camera.f, 1.0])
        assert np.allclose(ray * ahead[2], ahead, atol=0.05 / camera.f * ahead[2])
    assert seen >= 8


@pytest.mark.parametrize("pitch", [-5.0, 25.0])
def test_the_virtual_cameras_look_along_the_floor(pitch):
    camera = Rectifier(crooked_rig(pitch, roll_deg=0.0), HEIGHTS, nearest=0.5).camera
    # The columns' axis stands upright up to the little that the baseline leans.
    assert camera.rotation[:, 1] @ [0.0, 0.0, -1.0] > math.cos(math.radians(2.0))
    assert camera.rotation[:, 2] @ [0.0, 0.0, 1.0] == pytest.approx(0.0, abs=0.05)


def test_only_rows_that_can_hold_obstacles_are_made():
    low = Rectifier(straight_rig(Mount(height=0.3)), (0.1, 0.4), nearest=1.0).camera
    everything = Rectifier(straight_rig(Mount(height=0.3)), (0.0, 3.0), nearest=0.2).camera
    assert low.height < 0.5 * SIZE[1]
    assert everything.height == SIZE[1]


def test_rectified_level_images_are_cut_not_resampled():
    rig = replace(straight_rig(), rectified=True)
    rectify = Rectifier(rig, (0.3, 0.9), nearest=1.0)
    image = texture(SHAPE)
    left, right = rectify(image, image)
    first = round(rig.left.cy - rectify.camera.cy)
    assert np.array_equal(left, image[first : first + rectify.camera.height])
    assert np.array_equal(left, right)


def test_fisheye_lenses_are_rectified():
    lens = CameraModel(200.0, 200.0, 159.5, 119.5, "fisheye", (0.02, -0.01, 0.003, 0.0))
    rig = replace(straight_rig(), left=lens, right=lens)
    rectify = Rectifier(rig, HEIGHTS, nearest=0.5)
    at = cv2.fisheye.distortPoints(np.array([[[0.3, 0.1]]]), lens.K, lens.D).ravel()
    u, v = centroid(rectify(spot(at), spot(at))[0])
    camera = rectify.camera
    assert (u - camera.cx) / camera.f == pytest.approx(0.3, abs=3e-4)
    assert (v - camera.cy) / camera.f == pytest.approx(0.1, abs=3e-4)


def test_colour_images_are_accepted_and_keep_their_colours():
    rectify = Rectifier(crooked_rig(5.0), HEIGHTS, nearest=0.5)
    grey = texture(SHAPE)
    colour = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    for a, b in zip(rectify(grey, grey), rectify(colour, grey), strict=True):
        assert np.array_equal(a, b)
    shape = (rectify.camera.height, rectify.camera.width, 3)
    assert rectify.left_in_colour(colour).shape == shape


@pytest.mark.parametrize("side", ["left", "right"])
def test_images_of_another_size_are_refused(side):
    images = {"left": texture(SHAPE), "right": texture(SHAPE)}
    images[side] = texture((480, 640))
    rectify = Rectifier(straight_rig(), HEIGHTS, nearest=0.5)
    with pytest.raises(StereoError, match=f"the {side} image is 640x480.*for 320x240"):
        rectify(**images)


@pytest.mark.parametrize(
    ("T", "message"),
    [
        ((0.12, 0.0, 0.0), "exchange the left and right images"),
        ((0.0, -0.12, 0.0), "do not stand side by side"),
        ((-0.02, 0.0, 0.12), "do not stand side by side"),
    ],
)
def test_a_baseline_that_points_elsewhere_is_refused(T, message):
    with pytest.raises(StereoError, match=message):
        Rectifier(replace(straight_rig(), T=np.array(T)), HEIGHTS, nearest=0.5)


def test_a_rig_on_its_side_is_refused():
    with pytest.raises(StereoError, match="baseline stands upright"):
        Rectifier(straight_rig(Mount(roll=math.radians(90.0))), HEIGHTS, nearest=0.5)


def test_a_camera_that_sees_no_obstacle_is_refused():
    with pytest.raises(StereoError, match="no image row can hold an obstacle"):
        Rectifier(straight_rig(Mount(height=0.3, pitch=math.radians(-60))), HEIGHTS, nearest=3.0)
