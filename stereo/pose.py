"""Where the robot stands now, from points seen at a key frame and again now; with covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stereo.pose_kernels import (
    MIN_SHRINK,
    hypotheses,
    improved,
    misfits,
    normal_equations,
    relinearised,
    stepped,
)
from stereo.rectify import RectifiedCamera

TRIPLES = 80
STEPS = 12
SETTLED = 1e-4  # m, rad
LEAST_AGREE = 6
# A point agrees with a hypothesis within so many pixels.
GATE = 3.0
# And with the pose that all who agree give, within so many of their own standard deviations; beyond
# so many a residual pulls no more than there (Huber's weights).
OUTLIER = 3.5
HUBER = 2.5
# Noise of a pixel coordinate where nothing is known of it [px].
NOISE = 0.3
# How many residuals the prediction of their noise is worth.
NOISE_COUNT = 30.0
CHI2_MEDIAN = (1.386, 2.366)  # of two and of three degrees of freedom
# Errors of points are correlated (windows over edges of depth, interpolation), so that they count
# for fewer than there are: on rendered drives poses err by 1.4 to 1.5 times as much as with
# independent errors of the same size.
TOGETHER = 2.2
# A robot on a floor neither climbs [m] nor tips [rad] more than this on the way from key frame to
# key frame; what the view says counts far more, where there is a view.
CLIMB, TIP = 0.10, math.radians(3.0)


# Before anything is seen: standard deviation of the offset of all disparities that a calibration
# leaves, by the yaw between the cameras or their principal points [px].
OFFSET = 0.25


class Offset(NamedTuple):
    """How much too large all disparities are, and its variance: px, px^2."""

    value: float = 0.0
    variance: float = OFFSET**2


UNKNOWN = Offset()


@dataclass(frozen=True)
class View:
    """The rectified left camera on the robot, as the kernels take it.

    rotation M (3, 3), position p (3,) m; lens (f, cx, cy, baseline) px and m.
    """

    rotation: np.ndarray
    position: np.ndarray
    lens: tuple[float, float, float, float]

    @staticmethod
    def of(camera: RectifiedCamera) -> View:
        """That of a camera."""
        return View(
            np.ascontiguousarray(camera.rotation, float),
            np.ascontiguousarray(camera.position, float),
            (float(camera.f), float(camera.cx), float(camera.cy), float(camera.baseline)),
        )

    def predict(
        self, pixels: np.ndarray, R: np.ndarray, t: np.ndarray, offset: float = 0.0
    ) -> np.ndarray:
        """Where points are seen from the pose R (3, 3), t (3,) m, and how much larger (n, 4).

        offset: of all disparities [px]; pixels: (n, 3) at the key frame, column and row in the
        left image, column in the right one; so are the first three columns of the result, NaN
        behind the camera.
        """
        f, cx, cy, baseline = self.lens
        d = pixels[:, 0] - pixels[:, 2] - offset
        rays = np.column_stack([pixels[:, 0] - cx, pixels[:, 1] - cy, np.full(len(d), f)])
        on_robot = baseline * rays @ self.rotation.T + d[:, None] * (self.position - t)
        x, y, z = ((on_robot @ R - d[:, None] * self.position) @ self.rotation).T
        scale = f / np.where(z > MIN_SHRINK * baseline * f, z, np.nan)
        left = cx + x * scale
        right = left - baseline * d * scale - offset
        return np.column_stack([left, cy + y * scale, right, baseline * scale])


@dataclass(frozen=True)
class Pose:
    """Pose of the robot in its frame at the key frame.

    R (3, 3), t (3,) m. covariance: (3, 3) of x m, y m, theta rad; of_pixels: the part of it that
    comes from the pixels seen now, the rest from those at the key frame and the offset. inliers
    (n,) bool; noise: median standard deviation of a pixel coordinate [px]; offset: as known with
    these points; row_error: of the rectification, root mean square [px].
    """

    R: np.ndarray
    t: np.ndarray
    covariance: np.ndarray
    of_pixels: np.ndarray
    inliers: np.ndarray
    noise: float
    offset: Offset = UNKNOWN
    row_error: float = 0.0

    @property
    def planar(self) -> np.ndarray:
        """(3,) x m, y m, theta rad."""
        return np.array([self.t[0], self.t[1], math.atan2(self.R[1, 0], self.R[0, 0])])

    @staticmethod
    def none(count: int = 0) -> Pose:
        """The key frame's own: no motion, known exactly."""
        zero = np.zeros((3, 3))
        return Pose(np.eye(3), np.zeros(3), zero, zero, np.ones(count, bool), NOISE)


