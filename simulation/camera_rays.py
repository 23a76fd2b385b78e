"""The rays of a rig's cameras: lens models inverted, and the cameras' places in the world."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.rig import CameraModel, RigError, StereoRig


def pixel_rays(camera: CameraModel, image_size: tuple[int, int], samples: int) -> np.ndarray:
    """Directions (H * W, samples^2, 3) float32 with z = 1 in the camera's frame.

    The samples of a pixel stand on a regular grid within it; one sample stands at its centre.
    """
    width, height = image_size
    offset = (np.arange(samples) + 0.5) / samples - 0.5
    v, u, dv, du = np.meshgrid(np.arange(height), np.arange(width), offset, offset, indexing="ij")
    pixels = np.stack([u + du, v + dv], axis=-1).reshape(-1, 2)
    x, y = undistort(camera, pixels).T
    return (
        np.stack([x, y, np.ones_like(x)], axis=-1)
        .astype(np.float32)
        .reshape(width * height, samples * samples, 3)
    )


def undistort(camera: CameraModel, pixels: np.ndarray) -> np.ndarray:
    """Normalised image coordinates (n, 2) of distorted `pixels` (n, 2).

    Raises:
        RigError: the model cannot be inverted there to 0.01 px (coefficients out of bounds).
    """
    flat = pixels.reshape(-1, 1, 2)
    if camera.distortion_model == "fisheye":
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
        points = cv2.fisheye.undistortPoints(flat, camera.K, camera.D, criteria=criteria)
    else:
        points = cv2.undistortPoints(flat, camera.K, camera.D)
    points = points.reshape(-1, 2)
    # OpenCV stops after five rounds; repeat until the point projects to its pixel.
    for _ in range(60):
        error = pixels - distort(camera, points)
        if np.abs(error).max() < 1e-6:
            break
        points = points + error / (camera.fx, camera.fy)
    worst = np.abs(pixels - distort(camera, points)).max()
    if not worst < 0.01:
        raise RigError(
            f"rig: distortion {camera.distortion} cannot be inverted over the whole image "
            f"({worst:.3g} px off): check the coefficients"
        )
    return points


def distort(camera: CameraModel, points: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of normalised image coordinates `points` (n, 2)."""
    if camera.distortion_model == "fisheye":
        flat = points.reshape(-1, 1, 2)
        return cv2.fisheye.distortPoints(flat, camera.K, camera.D).reshape(-1, 2)
    ahead = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    zero = np.zeros(3)
    return cv2.projectPoints(ahead, zero, zero, camera.K, camera.D)[0].reshape(-1, 2)


def camera_poses(rig: StereoRig, poses: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """(rotation (..., 3, 3), position (..., 3)) of the left and the right camera in the world.

    poses: (..., 3) of the robot, x m, y m, theta rad. A rotation carries a direction in the
    camera's frame to the world's; `rig.mount` must be set.
    """
    assert rig.mount is not None
    x, y, theta = np.moveaxis(np.asarray(poses, float), -1, 0)
    c, s, zero, one = np.cos(theta), np.sin(theta), np.zeros_like(theta), np.ones_like(theta)
    turns = [np.stack(row, axis=-1) for row in ((c, -s, zero), (s, c, zero), (zero, zero, one))]
    world_from_robot = np.stack(turns, axis=-2)
    left = world_from_robot @ rig.mount.rotation
    position = world_from_robot @ rig.mount.position + np.stack([x, y, zero], axis=-1)
    right = left @ rig.R.T
    return [(left, position), (right, position - right @ rig.T)]
