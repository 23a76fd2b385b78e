"""Pairs as visual odometry sees them, and key frames whose points are found again in them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stereo.features import find_corners
from stereo.patch_kernels import follow, remember, search_rows

LEVELS = 4  # each half as large as the one before
SMALLEST = 40  # px: a smaller image tells nothing
REACH = 0.25  # disparities searched, as a share of the width
# px: below zero only by noise. A limit above it would keep, of far points, those that noise brings
# nearer, and make every motion longer than it is.
MIN_DISPARITY = -1.5
ROWS = 1.5  # px that the same point may differ in row
ALIKE = 0.8  # correlation of a window that is found again
COARSE = 0.5  # and at the coarser levels
NEAR = 1  # the coarsest level needed when the guess is good to some pixels
# A window's noise, and so that of its place, follows from how much it differs from the remembered
# one. Neighbouring pixels share it: they are smoothed by (1 2 1) / 4 in both directions, so that
# (8/3)^2 of them count for one. Interpolation errs by so much besides [px].
SMOOTHED = 64.0 / 9.0
INTERPOLATED = 0.08
ENOUGH = 0.6  # of the points expected in view found: the guess was good
DESCRIBED = 2  # the level whose windows tell points apart


@dataclass(frozen=True)
class Pyramids:
    """Both rectified images uint8, (H, W) and each level half as large."""

    left: tuple[np.ndarray, ...]
    right: tuple[np.ndarray, ...]

    @staticmethod
    def of(left: np.ndarray, right: np.ndarray) -> Pyramids:
        """Those of a rectified pair."""
        return Pyramids(_pyramid(left), _pyramid(right))


def _pyramid(image: np.ndarray) -> tuple[np.ndarray, ...]:
    # Interpolation between pixels shifts what is finer than they are: that is smoothed away.
    levels = [cv2.GaussianBlur(image, (3, 3), 0)]
    while len(levels) < LEVELS and min(levels[-1].shape) >= 2 * SMALLEST:
        levels.append(cv2.pyrDown(levels[-1]))
    return tuple(levels)


class KeyFrame:
    """What a pair shows, remembered: points in space and how each looks.

    pixels: (n, 3) column and row in the left image, column in the right one; row_errors: (n,)
    how much lower they are in the right one [px]; pyramids: the pair itself.
    """

    def __init__(self, pyramids: Pyramids) -> None:
        self.pyramids = pyramids
        corners = find_corners(pyramids.left[0])
        # Of each level: windows, gradients, inverses, usable.
        self._windows: list[tuple[np.ndarray, ...]] = [
            remember(image, corners / 2.0**k) for k, image in enumerate(pyramids.left)
        ]
        right, found = self._in_right_image(pyramids, corners)
        self.row_errors = (right[:, 1] - corners[:, 1])[found]
        self._windows = [tuple(part[found] for part in level) for level in self._windows]
        self.pixels = np.column_stack([corners, right[:, 0]])[found].astype(float)

    def __len__(self) -> int:
        return len(self.pixels)

    def alike(self, other: KeyFrame) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of points here and there that look most alike, each of the other's all.

        Whole neighbourhoods are compared, wherever they stand: for pairs so different that
        nothing is expected anywhere.
        """
        if not len(self) or not len(other):
            return np.zeros(0, int), np.zeros(0, int)
        level = min(DESCRIBED, len(self._windows) - 1, len(other._windows) - 1)
        (a, *_, known), (b, *_, known_too) = self._windows[level], other._windows[level]
        likeness = a @ b.T / a.shape[1]
        likeness[~known] = likeness[:, ~known_too] = -1.0
        there, back = likeness.argmax(axis=1), likeness.argmax(axis=0)
        i = np.arange(len(a))
        same = (back[there] == i) & (likeness[i, there] > ALIKE)
        return i[same], there[same]

    def find(
        self, pyramids: Pyramids, guess: np.ndarray, nearer: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The key frame's points in another pair.

        guess: (n, 3) px; NaN where nothing is expected; nearer: (n,) how much larger it appears.

        Returns:
            pixels (n, 3), the right column NaN where it is not found; sigma (n,) of a coordinate
            [px]; found (n,) bool.
        """
        expected = np.isfinite(guess.sum(axis=1))
        height, width = pyramids.left[0].shape
        with np.errstate(invalid="ignore"):
            seen = expected & (guess[:, :2] >= 0.0).all(axis=1)
            seen &= (guess[:, 0] < width) & (guess[:, 1] < height)
        # Most guesses are good: only where they are not is looked for farther away.
        for coarsest in (NEAR, LEVELS - 1):
            place = np.where(expected[:, None], guess[:, :2], -1e6)
            likeness = self._place(pyramids.left, place, nearer, coarsest)
            found = likeness > ALIKE
            if found.sum() > ENOUGH * seen.sum():
                break
        right = place.copy()
        right[:, 0] -= np.where(expected, guess[:, 0] - guess[:, 2], 0.0)
        right[~found] = -1e6
        in_right = self._place(pyramids.right, right, nearer, 0)
        good = in_right > ALIKE
        good &= (np.abs(right[:, 1] - place[:, 1]) < ROWS) & (
            place[:, 0] - right[:, 0] > MIN_DISPARITY
        )
        column = np.where(good, right[:, 0], np.nan)
        likeness = np.where(good, 0.5 * (likeness + in_right), likeness)
        return np.column_stack([place, column]), self._sigma(likeness), found

    def _sigma(self, likeness: np.ndarray) -> np.ndarray:
        """Standard deviation (n,) of a coordinate [px] of places found with a likeness (n,).

        Lucas and Kanade's method is least squares: the covariance of a place is the inverse of the
        gradients' products times the noise. Windows of contrast 1 that correlate by `likeness`
        differ by 2 (1 - likeness), half of it from either image.
        """
        inverses = self._windows[0][2]
        mean = 0.5 * (inverses[:, 0, 0] + inverses[:, 1, 1]).astype(float)
        noise = SMOOTHED * np.clip(1.0 - likeness, 0.0, 1.0)
        return np.sqrt(INTERPOLATED**2 + noise * mean)

    def _place(
        self,
        images: tuple[np.ndarray, ...],
        place: np.ndarray,
        nearer: np.ndarray,
        coarsest: int,
    ) -> np.ndarray:
        """Refine places (n, 2) px from the coarsest level to the finest; their likeness (n,)."""
        likeness = np.full(len(place), -1.0)
        for level in range(min(coarsest, len(images) - 1), -1, -1):
            scaled = place / 2.0**level
            windows, gradients, inverses, usable = self._windows[level]
            likeness = follow(images[level], windows, gradients, inverses, usable, nearer, scaled)
            moved = likeness > (COARSE if level else ALIKE)
            place[moved] = scaled[moved] * 2.0**level
        return likeness

    def _in_right_image(
        self, pyramids: Pyramids, corners: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Places (n, 2) of the corners in the right image, and which were found (n,) bool."""
        level = 1 if len(pyramids.left) > 1 else 0
        reach = int(REACH * pyramids.left[level].shape[1])
        disparity = search_rows(
            pyramids.left[level], pyramids.right[level], corners / 2.0**level, reach
        )
        place = corners.astype(float)
        place[:, 0] -= disparity * 2.0**level
        place[disparity < 0] = -1e6
        likeness = self._place(pyramids.right, place, np.ones(len(place)), level)
        found = (likeness > ALIKE) & (np.abs(place[:, 1] - corners[:, 1]) < ROWS)
        found &= corners[:, 0] - place[:, 0] > MIN_DISPARITY
        return place, found
