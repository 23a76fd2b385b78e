"""Whether a calibration still fits: a point must lie on the same row of both rectified images.

ORB features are matched across a band of rows (each other's nearest), then placed to a few
hundredths of a pixel by Lucas and Kanade's method in both axes. What the row differences have in
common tells how the right camera has turned since it was calibrated; the rest is noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from stereo.errors import StereoError
from stereo.rectify import RectifiedCamera

FEATURES = 1500
FAST_THRESHOLD = 10
ROWS = 0.05  # rows searched up and down, as a share of the height; at least LEAST_ROWS px
LEAST_ROWS = 10.0
REACH = 0.4  # disparities searched, as a share of the width
BEHIND = 0.05  # and on the far side of infinity, where a camera that has turned puts things
MOST_DISTANCE = 64  # of two descriptors that match, of 256 bits
WINDOW = 15  # of Lucas and Kanade [px]
RETURNS = 0.1  # tracked back, a point comes this near to where it began [px]
MOST_DIFFERENCE = 12.0  # mean grey levels between matched windows
LEAST_CORNER = 1e-3  # smallest eigenvalue of a window's gradients, as OpenCV scales it
LEAST_MATCHES = 60
CORE = 3.0  # robust sigmas; rows that differ more are false matches
LEAST_CORE = 0.3  # px
ROUNDS = 5
LEAST_PAIRS = 8  # for an uncertainty from pair to pair


@dataclass(frozen=True)
class RowMatches:
    """Matched points of one or many pairs: left (n, 2) px, right (n, 2) px, rectified."""

    left: np.ndarray
    right: np.ndarray

    @property
    def differences(self) -> np.ndarray:
        """Row in the right image minus row in the left one (n,) [px]."""
        return self.right[:, 1] - self.left[:, 1]


@dataclass(frozen=True)
class RowCheck:
    """What the row differences of many pairs say.

    rms: of the differences that are no false matches [px]; bias: their median [px];
    systematic: RMS of what they have in common, the part that calibrating again takes away [px];
    noise: RMS of the rest [px];
    turned: (3,) pitch, yaw, roll of the right camera [rad] that explain the common part, as a
    mount counts them: nose down, to the left, clockwise seen from behind; turned_sigma: (3,).
    Rows see yaw poorly, though depth suffers from it most: mind its sigma;
    stretched: rows per row, what another focal length does;
    matches: used; false_matches: left out;
    scatter: standard deviation of the pairs' own biases beyond their noise, as of cameras that
    do not expose at once [px].
    """

    rms: float
    bias: float
    systematic: float
    noise: float
    turned: np.ndarray
    turned_sigma: np.ndarray
    stretched: float
    matches: int
    false_matches: int
    scatter: float


def match_points(left: np.ndarray, right: np.ndarray) -> RowMatches:
    """The same points in both rectified images, uint8 (H, W), to a fraction of a pixel."""
    orb = cv2.ORB.create(nfeatures=FEATURES, fastThreshold=FAST_THRESHOLD)
    (a, words_a), (b, words_b) = (_features(orb, image) for image in (left, right))
    if not len(a) or not len(b):
        return RowMatches(np.zeros((0, 2)), np.zeros((0, 2)))
    i, j = _mutual(a, words_a, b, words_b, left.shape)
    return _refined(left, right, a[i], b[j])


def check_rows(matches: Sequence[RowMatches], camera: RectifiedCamera) -> RowCheck:
    """Judge the matches of one or more pairs of the same rig.

    Raises:
        StereoError: fewer than 60 points match.
    """
    left, right = (
        np.concatenate([getattr(m, side) for m in matches]) for side in ("left", "right")
    )
    if len(left) < LEAST_MATCHES:
        raise StereoError(
            f"only {len(left)} points match between the left and right images: use more pairs of "
            "a scene with texture, and the rig of these very cameras, left and right in order"
        )
    d = right[:, 1] - left[:, 1]
    design = _design(right, camera)
    core, fitted, parameters = _robust_fit(design, d)
    noise = d[core] - fitted[core]
    pair = np.repeat(np.arange(len(matches)), [len(m.left) for m in matches])[core]
    return RowCheck(
        rms=_rms(d[core]),
        bias=float(np.median(d[core])),
        systematic=_rms(fitted[core]),
        noise=_rms(noise),
        turned=parameters[:3],
        turned_sigma=_sigma(design[core], noise, pair)[:3],
        stretched=float(parameters[3]),
        matches=int(core.sum()),
        false_matches=int(len(d) - core.sum()),
        scatter=_scatter(noise, pair),
    )


def _features(orb: cv2.ORB, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 2) float32 and descriptors (n, 4) uint64."""
    keypoints, descriptors = orb.detectAndCompute(image, np.empty(0))
    if descriptors is None:
        return np.zeros((0, 2), np.float32), np.zeros((0, 4), np.uint64)
    points = np.array([k.pt for k in keypoints], np.float32)
    return points, np.ascontiguousarray(descriptors).view(np.uint64)


