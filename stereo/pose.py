"""Where the robot stands now, from points seen at a key frame and again now; with covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stereo.pose_kernels import (
    MIN_SHRINK,
    hypotheses,
    misfits,
    normal_equations,
    relinearised,
    stepped,
)
from stereo.rectify import RectifiedCamera

TRIPLES = 80
STEPS = 12
SETTLED = 1e-5  # m, rad
LEAST_AGREE = 6
# A point agrees with a hypothesis within so many pixels.
GATE = 3.0
# And with the pose that all who agree give, within so many of their own standard deviations.
OUTLIER = 3.5
# Noise of a followed window, before the residuals tell [px], and how many residuals that is worth.
NOISE = 0.3
NOISE_COUNT = 30.0
CHI2_MEDIAN = 2.366  # of three degrees of freedom
# Errors of points hang together (windows that lie over an edge of depth, rectification), so that
# they count for fewer than there are: measured on rendered drives, where poses erred by 1.4 to
# 1.6 times what independent errors would have done.
TOGETHER = 2.5
# A robot on a floor neither climbs [m] nor tips [rad] more than this on the way from key frame to
# key frame; what the view says counts far more, where there is a view.
CLIMB, TIP = 0.10, math.radians(3.0)


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

    def predict(self, pixels: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Where points are seen from the pose R (3, 3), t (3,) m, and how much larger (n, 4).

        pixels: (n, 3) at the key frame, column and row in the left image and column in the right
        one; so are the first three columns of the result, NaN behind the camera.
        """
        f, cx, cy, baseline = self.lens
        d = pixels[:, 0] - pixels[:, 2]
        rays = np.column_stack([pixels[:, 0] - cx, pixels[:, 1] - cy, np.full(len(d), f)])
        on_robot = baseline * rays @ self.rotation.T + d[:, None] * (self.position - t)
        x, y, z = ((on_robot @ R - d[:, None] * self.position) @ self.rotation).T
        scale = f / np.where(z > MIN_SHRINK * baseline * f, z, np.nan)
        left = cx + x * scale
        return np.column_stack([left, cy + y * scale, left - baseline * d * scale, baseline * scale])


@dataclass(frozen=True)
class Pose:
    """Pose of the robot in its frame at the key frame.

    R (3, 3), t (3,) m. covariance: (3, 3) of x m, y m, theta rad; of_pixels: the part of it that
    comes from the pixels seen now, the rest from those at the key frame. inliers (n,) bool;
    noise: standard deviation of a pixel coordinate.
    """

    R: np.ndarray
    t: np.ndarray
    covariance: np.ndarray
    of_pixels: np.ndarray
    inliers: np.ndarray
    noise: float

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
    view: View,
    guess: tuple[np.ndarray, np.ndarray],
    key: tuple[int, ...],
    head_start: float = 1.0,
) -> Pose | None:
    """The pose on which most points agree, with the least squared residuals.

    Args:
        keys: (n, 3) pixels at the key frame, as of `View.predict`; pixels: (n, 3) now, the right
            column NaN where it was not found; guess: R, t; key: of the random choice of points;
            head_start: how far others must beat the guess (`hypotheses`).

    Returns:
        None when fewer than `LEAST_AGREE` points agree.
    """
    if len(keys) < LEAST_AGREE:
        return None
    camera = (view.rotation, view.position, view.lens)
    prior = np.array([0.0, 0.0, CLIMB**-2, TIP**-2, TIP**-2, 0.0])
    triples = np.random.default_rng(key).integers(len(keys), size=(TRIPLES, 3))
    R, t = hypotheses(
        keys, pixels, triples, *guess, *camera, prior * NOISE**2, GATE**2, head_start
    )
    agree = misfits(keys, keys, pixels, R, t, *camera) < GATE**2
    if agree.sum() < LEAST_AGREE:
        return None
    at, noise, inverse, H2 = keys, NOISE, np.zeros((6, 6)), np.zeros((6, 6))
    for _ in range(STEPS):
        at = relinearised(keys, at, pixels, agree, R, t, *camera)
        squared = misfits(keys, at, pixels, R, t, *camera)
        noise = _noise(squared[agree])
        inliers = squared < (OUTLIER * noise) ** 2
        if inliers.sum() < LEAST_AGREE:
            return None
        # Huber's weights: a residual beyond 1.5 sigma pulls no more than one at 1.5.
        far = np.sqrt(np.minimum(squared, 1e12)) / noise
        weights = np.where(inliers, np.minimum(1.0, 1.5 / np.maximum(far, 1e-9)), 0.0)
        H, b, H2 = normal_equations(keys, at, pixels, weights, R, t, *camera)
        scaled = prior * noise**2
        b += scaled * (0.0, 0.0, t[2], R[2, 1], -R[2, 0], 0.0)
        inverse = np.linalg.inv(H + np.diag(scaled + 1e-12))
        step = -inverse @ b
        R, t = stepped(R, t, step)
        agree = inliers
        if np.abs(step).max() < SETTLED:
            break
    whole = TOGETHER * noise**2 * inverse
    now = whole @ H2 @ inverse
    floor = np.ix_((0, 1, 5), (0, 1, 5))
    return Pose(R, t, whole[floor], now[floor], agree, noise)


def _noise(squared: np.ndarray) -> float:
    """Standard deviation of a pixel coordinate [px], from the squared lengths of residuals.

    Their median is that of chi-square; with few points what is usual counts as well.
    """
    found = float(np.median(squared)) / CHI2_MEDIAN
    n = len(squared)
    return math.sqrt((n * found + NOISE_COUNT * NOISE**2) / (n + NOISE_COUNT))
