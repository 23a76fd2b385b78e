"""The observation-improved proposal (Grisetti, Stachniss and Burgard 2007).

Where the sensor tells more of the pose than odometry does, particles drawn from odometry are
wasted. Each particle's predicted pose is first matched to its own map; it is then drawn from a
Gaussian about the best place, whose information is that of odometry and of the hits:

    p(x_t | m, x_{t-1}, z_t, u_t)  ~  N(x*, (Sigma_u^-1 + H)^-1)

with x* the maximum of the posterior and H the curvature of the hits' score there. Its weight stays
that of eq (8), at the drawn pose: on real logs agreement of the whole view, free space included,
tells good maps from bad ones far better than the integral of that posterior does.
"""

from __future__ import annotations

import math

import numpy as np

from mapping.proposal_kernels import refine
from mapping.tiles import TileMaps
from odometry.motion import Motion, compose

# A hit on a sure obstacle is worth ln(1 + GAIN) of a hit on nothing.
GAIN = 20.0
# The motion comes from matched scans already: they must not count twice in full.
REUSED = 3.0
# First steps of the search along x and y [cells] and theta [rad]; halved down to LAST_STEP.
FIRST_STEP = (2.0, 2.0, math.radians(2.0))
LAST_STEP = 0.03
# Widths of the differences that measure curvature, in cells and rad.
CURVATURE_WIDTH = (0.5, 0.5, math.radians(0.5))
# With fewer hits odometry alone leads.
MIN_HITS = 15
# Keeps the information of odometry finite in directions it claims to know exactly [m, m, rad].
LEAST_DOUBT = np.array([1e-4, 1e-4, 2e-5])


def propose(
    maps: TileMaps,
    predicted: np.ndarray,
    motion: Motion,
    points: np.ndarray,
    kappa: float,
    cell: float,
    noise: np.ndarray,
) -> np.ndarray:
    """Draw poses about the best match of the hits to each particle's map.

    Args:
        predicted: (N, 3) poses by odometry alone; motion: the step that led there.
        points: (n, 2) hits in the robot's frame [m]; kappa: the share of an independent
            measurement that each of them is; cell [m]; noise: (N, 3) standard normal draws.

    Returns the poses (N, 3). Odometry that claims to be exact is believed.
    """
    if not motion.covariance.any():
        return predicted
    turn = _turned_back(motion.increment[2])
    odometry = REUSED * turn @ motion.covariance @ turn.T + np.diag(LEAST_DOUBT**2)
    if len(points) < MIN_HITS:
        return compose(predicted, noise @ np.linalg.cholesky(odometry).T)
    scale = np.array([cell, cell, 1.0])
    moves, gained = refine(
        maps.tiles,
        maps.table,
        maps.corner,
        predicted,
        cell,
        points,
        GAIN,
        kappa,
        np.linalg.inv(odometry),
        FIRST_STEP * scale,
        LAST_STEP,
        CURVATURE_WIDTH * scale,
    )
    covariance = np.linalg.inv(np.linalg.inv(odometry) + _positive(gained))
    root = np.linalg.cholesky(covariance)
    return compose(predicted, moves + (root @ noise[:, :, None])[..., 0])


def _positive(gained: np.ndarray) -> np.ndarray:
    """Information (N, 3, 3) without the directions in which the score curves the wrong way."""
    values, vectors = np.linalg.eigh(gained)
    return (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2)


def _turned_back(angle: float) -> np.ndarray:
    """Turns a covariance of the earlier robot frame into the frame after a turn by `angle`."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
