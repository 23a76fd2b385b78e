"""A point seen by both cameras: where it is (Hartley and Sturm 1997, the midpoint of two rays)."""

from __future__ import annotations

import numpy as np

from calibration.lens import rays
from calibration.rig import StereoRig


def triangulate(rig: StereoRig, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Points (n, 3) in the left camera's frame [m] from their raw pixels (n, 2) in both images.

    Each is the middle of the shortest line between its two rays.
    """
    a = rays(rig.left, left)
    b = rays(rig.right, right) @ rig.R
    origin = -rig.R.T @ np.ravel(rig.T)
    # Depths s, t along the rays with s a + error = origin + t b: two normal equations a point.
    ab = np.sum(a * b, axis=1)
    ao, bo = a @ origin, b @ origin
    parallel = np.maximum(1.0 - ab**2, 1e-15)
    s = (ao - ab * bo) / parallel
    t = (ab * ao - bo) / parallel
    return 0.5 * (s[:, None] * a + origin + t[:, None] * b)
