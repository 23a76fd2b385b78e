"""Motion between the poses of an odometry that somebody else kept, as a random walk.

Scan logs hold the robot's dead reckoning instead of its ticks. Each step is doubted as the
encoders' arcs are (`differential_drive`): along, across and in heading, growing with the travel
and the turn.
"""

from __future__ import annotations

import numpy as np

from odometry.differential_drive import error_at_the_end, step_variances
from odometry.motion import Motion, compose, inverse
from odometry.settings import OdometrySettings

# A robot at rest counts as travelling [m] and turning [rad] this much a step: its doubt is tiny,
# and only settings of zero make odometry exact.
LEAST = 1e-6

# No robot moves so far between two scans [m]: its odometry was reset, or a digit is wrong. What
# it did meanwhile is not known [m, m, rad].
LEAP = 20.0
AFTER_LEAP = np.array([0.3, 0.3, np.radians(10.0)])


def walk(stamps: np.ndarray, poses: np.ndarray, settings: OdometrySettings) -> list[Motion]:
    """The n motions that lead to each of the poses; the first is none.

    Where odometry leaps the robot is taken as standing still, with much doubt.

    Args:
        stamps: (n,) int64 ns, in the order of the poses; they need not increase.
        poses: (n, 3) x m, y m, theta rad by odometry.
    """
    poses = np.asarray(poses, float)
    if not len(poses):
        return []
    increments = compose(inverse(poses[:-1]), poses[1:])
    covariances = step_covariances(increments, settings)
    leaped = leaps(poses)
    increments[leaped], covariances[leaped] = 0.0, np.diag(AFTER_LEAP**2)
    times = np.asarray(stamps).tolist()
    steps = zip(increments, covariances, times[:-1], times[1:], strict=True)
    return [Motion.none(times[0]), *(Motion(*step) for step in steps)]


def leaps(poses: np.ndarray) -> np.ndarray:
    """Which of the n - 1 steps between poses (n, 3) no robot can have made."""
    return np.hypot(*np.diff(np.asarray(poses)[:, :2], axis=0).T) > LEAP


def step_covariances(increments: np.ndarray, settings: OdometrySettings) -> np.ndarray:
    """Covariances (k, 3, 3) of pose increments (k, 3), each in its earlier robot frame."""
    travel = np.hypot(increments[:, 0], increments[:, 1]) + LEAST
    turn = increments[:, 2]
    variances = step_variances(travel, np.abs(turn) + LEAST, settings)
    # As on an arc: the error happens half-way, at half the turn.
    J = error_at_the_end(0.5 * turn, 0.5 * increments[:, :2])
    return np.einsum("aik,ik,bik->iab", J, variances, J)