def _mutual(
    a: np.ndarray,
    words_a: np.ndarray,
    b: np.ndarray,
    words_b: np.ndarray,
    shape: tuple[int, ...],
) -> tuple[np.ndarray, np.ndarray]:
    """Indices of features that are each other's nearest among those that can be the same point."""
    distance = np.zeros((len(a), len(b)), np.uint16)
    for word in range(words_a.shape[1]):
        distance += np.bitwise_count(words_a[:, None, word] ^ words_b[None, :, word])
    disparity = a[:, None, 0] - b[None, :, 0]
    rows = abs(a[:, None, 1] - b[None, :, 1])
    height, width = shape
    possible = (disparity > -BEHIND * width) & (disparity < REACH * width)
    possible &= rows < max(LEAST_ROWS, ROWS * height)
    distance[~possible] = 1000
    there, back = distance.argmin(axis=1), distance.argmin(axis=0)
    i = np.arange(len(a))
    same = (back[there] == i) & (distance[i, there] <= MOST_DISTANCE)
    return i[same], there[same]


def _refined(left: np.ndarray, right: np.ndarray, a: np.ndarray, b: np.ndarray) -> RowMatches:
    """The right points placed by their windows; those dropped that do not come back."""
    if not len(a):
        return RowMatches(np.zeros((0, 2)), np.zeros((0, 2)))
    there, found, error = _track(left, right, a, b)
    back, returned, _ = _track(right, left, there, a)
    good = found & returned & (error < MOST_DIFFERENCE)
    good &= np.linalg.norm(back - a, axis=1) < RETURNS
    # A step of several pixels has left the feature for another one.
    good &= np.linalg.norm(there - b, axis=1) < WINDOW / 2
    return RowMatches(a[good].astype(float), there[good].astype(float))


def _track(
    first: np.ndarray, second: np.ndarray, points: np.ndarray, guess: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    moved, status, error = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        points.reshape(-1, 1, 2),
        guess.reshape(-1, 1, 2).copy(),
        winSize=(WINDOW, WINDOW),
        maxLevel=0,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 1e-3),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        minEigThreshold=LEAST_CORNER,
    )
    return moved.reshape(-1, 2), status.ravel() == 1, error.ravel()


def _design(right: np.ndarray, camera: RectifiedCamera) -> np.ndarray:
    """Row differences (n, 4) per rotation of the right camera [px/rad] and per stretch.

    Pitch w_x, yaw w_y and roll -w_z of the camera move the ray X = (x, y, 1) by w x X, its row
    by f (-w_x (1 + y^2) + w_y x y + w_z x).
    """
    x, y = (right[:, 0] - camera.cx) / camera.f, (right[:, 1] - camera.cy) / camera.f
    return camera.f * np.column_stack([-(1.0 + y * y), x * y, -x, y])


def _robust_fit(design: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mask (n,) of true matches, fitted differences (n,), parameters (4,)."""
    fitted = np.full(len(d), np.median(d))
    core = np.ones(len(d), bool)
    parameters = np.zeros(design.shape[1])
    for _ in range(ROUNDS):
        off = abs(d - fitted)
        core = off < max(CORE * 1.4826 * float(np.median(off)), LEAST_CORE)
        parameters = np.linalg.lstsq(design[core], d[core], rcond=None)[0]
        fitted = design @ parameters
    return core, fitted, parameters


def _sigma(design: np.ndarray, noise: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """Standard deviations (4,) of the fit.

    Errors of one pair hang together, so with enough pairs each counts as one observation
    (cluster-robust covariance, Liang and Zeger 1986).
    """
    bread = np.linalg.inv(design.T @ design)
    pairs = np.unique(pair)
    if len(pairs) < LEAST_PAIRS:
        return np.sqrt(np.diag(bread) * np.mean(noise**2))
    pulls = np.array([design[pair == n].T @ noise[pair == n] for n in pairs])
    meat = len(pairs) / (len(pairs) - 1) * pulls.T @ pulls
    return np.sqrt(np.diag(bread @ meat @ bread))


def _rms(values: np.ndarray) -> float:
    return math.sqrt(float(np.mean(values**2)))


def _scatter(noise: np.ndarray, pair: np.ndarray) -> float:
    """How far the pairs' own biases spread beyond what their matches' noise explains [px]."""
    numbers, counts = np.unique(pair, return_counts=True)
    many = numbers[counts >= 10]
    if len(many) < 2:
        return 0.0
    biases = np.array([np.mean(noise[pair == n]) for n in many])
    expected = np.mean([np.var(noise[pair == n]) / np.sum(pair == n) for n in many])
    return math.sqrt(max(float(np.var(biases, ddof=1) - expected), 0.0))
