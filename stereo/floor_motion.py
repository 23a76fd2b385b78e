"""How a camera moved over the floor between two pairs, from what it sees.

ORB features with stereo depth are carried from the earlier frame into the later image by a
motion in the floor's plane: two matches give a hypothesis (RANSAC, Fischler and Bolles 1981),
the agreeing ones the motion with the least reprojection error in column, row and disparity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from stereo.rectify import RectifiedCamera

FEATURES = 800
LEAST_DISPARITY = 1.5  # farther points say nothing of distance [px]
SIGMA = np.array([0.7, 0.7, 0.5])  # of a feature's column, row and disparity [px]
GATE = 3.0  # px of column and row
HYPOTHESES = 150
LEAST_MATCHES = 15
STEPS = 10
HUBER = 1.5


@dataclass(frozen=True)
class Features:
    """What is remembered of a frame.

    pixels: (n, 3) column, row, disparity [px]; points: (n, 3) [m] in the floor frame of the
    camera: its foot on the floor, x along its view, y left, z up; descriptors: (n, 32) uint8.
    """

    pixels: np.ndarray
    points: np.ndarray
    descriptors: np.ndarray


@dataclass(frozen=True)
class FloorMotion:
    """Pose (x m, y m, theta rad) of the later floor frame in the earlier one, covariance (3, 3)."""

    increment: np.ndarray
    covariance: np.ndarray
    matches: int


def find_features(image: np.ndarray, disparity: np.ndarray, camera: RectifiedCamera) -> Features:
    """Features of a rectified left image uint8 (H, W) where its disparity (H, W) px is known.

    `camera.rotation` must come from a mount without yaw.
    """
    orb = cv2.ORB.create(nfeatures=FEATURES, fastThreshold=7)
    keypoints, descriptors = orb.detectAndCompute(image, np.empty(0))
    pixels = np.array([k.pt for k in keypoints], float).reshape(-1, 2)
    u, v = np.rint(pixels).astype(int).T
    d = disparity[v, u].astype(float)
    known = d > LEAST_DISPARITY
    pixels = np.column_stack([pixels, d])[known]
    found = np.zeros((0, 32), np.uint8) if descriptors is None else descriptors[known]
    return Features(pixels, _points(pixels, camera), found)


def motion_between(
    earlier: Features, later: Features, camera: RectifiedCamera, seed: int = 0
) -> FloorMotion | None:
    """The motion from one frame to the other; None where too few features agree on one."""
    a, b = _matched(earlier.descriptors, later.descriptors)
    if len(a) < LEAST_MATCHES:
        return None
    points, pixels = earlier.points[a], later.pixels[b]
    motions = _hypotheses(points, later.points[b], np.random.default_rng((seed, 1)))
    errors = [_project(_into(m, points), camera)[:, :2] - pixels[:, :2] for m in motions]
    agree = [(abs(e) < GATE).all(axis=1) for e in errors]
    best = int(np.argmax([np.sum(x) for x in agree]))
    if agree[best].sum() < LEAST_MATCHES:
        return None
    return _refine(motions[best], points[agree[best]], pixels[agree[best]], camera)


def _points(pixels: np.ndarray, camera: RectifiedCamera) -> np.ndarray:
    u, v, d = pixels.T
    optical = np.column_stack([u - camera.cx, v - camera.cy, np.full(len(u), camera.f)])
    return (camera.baseline / d)[:, None] * optical @ camera.rotation.T + _eye(camera)


def _project(points: np.ndarray, camera: RectifiedCamera) -> np.ndarray:
    """Column, row, disparity (n, 3) of points in the floor frame; NaN behind the camera."""
    X, Y, Z = ((points - _eye(camera)) @ camera.rotation).T
    Z = np.where(Z > 1e-3, Z, np.nan)
    return np.column_stack(
        [camera.cx + camera.f * X / Z, camera.cy + camera.f * Y / Z, camera.depth_factor / Z]
    )


def _eye(camera: RectifiedCamera) -> np.ndarray:
    return np.array([0.0, 0.0, camera.position[2]])


def _matched(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of features that are each other's nearest."""
    if not len(a) or not len(b):
        return np.zeros(0, int), np.zeros(0, int)
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(a, b)
    pairs = np.array([(m.queryIdx, m.trainIdx) for m in matches], int).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _into(motion: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) of the earlier floor frame as seen from the later one."""
    x, y, theta = motion
    c, s = math.cos(theta), math.sin(theta)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    return np.column_stack([c * dx + s * dy, -s * dx + c * dy, points[:, 2]])


def _hypotheses(earlier: np.ndarray, later: np.ndarray, chance: np.random.Generator) -> np.ndarray:
    """Motions (k, 3) that carry two points each onto their matches."""
    i, j = chance.integers(len(earlier), size=(2, HYPOTHESES))
    a, b = (p[:, 0] + 1j * p[:, 1] for p in (earlier, later))
    turn = np.angle((a[j] - a[i]) * np.conj(b[j] - b[i]))
    shift = 0.5 * (a[i] + a[j]) - np.exp(1j * turn) * 0.5 * (b[i] + b[j])
    return np.column_stack([shift.real, shift.imag, turn])


def _refine(
    motion: np.ndarray, points: np.ndarray, pixels: np.ndarray, camera: RectifiedCamera
) -> FloorMotion:
    """Robust Gauss-Newton on the reprojection errors."""
    J = np.empty((len(points), 3, 3))
    covariance = np.zeros((3, 3))
    for _ in range(STEPS):
        r = (_project(_into(motion, points), camera) - pixels) / SIGMA
        for k, h in enumerate(np.eye(3) * 1e-6):
            ahead, behind = (_project(_into(motion + s * h, points), camera) for s in (1, -1))
            J[:, :, k] = (ahead - behind) / 2e-6 / SIGMA
        size = np.linalg.norm(r, axis=1)
        weight = np.where(size > HUBER, HUBER / np.maximum(size, HUBER), 1.0)
        covariance = np.linalg.inv(np.einsum("n,nij,nik->jk", weight, J, J))
        step = -covariance @ np.einsum("n,nij,ni->j", weight, J, r)
        motion = motion + step
        if abs(step).max() < 1e-6:
            break
    return FloorMotion(motion, covariance, len(points))
