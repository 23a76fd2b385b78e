"""The rectification that ROS and OpenCV store beside a calibration (Bouguet's, as both use it)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.rig import RigError, StereoRig


@dataclass(frozen=True)
class Rectification:
    """R1, R2 (3, 3): raw to rectified axes; P1, P2 (3, 4): projections [px, px m]; Q (4, 4):
    (u, v, disparity, 1) to homogeneous points."""

    R1: np.ndarray
    R2: np.ndarray
    P1: np.ndarray
    P2: np.ndarray
    Q: np.ndarray


def rectification(rig: StereoRig) -> Rectification:
    """Both cameras turned by half of R, both principal points alike, only valid pixels in view.

    A rig of images that are rectified already keeps them as they are.

    Raises:
        RigError: one lens is a fisheye and the other is none.
    """
    if rig.rectified and np.array_equal(rig.R, np.eye(3)) and not rig.T[1:].any():
        return _as_they_are(rig)
    if len({c.distortion_model == "fisheye" for c in (rig.left, rig.right)}) == 2:
        raise RigError(
            "a fisheye beside another lens cannot be rectified here: calibrate both cameras with "
            "the same lens model"
        )
    import cv2

    cameras = (rig.left.K, rig.left.D, rig.right.K, rig.right.D, rig.image_size)
    T = np.reshape(rig.T, (3, 1))
    flags = cv2.CALIB_ZERO_DISPARITY  # the fisheye module's flag of that name is the same number
    if rig.left.distortion_model == "fisheye":
        found = cv2.fisheye.stereoRectify(*cameras, rig.R, T, flags)
    else:
        found = cv2.stereoRectify(*cameras, rig.R, T, flags=flags, alpha=0)[:5]
    _, R2, P1, P2, Q = (np.asarray(m) for m in found)
    # OpenCV takes a rotation below 1e-5 rad for none. R2 still levels T, and R1 = R2 R holds
    # whatever the rotation: R2^T R1, which is all that these formats keep of R, is exact.
    return Rectification(R2 @ rig.R, R2, P1, P2, Q)


def _as_they_are(rig: StereoRig) -> Rectification:
    left, right, x = rig.left, rig.right, float(rig.T[0])
    P1 = np.column_stack([left.K, np.zeros(3)])
    P2 = np.column_stack([right.K, right.K @ rig.T])
    Q = np.array(
        [
            [1.0, 0.0, 0.0, -left.cx],
            [0.0, 1.0, 0.0, -left.cy],
            [0.0, 0.0, 0.0, left.fx],
            [0.0, 0.0, -1.0 / x, (left.cx - right.cx) / x],
        ]
    )
    return Rectification(np.eye(3), np.eye(3), P1, P2, Q)