def find_pose(
    keys: np.ndarray,
    pixels: np.ndarray,
    sigma: np.ndarray,
    view: View,
    guess: tuple[np.ndarray, np.ndarray],
    key: tuple[int, ...],
    head_start: float = 1.0,
    offset: Offset = UNKNOWN,
) -> Pose | None:
    """The pose on which most points agree, with the least squared residuals.

    Args:
        keys: (n, 3) pixels at the key frame, as of `View.predict`; pixels: (n, 3) now, the right
            column NaN where it was not found; sigma: (n,) their predicted noise [px], right up to
            a common factor; guess: R, t; key: of the random choice of points; head_start: how far
            others must beat the guess (`hypotheses`); offset: as known before.

    Returns:
        None when fewer than `LEAST_AGREE` points agree.
    """
    if len(keys) < LEAST_AGREE:
        return None
    camera = (view.rotation, view.position, (*view.lens, offset.value))
    prior = np.array([0.0, 0.0, CLIMB**-2, TIP**-2, TIP**-2, 0.0, 1.0 / offset.variance])
    triples = np.random.default_rng(key).integers(len(keys), size=(TRIPLES, 3))
    held = prior[:6] * NOISE**2
    R, t = improved(keys, pixels, *guess, *camera, held, GATE**2)
    R, t = hypotheses(keys, pixels, triples, R, t, *camera, held, GATE**2, head_start)
    agree = misfits(keys, keys, pixels, R, t, *camera) < GATE**2
    if agree.sum() < LEAST_AGREE:
        return None
    at, factor, found = keys, 1.0, offset.value
    inverse, H2 = np.zeros((7, 7)), np.zeros((7, 7))
    usual = np.where(np.isnan(pixels[:, 2]), *CHI2_MEDIAN) * sigma**2
    for _ in range(STEPS):
        at = relinearised(keys, at, pixels, agree, R, t, *camera)
        squared = misfits(keys, at, pixels, R, t, *camera)
        factor = _noise(squared[agree] / usual[agree])
        far = np.sqrt(np.minimum(squared, 1e12)) / (factor * sigma)
        inliers = far < OUTLIER
        if inliers.sum() < LEAST_AGREE:
            return None
        weights = np.where(inliers, np.minimum(1.0, HUBER / np.maximum(far, 1e-9)), 0.0)
        H, b, H2 = normal_equations(keys, at, pixels, sigma, weights, R, t, *camera)
        scaled = prior * TOGETHER * factor**2
        b += scaled * (0.0, 0.0, t[2], R[2, 1], -R[2, 0], 0.0, found - offset.value)
        inverse = np.linalg.inv(H + np.diag(scaled + 1e-12))
        step = -inverse @ b
        R, t = stepped(R, t, step[:6])
        found += step[6]
        camera = (view.rotation, view.position, (*view.lens, found))
        agree = inliers
        if np.abs(step).max() < SETTLED:
            break
    whole = TOGETHER * factor**2 * inverse
    now = whole @ H2 @ inverse
    floor = np.ix_((0, 1, 5), (0, 1, 5))
    noise = factor * float(np.median(sigma[agree]))
    return Pose(R, t, whole[floor], now[floor], agree, noise, Offset(found, whole[6, 6]))


def _noise(squared: np.ndarray) -> float:
    """By what the noise is larger than predicted, from squared residuals over their usual size.

    Their median is that of chi-square; with few points the prediction counts as well.
    """
    n = len(squared)
    return math.sqrt((n * float(np.median(squared)) + NOISE_COUNT) / (n + NOISE_COUNT))
