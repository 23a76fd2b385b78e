"""How well rectification brings the two views of a point onto one row."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.lens import lens_of, rays
from calibration.rig import CameraModel, StereoRig


def row_differences(
    rig: StereoRig, left: np.ndarray, right: np.ndarray, spherical: bool | None = None
) -> np.ndarray:
    """Rectified row in the right image minus that in the left.

    Args:
        left, right: (n, 2) pixels of the same points in the raw images.
        spherical: measure on a sphere of radius f about the cameras instead of on the rectified
            plane: the angle between the rays' epipolar planes times their distance from the
            baseline. The same in the middle of an image, and finite all around; None: for
            fisheye lenses.

    Returns:
        (n,) pixels of the rectified images, whose focal length f is that which
        `cv2.stereoRectify` chooses; on the sphere f is the smaller of the two fy.
    """
    if spherical is None:
        spherical = lens_of(rig.left).wide
    K1, K2, T = rig.left.K, rig.right.K, np.reshape(rig.T, (3, 1))
    D1, D2 = (np.array([_barrel(c), 0.0, 0.0, 0.0]) for c in (rig.left, rig.right))
    _, R2, P1, *_ = cv2.stereoRectify(K1, D1, K2, D2, rig.image_size, rig.R, T)
    R1 = R2 @ rig.R  # OpenCV's own leaves a rotation below 1e-5 rad out
    level_left, level_right = rays(rig.left, left) @ R1.T, rays(rig.right, right) @ R2.T
    if spherical:
        angle = _epipolar_angle(level_right) - _epipolar_angle(level_left)
        angle = (angle + np.pi) % (2 * np.pi) - np.pi
        from_axis = np.hypot(level_left[:, 1], level_left[:, 2])
        from_axis = np.sqrt(from_axis * np.hypot(level_right[:, 1], level_right[:, 2]))
        return min(rig.left.fy, rig.right.fy) * angle * from_axis
    slopes = (v[:, 1] / v[:, 2] for v in (level_left, level_right))
    row_left, row_right = (P1[0, 0] * slope for slope in slopes)
    return row_right - row_left


def _epipolar_angle(level: np.ndarray) -> np.ndarray:
    return np.arctan2(level[:, 1], level[:, 2])


def _barrel(camera: CameraModel) -> float:
    """The lens's first radial term, by which OpenCV chooses the rectified focal length.

    Of a rational lens it is k1 - k4, as its quotient of polynomials expands.
    """
    if camera.distortion_model == "rational":
        return camera.distortion[0] - camera.distortion[5]  # k1, k2, p1, p2, k3, k4, ...
    return 0.0 if lens_of(camera).wide or not camera.distortion else camera.distortion[0]
