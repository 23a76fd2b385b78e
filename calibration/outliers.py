"""Corners that do not fit: found by their share of a robust noise, never by hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.bundle import Geometry, Observations, adjust
from calibration.lens import Lens

# A corner whose residual is longer than this many sigmas of the noise is wrong: by chance alone
# it is one in 25,000.
REJECT_SIGMAS = 4.5
# However good the others are: images differ in noise, and a corner this close is not wrong.
LEAST_WRONG = 0.3  # px
MOST_REJECTED = 0.02
# An image with more wrong corners than this is wrong as a whole, ...
WRONG_IMAGE = 0.25
# ... unless so many views are that the cameras rather than the images are to blame.
MOST_WRONG_VIEWS = 1 / 3
FEWEST_VIEWS = 3
FEWEST_CORNERS = 4
# Cauchy's weights leave 95 % of the efficiency of least squares (for one coordinate).
CAUCHY = 2.385
ROBUST_ROUNDS = 8
# Median length of a 2-vector whose coordinates have a standard deviation of 1.
RAYLEIGH_MEDIAN = np.sqrt(2 * np.log(2))
LEAST_NOISE = 1e-6  # px
# Views left out keep a faint weight, which places their board and does not move the cameras.
FAINT = 1e-9


@dataclass(frozen=True, eq=False)
class Selection:
    """Which corners count.

    kept: (s, v, m) bool, all False in an outlier view; outlier_views: (v,) bool;
    capped: more corners fail the test than may be rejected.
    """

    kept: np.ndarray
    outlier_views: np.ndarray
    capped: bool

    def same(self, other: Selection) -> bool:
        """The very same corners count."""
        return np.array_equal(self.kept, other.kept)


def noise_scale(residuals: np.ndarray, seen: np.ndarray) -> float:
    """Standard deviation of a coordinate [px] by the median length of residuals (s, v, m, 2)."""
    lengths = np.linalg.norm(residuals[seen], axis=-1)
    return max(float(np.median(lengths) / RAYLEIGH_MEDIAN), LEAST_NOISE)


def robust_adjust(
    lens: Lens, seen: Observations, geometry: Geometry, rounds: int = ROBUST_ROUNDS
) -> tuple[Geometry, np.ndarray]:
    """`adjust` with Cauchy's weights, whose scale follows the residuals."""
    residuals, scale = None, np.inf
    for _ in range(rounds):
        weights = seen.seen.astype(float)
        if residuals is not None:
            weights *= cauchy_weights(residuals, scale)
        geometry, residuals = adjust(lens, seen, geometry, weights, rounds=6)
        before, scale = scale, noise_scale(residuals, seen.seen)
        if abs(before - scale) < 0.01 * scale:
            break
    assert residuals is not None
    return geometry, residuals


def cauchy_weights(residuals: np.ndarray, scale: float) -> np.ndarray:
    """(s, v, m) for residuals (s, v, m, 2) [px]."""
    return 1.0 / (1.0 + np.sum(residuals**2, axis=-1) / (CAUCHY * scale) ** 2)


def select(residuals: np.ndarray, seen: np.ndarray) -> Selection:
    """Which corners to solve from, judged by the residuals (s, v, m, 2) of them all."""
    lengths = np.where(seen, np.linalg.norm(residuals, axis=-1), 0.0)
    limit = max(REJECT_SIGMAS * noise_scale(residuals, seen), LEAST_WRONG)
    wrong = lengths > limit
    outlier_views = _outlier_views(wrong, seen)
    countable = seen & ~outlier_views[None, :, None]
    wrong &= countable
    most = int(MOST_REJECTED * np.count_nonzero(countable))
    capped = np.count_nonzero(wrong) > most
    if capped:
        # The worst ones; of equals, those that come first.
        worst = np.argsort(-np.where(wrong, lengths, 0.0), axis=None, kind="stable")[:most]
        wrong = np.zeros_like(wrong)
        wrong.flat[worst] = True
    return Selection(countable & ~wrong, outlier_views, bool(capped))


def _outlier_views(wrong: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(v,) bool: views of which an image is wrong as a whole."""
    bad, corners = wrong.sum(axis=2), seen.sum(axis=2)
    outlier = ((bad > WRONG_IMAGE * corners) | (corners - bad < FEWEST_CORNERS)).any(axis=0)
    most = min(int(MOST_WRONG_VIEWS * len(outlier)), len(outlier) - FEWEST_VIEWS)
    return outlier if outlier.sum() <= most else np.zeros(len(outlier), bool)


def weights_of(selection: Selection, residuals: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(s, v, m) for `adjust`: 1 for the corners that count."""
    weights = selection.kept.astype(float)
    faint = seen & selection.outlier_views[None, :, None]
    if faint.any():
        scale = noise_scale(residuals, seen)
        weights[faint] = FAINT * cauchy_weights(residuals, scale)[faint]
    return weights
