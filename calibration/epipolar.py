"""How well rectification brings the two views of a point onto one row."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.rig import StereoRig


def row_differences(rig: StereoRig, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Rectified row in the right image minus that in the left.

    Args:
        rig: with `radtan` or `rational` lenses, or none.
        left, right: (n, 2) pixels of the same points in the raw images.

    Returns:
        (n,) pixels of the rectified images.
    """
    K1, D1, K2, D2 = rig.left.K, rig.left.D, rig.right.K, rig.right.D
    T = np.reshape(rig.T, (3, 1))
    R1, R2, P1, P2, *_ = cv2.stereoRectify(K1, D1, K2, D2, rig.image_size, rig.R, T)

    def rows(points: np.ndarray, K, D, R, P) -> np.ndarray:
        raw = np.asarray(points, float).reshape(-1, 1, 2)
        return cv2.undistortPoints(raw, K, D, R=R, P=P).reshape(-1, 2)[:, 1]

    return rows(right, K2, D2, R2, P2) - rows(left, K1, D1, R1, P1)
