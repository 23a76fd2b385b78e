"""Both cameras and the pose between them from corners seen by both (Zhang 2000, OpenCV)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.board import Board
from calibration.errors import CalibrationError
from calibration.rig import CameraModel, StereoRig

# Lens k1, k2, p1, p2: exact in every exchange format, and what a small board can determine.
LENS_FLAGS = cv2.CALIB_FIX_K3
LENS_SIZE = 4
WORST_RMS = 5.0  # px; a wrong board or mixed-up pairs give tens of pixels
SOLVE_UNTIL = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-8)


@dataclass(frozen=True)
class StereoSolution:
    """A rig and how well it explains the corners.

    rms: reprojection error over all corners of both images [px].
    view_rms: (views, 2) the same for each view's left and right image [px].
    """

    rig: StereoRig
    rms: float
    view_rms: np.ndarray


def solve_stereo(
    left: Sequence[np.ndarray],
    right: Sequence[np.ndarray],
    board: Board,
    image_size: tuple[int, int],
) -> StereoSolution:
    """Calibrate a pair of cameras: each alone for a start, then everything jointly.

    Args:
        left, right: per view the corners (columns * rows, 2) in pixels, the same numbering.
        image_size: (width, height) of the images of both cameras.

    Raises:
        CalibrationError: the views do not determine the cameras, the corners fit no pair of
            cameras, or left and right are swapped.
    """
    target = [board.points.astype(np.float32)] * len(left)
    seen_left, seen_right = (_as_opencv(corners) for corners in (left, right))
    try:
        with _one_thread():
            left_start = _solve_camera(target, seen_left, image_size)
            right_start = _solve_camera(target, seen_right, image_size)
            joint = cv2.stereoCalibrateExtended(
                target,
                seen_left,
                seen_right,
                *left_start,
                *right_start,
                image_size,
                np.eye(3),
                np.zeros((3, 1)),
                flags=LENS_FLAGS | cv2.CALIB_USE_INTRINSIC_GUESS,
                criteria=SOLVE_UNTIL,
            )
    except cv2.error:
        raise _undetermined() from None
    _, K1, D1, K2, D2, R, T, _, _, _, _, view_rms = joint
    rig = StereoRig(image_size, _camera(K1, D1), _camera(K2, D2), R, T.ravel())
    # Every view holds the whole board, so the mean over views is the mean over corners.
    rms = float(np.sqrt(np.mean(view_rms**2)))
    _check(rig, rms)
    return StereoSolution(rig, rms, view_rms)


def _solve_camera(target, seen, image_size) -> tuple[np.ndarray, np.ndarray]:
    _, K, D, _, _ = cv2.calibrateCamera(
        target, seen, image_size, np.eye(3), np.zeros(5), flags=LENS_FLAGS, criteria=SOLVE_UNTIL
    )
    return K, D


@contextmanager
def _one_thread() -> Iterator[None]:
    """OpenCV sums over views in the order in which its threads end: one gives the same bytes."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def _as_opencv(corners: Sequence[np.ndarray]) -> list[np.ndarray]:
    return [np.ascontiguousarray(c, np.float32).reshape(-1, 1, 2) for c in corners]


def _camera(K: np.ndarray, D: np.ndarray) -> CameraModel:
    lens = tuple(float(v) for v in D.ravel()[:LENS_SIZE])
    return CameraModel(
        float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), "radtan", lens
    )


def _check(rig: StereoRig, rms: float) -> None:
    numbers = [rms, *rig.left.K.ravel(), *rig.left.D, *rig.right.K.ravel(), *rig.right.D, *rig.T]
    if not np.isfinite(numbers).all() or min(rig.left.fx, rig.right.fx) <= 0:
        raise _undetermined()
    if rms > WORST_RMS:
        raise CalibrationError(
            f"the corners fit no pair of cameras (reprojection error {rms:.1f} px): check the "
            "counts in --board, and that both images of a pair show the same instant"
        )
    if rig.T[0] >= 0:
        raise CalibrationError(
            f"the second camera stands {rig.T[0] * 1e3:.1f} mm to the left of the first: LEFT and "
            "RIGHT are swapped, give them the other way round"
        )


def _undetermined() -> CalibrationError:
    return CalibrationError(
        "the views do not determine the cameras: take more pairs, the board tilted to all sides"
    )
