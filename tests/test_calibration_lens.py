"""Lenses: projection as OpenCV's, exact derivatives, and the way back."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.lens import LENSES, lens_of, rays
from calibration.rig import CameraModel
from calibration.rotation import skew, turn_matrix
from tests.calibration_views import fisheye_rig, pixels_of

COEFFICIENTS = {
    "radtan4": (-0.28, 0.10, 0.001, -0.0005),
    "radtan5": (-0.28, 0.10, 0.001, -0.0005, -0.02),
    "rational": (0.5, 0.2, 0.001, -0.0005, 0.02, 0.8, 0.3, 0.04),
    "fisheye": (0.02, -0.01, 0.003, -0.001),
}
PINHOLE = (500.0, 510.0, 320.0, 240.0)


def points(count: int = 40) -> np.ndarray:
    return np.random.default_rng(1).uniform(-0.5, 0.5, (count, 3)) + np.array([0, 0, 1.2])


@pytest.fixture(params=LENSES)
def lens_and_intrinsics(request):
    return LENSES[request.param], np.array(PINHOLE + COEFFICIENTS[request.param])


def test_projection_is_opencvs(lens_and_intrinsics):
    lens, intrinsics = lens_and_intrinsics
    camera = lens.camera(intrinsics)
    zero = np.zeros(3)
    if lens.name == "fisheye":
        expected = cv2.fisheye.projectPoints(points()[:, None], zero, zero, camera.K, camera.D)[0]
    else:
        expected = cv2.projectPoints(points(), zero, zero, camera.K, camera.D)[0]
    pixels = lens.project(intrinsics, points())[0]
    np.testing.assert_allclose(pixels, expected.reshape(-1, 2), atol=1e-10)


def test_derivatives_are_those_of_finite_differences(lens_and_intrinsics):
    lens, intrinsics = lens_and_intrinsics
    _, by_intrinsics, by_points = lens.project(intrinsics, points())
    step = 1e-6
    for column, along in enumerate(step * np.eye(len(intrinsics))):
        ahead, behind = (lens.project(intrinsics + s * along, points())[0] for s in (1, -1))
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(by_intrinsics[..., column], slope, atol=1e-6)
    for column, along in enumerate(step * np.eye(3)):
        ahead, behind = (lens.project(intrinsics, points() + s * along)[0] for s in (1, -1))
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(by_points[..., column], slope, atol=1e-5)


def test_rays_lead_back_to_the_points(lens_and_intrinsics):
    lens, intrinsics = lens_and_intrinsics
    pixels = lens.project(intrinsics, points())[0]
    expected = points() / np.linalg.norm(points(), axis=1, keepdims=True)
    np.testing.assert_allclose(rays(lens.camera(intrinsics), pixels), expected, atol=1e-12)


@given(k1=st.floats(-0.5, 0.3), off=st.floats(0, 1.3), azimuth=st.floats(-3, 3))
def test_rays_invert_any_lens_that_does_not_fold(k1, off, azimuth):
    camera = CameraModel(300, 305, 320, 240, "radtan", (k1, 0.6 * k1 * k1, 0.0003, -0.0002))
    point = np.array([[off * np.cos(azimuth), off * np.sin(azimuth), 1.0]])
    ray = rays(camera, pixels_of(camera, point))
    np.testing.assert_allclose(ray / ray[:, 2:], point, atol=1e-8)


def test_a_fisheye_lens_sees_behind_itself():
    camera = fisheye_rig(180).left
    angles = np.radians(np.linspace(0, 100, 24))
    behind = np.column_stack([np.sin(angles), 0.3 * np.sin(angles), np.cos(angles)])
    lens = lens_of(camera)
    pixels, _, by_points = lens.project(lens.intrinsics(camera), behind)
    np.testing.assert_allclose(pixels, pixels_of(camera, behind), atol=1e-9)
    assert np.isfinite(by_points).all()
    directions = behind / np.linalg.norm(behind, axis=1, keepdims=True)
    np.testing.assert_allclose(rays(camera, pixels), directions, atol=1e-9)


def test_a_pixel_that_no_point_reaches_has_a_ray_all_the_same():
    # With k1 = -0.4 alone no point lies further out than 0.61 focal lengths.
    camera = CameraModel(300, 300, 320, 240, "radtan", (-0.4, 0.0, 0.0, 0.0))
    assert np.isfinite(rays(camera, np.array([[0.0, 0.0], [639.0, 240.0]]))).all()


def test_cameras_know_their_lens():
    for name, numbers in COEFFICIENTS.items():
        camera = LENSES[name].camera(np.array(PINHOLE + numbers))
        assert lens_of(camera).name == name
        np.testing.assert_array_equal(LENSES[name].intrinsics(camera), PINHOLE + numbers)
    assert lens_of(CameraModel(1, 1, 0, 0)).name == "radtan4"
    assert LENSES["rational"].extends(LENSES["radtan4"])
    assert not LENSES["radtan4"].extends(LENSES["radtan5"])
    assert not LENSES["fisheye"].extends(LENSES["radtan4"])


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_turns_are_rotations(vector):
    vector = np.array(vector)
    np.testing.assert_allclose(turn_matrix(vector), cv2.Rodrigues(vector)[0], atol=1e-12)
    np.testing.assert_allclose(skew(vector) @ (1.0, 2.0, 3.0), np.cross(vector, (1, 2, 3)))
