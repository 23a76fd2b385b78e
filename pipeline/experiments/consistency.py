"""Is the filter as sure as it may be? NEES of its poses against the truth.

At a step of the filter the particles' poses, with their weights, have a mean and a covariance P;
e is the true pose less the mean, both in the frame of the first pose. The normalised estimation
error squared is e' P^-1 e: chi-square with 3 degrees of freedom for a filter whose spread tells
the truth (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, Sec. 5.4). Well above: over-confident. Well below: unduly modest.
"""

from __future__ import annotations

import math

import numpy as np

from odometry.motion import wrap_angle

DEGREES_OF_FREEDOM = 3
BAND = 0.95
# Errors are compared in these units [m, m, rad]; below SINGULAR of them the particles agree.
UNITS = np.array([0.01, 0.01, math.radians(0.1)])
SINGULAR = 1e-6


def nees(poses: np.ndarray, log_weights: np.ndarray, true: np.ndarray) -> float:
    """NEES of weighted poses (N, 3), given the log-weights (N,), to the true pose (3,).

    Where all particles agree in some direction (one ancestor's copies) the filter claims to know
    it exactly: inf, unless the truth agrees as well.
    """
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    # Angles are taken relative to one of them: the spread is far below half a turn.
    off = poses - poses[0]
    off[:, 2] = wrap_angle(off[:, 2])
    mean = weights @ off
    error = true - poses[0] - mean
    error[2] = wrap_angle(error[2])
    spread = (off - mean) / UNITS
    variances, axes = np.linalg.eigh((weights[:, None] * spread).T @ spread)
    along = axes.T @ (error / UNITS)
    known = variances < SINGULAR**2
    if np.any(np.abs(along[known]) > SINGULAR):
        return math.inf
    return float(np.sum(along[~known] ** 2 / variances[~known]))


def band(runs: int, factor: float = 1.0) -> tuple[float, float]:
    """Bounds of the mean NEES of independent runs: the two-sided 95 % band of chi2(3 runs) / runs,
    widened by `factor` on either side."""
    from scipy.stats import chi2

    tail = 0.5 * (1.0 - BAND)
    low, high = (chi2.ppf(p, DEGREES_OF_FREEDOM * runs) / runs for p in (tail, 1.0 - tail))
    return float(low / factor), float(high * factor)


def share_inside(values: np.ndarray, bounds: tuple[float, float]) -> float:
    """Share of the values, inf among them, that lie within the bounds."""
    return float(np.mean((values >= bounds[0]) & (values <= bounds[1])))
