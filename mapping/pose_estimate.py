"""Where weighted particles put the robot: mean and covariance of their heaviest mode.

A single particle carries its own draws of the odometry's error; the mean over many of them does
not (the estimate of least mean squared error: Thrun, Burgard and Fox, Probabilistic Robotics,
2005, Sec. 8.3). A mean over two hypotheses would be the place of neither, so only particles that
hang together count.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from odometry.motion import Motion, wrap_angle

# Particles closer together than this [m, rad] belong to one mode.
LINK = (0.25, math.radians(10.0))


def estimate_pose(poses: np.ndarray, log_weights: np.ndarray, stamp: int) -> Motion:
    """The heaviest mode of particles at poses (N, 3) with log-weights (N,).

    Returns the motion from the map's origin to the mode's mean pose, with the covariance of its
    particles.
    """
    weights = np.exp(log_weights - log_weights.max())
    mode = modes(poses, *LINK)
    chosen = mode == np.argmax(np.bincount(mode, weights))
    poses, weights = poses[chosen], weights[chosen] / weights[chosen].sum()
    # Angles are taken relative to one of them, so that they do not wrap within the mode.
    off = poses - poses[0]
    off[:, 2] = wrap_angle(off[:, 2])
    mean = weights @ off
    spread = off - mean
    pose = poses[0] + mean
    pose[2] = wrap_angle(pose[2])
    return Motion(pose, (weights[:, None] * spread).T @ spread, stamp, stamp)


@numba.njit(cache=True, nogil=True)
def modes(poses, distance, angle):
    """Number (N,) of the mode that each pose (N, 3) belongs to, by single linkage.

    Two poses are linked when they are closer than `distance` [m] and `angle` [rad].
    """
    n = len(poses)
    mode = np.full(n, -1, np.int64)
    waiting = np.empty(n, np.int64)
    count = 0
    for first in range(n):
        if mode[first] >= 0:
            continue
        mode[first], waiting[0], left = count, first, 1
        while left:
            left -= 1
            i = waiting[left]
            for j in range(n):
                if mode[j] >= 0:
                    continue
                turn = (poses[j, 2] - poses[i, 2] + math.pi) % (2.0 * math.pi) - math.pi
                apart = math.hypot(poses[j, 0] - poses[i, 0], poses[j, 1] - poses[i, 1])
                if apart < distance and abs(turn) < angle:
                    mode[j], waiting[left] = count, j
                    left += 1
        count += 1
    return mode
