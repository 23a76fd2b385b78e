"""A board's pose from one image alone, with a known camera: least squares over its corners."""

from __future__ import annotations

import numpy as np

from calibration.lens import lens_of
from calibration.rig import CameraModel
from calibration.rotation import skew, turn_matrix
from calibration.sighting import Sighting

STEPS = 20
SETTLED = 1e-10  # relative change of the squared error that ends the search
LEAST_ERROR = 1e-18  # px^2: nothing is left to gain
MOST_DAMPING = 1e6


def resect(
    camera: CameraModel, sighting: Sighting, points: np.ndarray, R: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The pose that fits the corners of one image best (Levenberg and Marquardt).

    Args:
        points: (m, 3) of the board [m], by id.
        R, t: (3, 3) and (3,) [m], a pose near it that carries the board to the camera.

    Returns:
        R, t, and the residuals (n, 2) [px], observed less predicted.
    """
    residuals, derivatives = _linearised(camera, sighting, points, R, t)
    damping = 1e-6
    for _ in range(STEPS):
        J = derivatives.reshape(-1, 6)
        normal = J.T @ J
        damped = normal + damping * np.diag(np.diag(normal))
        step = np.linalg.solve(damped, J.T @ residuals.ravel())
        tried_R, tried_t = turn_matrix(step[:3]) @ R, t + step[3:]
        tried, tried_derivatives = _linearised(camera, sighting, points, tried_R, tried_t)
        before, after = float(np.sum(residuals**2)), float(np.sum(tried**2))
        if after >= before:
            if before <= LEAST_ERROR or damping > MOST_DAMPING:
                break
            damping *= 10.0
            continue
        R, t, residuals, derivatives = tried_R, tried_t, tried, tried_derivatives
        damping /= 10.0
        if before - after <= SETTLED * before:
            break
    return R, t, residuals


def misses(
    camera: CameraModel, sighting: Sighting, points: np.ndarray, R: np.ndarray, t: np.ndarray
) -> np.ndarray:
    """Residuals (n, 2) [px], observed less predicted, with the pose given."""
    return _linearised(camera, sighting, points, R, t)[0]


def pose_information(
    camera: CameraModel, sighting: Sighting, points: np.ndarray, R: np.ndarray, t: np.ndarray
) -> np.ndarray:
    """Information (6, 6) that an image holds of a pose, for corners of 1 px: the inverse of the
    covariance of a small turn of the board about its origin [rad] and a shift [m]."""
    J = _linearised(camera, sighting, points, R, t)[1].reshape(-1, 6)
    return J.T @ J


def _linearised(
    camera: CameraModel, sighting: Sighting, points: np.ndarray, R: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (n, 2) and what of the prediction changes (n, 2, 6) with a small turn and shift."""
    lens = lens_of(camera)
    turned = points[sighting.ids] @ R.T
    pixels, _, by_point = lens.project(lens.intrinsics(camera), turned + t)
    # A small turn w of the board moves a point by w x turned.
    return sighting.corners - pixels, np.concatenate([-by_point @ skew(turned), by_point], axis=2)
