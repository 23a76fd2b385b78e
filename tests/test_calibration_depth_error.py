"""What a disparity error does to depth, and how much a camera sees."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.depth_error import DISPARITY_SIGMA, TOLERANCE, depth_sigma, usable_range
from calibration.field_of_view import angle_of, field_of_view
from calibration.lens import rays
from calibration.rig import CameraModel
from stereo.ranger import USABLE_SIGMA
from stereo.ranger import usable_range as range_used_by_mapping
from stereo.settings import StereoSettings
from tests.rig_files import cameras


def test_depth_error_is_that_of_a_drawn_disparity():
    rng = np.random.default_rng(1)
    z = np.array([0.5, 1.0, 2.0])
    disparity = 530.0 * 0.06 / z
    drawn = 530.0 * 0.06 / (disparity + rng.normal(0.0, 0.25, (100_000, 1)))
    np.testing.assert_allclose(depth_sigma(530.0, 0.06, z), drawn.std(axis=0), rtol=0.02)


def test_people_are_told_what_mapping_uses():
    assert StereoSettings().noise == DISPARITY_SIGMA
    assert USABLE_SIGMA == TOLERANCE
    told = usable_range(530.0, 0.06)
    assert told == pytest.approx(range_used_by_mapping(530.0 * 0.06, DISPARITY_SIGMA, TOLERANCE))
    assert depth_sigma(530.0, 0.06, told) == pytest.approx(TOLERANCE)


def test_a_pinhole_sees_what_its_focal_length_says():
    camera = CameraModel(320.0, 240.0, 319.5, 239.5)
    across, down = field_of_view(camera, (640, 480))
    assert across == pytest.approx(math.radians(90.0), abs=1e-6)
    assert down == pytest.approx(math.radians(90.0), abs=1e-6)
    # A part of the image that lies beside the principal point.
    beside, _ = field_of_view(replace(camera, cx=-0.5 - 320.0), (320, 480))
    assert beside == pytest.approx(math.atan(2.0) - math.atan(1.0), abs=1e-6)


@given(
    st.sampled_from(["radtan", "rational", "fisheye"]).flatmap(cameras),
    st.floats(-0.5, 639.5),
    st.floats(-0.5, 479.5),
)
def test_the_angle_of_a_pixel_is_that_of_its_ray(camera, u, v):
    angle = angle_of(replace(camera, distortion=(*camera.distortion[:2], 0, 0)), (u, v))
    assert angle is not None
    camera = replace(camera, distortion=(*camera.distortion[:2], 0, 0))
    (ray,) = rays(camera, np.array([[u, v]]))
    assert angle == pytest.approx(math.acos(min(ray[2], 1.0)), abs=1e-5)


def test_a_lens_that_folds_back_before_the_edge_is_told():
    camera = CameraModel(400.0, 400.0, 319.5, 239.5, "radtan", (-0.6, 0.0, 0.0, 0.0))
    across, down = field_of_view(camera, (640, 480))
    assert across is None
    assert down is None
