"""The renderer against geometry that can be told without it."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.rig import CameraModel, Mount, RigError, StereoRig, minibee
from simulation.camera_rays import camera_poses, distort, undistort
from simulation.renderer import StereoRenderer
from simulation.true_disparity import raw_disparity, rectified_disparity
from stereo.ranger import StereoRanger
from tests.simulation_rooms import room, small_rig

POSE = np.array([1.0, 2.0, 0.0])


def level(rig: StereoRig) -> StereoRig:
    return rig.with_mount(Mount(height=0.5, x=0.1, y=0.06))


def test_depth_of_a_wall_ahead_is_exact():
    pair = StereoRenderer(room(), level(small_rig())).render(POSE, 0)
    height, width = pair.depth.shape
    assert (width, height) == (160, 120)
    middle = pair.depth[30:60, 45:115]  # the wall alone
    np.testing.assert_allclose(middle, 6.0 - 1.1, atol=1e-4)
    assert np.isfinite(pair.depth).all()


@pytest.mark.parametrize("pose", [(1.0, 2.0, 0.0), (1.5, 1.2, 0.4)])
def test_a_lamp_appears_where_both_camera_models_put_it(pose):
    lamp = {"material": "lamp", "at": [3.2, 2.4, 0.55], "size": [0.002, 0.14, 0.14]}
    mount = Mount(height=0.45, pitch=0.06, roll=-0.08, yaw=0.05, x=0.1, y=0.06)
    rig = small_rig().with_mount(mount)
    pair = StereoRenderer(room(lamp), rig, samples=4).render(np.array(pose), 0)
    face = np.array([3.199, 2.4, 0.62])
    views = camera_poses(rig, np.array(pose))
    for (rotation, position), camera, image in zip(
        views, (rig.left, rig.right), (pair.left, pair.right), strict=True
    ):
        point = rotation.T @ (face - position)
        expected = distort(camera, point[None, :2] / point[2])[0]
        v, u = np.nonzero(image > 250)
        assert len(u) > 15
        near = np.hypot(u - expected[0], v - expected[1]) < 10
        np.testing.assert_allclose((u[near].mean(), v[near].mean()), expected, atol=0.4)


def test_camera_poses_follow_r_and_t():
    rig = small_rig()
    (R0, p0), (R1, p1) = camera_poses(rig, np.array([3.0, 1.0, 0.7]))
    point = np.array([4.0, 2.0, 0.3])
    in_left, in_right = R0.T @ (point - p0), R1.T @ (point - p1)
    np.testing.assert_allclose(rig.R @ in_left + rig.T, in_right, atol=1e-12)
    c, s = math.cos(0.7), math.sin(0.7)
    np.testing.assert_allclose(p0, (3.0 + 0.1 * c - 0.06 * s, 1.0 + 0.1 * s + 0.06 * c, 0.3))


def _plain(rig: StereoRig, camera: CameraModel) -> StereoRig:
    return replace(rig, left=camera, right=camera, R=np.eye(3), T=np.array([-0.12, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("model", "coefficients"),
    [
        ("radtan", (-0.25, 0.08, 1e-3, -2e-3)),
        ("rational", (0.1, -0.05, 1e-3, -5e-4, 0.01, 0.3, -0.05, 0.01)),
        ("fisheye", (0.05, -0.01, 0.003, -0.001)),
    ],
)
def test_the_lens_bends_as_its_model_says(model, coefficients):
    scene = room({"material": "poster", "at": [3.0, 2.0, 0.1], "size": [0.02, 1.6, 1.0]})
    straight = minibee().left
    straight = replace(straight, fx=123.2, fy=123.2, cx=79.5, cy=59.5)
    bent = replace(straight, distortion_model=model, distortion=coefficients)
    rig = level(minibee().scaled(0.25))
    seen = StereoRenderer(scene, _plain(rig, bent)).render(POSE, 0).left.astype(np.float32)
    ideal = StereoRenderer(scene, _plain(rig, straight)).render(POSE, 1).left.astype(np.float32)
    maps = (
        cv2.fisheye.initUndistortRectifyMap if model == "fisheye" else cv2.initUndistortRectifyMap
    )(straight.K, bent.D, np.eye(3), straight.K, (160, 120), cv2.CV_32FC1)
    undone = cv2.remap(seen, *maps, cv2.INTER_LINEAR, borderValue=float("nan"))
    whole = np.isfinite(undone)
    assert whole.mean() > 0.6
    left_over = np.abs(undone - ideal)[whole].mean()
    bending = np.abs(seen - ideal)[whole].mean()
    assert left_over < 6.0
    assert left_over < 0.6 * bending


@settings(deadline=None, max_examples=60)
@given(
    k1=st.floats(-0.12, 0.3),
    k2=st.floats(-0.05, 0.1),
    p1=st.floats(-2e-3, 2e-3),
    p2=st.floats(-2e-3, 2e-3),
)
def test_undistort_inverts_distort(k1, k2, p1, p2):
    camera = replace(small_rig().left, distortion_model="radtan", distortion=(k1, k2, p1, p2))
    corners = np.array([[0.0, 0.0], [159.0, 0.0], [159.0, 119.0], [80.0, 60.0], [0.0, 119.0]])
    np.testing.assert_allclose(distort(camera, undistort(camera, corners)), corners, atol=0.01)


def test_a_lens_that_cannot_be_inverted_is_refused():
    rig = small_rig()
    folded = replace(rig.left, distortion=(-3.0, 0.0, 0.0, 0.0))
    with pytest.raises(RigError, match="cannot be inverted"):
        StereoRenderer(room(), replace(rig, left=folded))


def test_a_rig_without_a_mount_is_refused():
    with pytest.raises(RigError, match="mount"):
        StereoRenderer(room(), replace(small_rig(), mount=None))


def test_same_seed_same_bytes_and_other_seed_differs_by_the_noise():
    scene, rig = room(), small_rig()
    first = StereoRenderer(scene, rig, seed=1).render(POSE, 7)
    again = StereoRenderer(scene, rig, seed=1).render(POSE, 7)
    other = StereoRenderer(scene, rig, seed=2).render(POSE, 7)
    later = StereoRenderer(scene, rig, seed=1).render(POSE, 8)
    assert (first.left == again.left).all()
    assert (first.right == again.right).all()
    assert (first.depth == again.depth).all()
    for pair in (other, later):
        difference = pair.left.astype(float) - first.left
        assert difference.std() == pytest.approx(math.sqrt(2.0) * 1.7, rel=0.15)
        assert abs(difference.mean()) < 0.1


def test_both_cameras_see_the_same_grey_of_a_surface():
    scene = room({"material": "poster", "at": [3.0, 2.0, 0.1], "size": [0.02, 1.6, 1.0]})
    rig = level(minibee().scaled(0.25))
    pair = StereoRenderer(scene, rig).render(POSE, 0)
    depth = 2.99 - 1.1
    shift = 123.2 * 0.12 / depth
    columns, rows = np.meshgrid(np.arange(70, 120), np.arange(20, 70))
    moved = cv2.remap(
        pair.right, (columns - shift).astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR
    )
    own = pair.left[20:70, 70:120].astype(float)
    assert np.abs(moved - own).mean() < 8.0
    unmoved = pair.right[20:70, 70:120]
    assert np.abs(moved - own).mean() < 0.3 * np.abs(unmoved - own).mean()


def test_disparity_of_the_raw_images_leads_to_the_same_lamp():
    lamp = {"material": "lamp", "at": [3.2, 2.4, 0.55], "size": [0.002, 0.14, 0.14]}
    rig = small_rig().with_mount(Mount(height=0.8, pitch=0.06, roll=-0.08, x=0.1, y=0.06))
    pair = StereoRenderer(room(lamp), rig, samples=4).render(POSE, 0)
    moved = raw_disparity(rig, pair.depth)
    places = []
    for image in (pair.left, pair.right):
        v, u = np.nonzero(image[45:] > 250)  # below the ceiling's lamp
        places.append(np.array([u.mean(), v.mean() + 45]))
    u, v = np.rint(places[0]).astype(int)
    np.testing.assert_allclose(moved[v, u], places[0] - places[1], atol=0.3)
    assert abs(moved[v, u, 1]) > 0.4  # the cameras are out of line


@pytest.mark.parametrize("pitch", [0.0, 0.2])
def test_disparity_of_the_rectified_band_is_that_of_the_wall(pitch):
    rig = small_rig().with_mount(Mount(height=0.5, pitch=pitch, x=0.1, y=0.06))
    renderer = StereoRenderer(room(), rig)
    camera = StereoRanger(rig).camera
    disparity = rectified_disparity(renderer.tracer, rig, camera, POSE)
    assert disparity.shape == (camera.height, camera.width)
    row = round(camera.cy)
    ahead = np.abs(np.arange(160) - camera.cx) < 40
    # Depth along an axis that looks along the floor, a little to the side of the wall's normal.
    forward = (6.0 - 1.1) / camera.rotation[0, 2]
    x = (np.arange(160) - camera.cx) / camera.f
    depth = forward / (1.0 + x * camera.rotation[0, 0] / camera.rotation[0, 2])
    np.testing.assert_allclose(disparity[row, ahead], camera.depth_factor / depth[ahead], rtol=2e-3)
