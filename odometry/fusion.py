"""Two odometries of one robot made into one, as long as they agree.

Each is weighed by its covariance (the product of both normal distributions). Whether they agree
is asked of the last step and of the last second together: a wheel that slips a little in every
step is found as well. Their difference, measured by the sum of both covariances, is chi-square
distributed with three degrees of freedom (the normalised innovation squared: Bar-Shalom, Li and
Kirubarajan 2001, Sec. 5.4).
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from dataclasses import replace

import numpy as np

from odometry.motion import Motion, compose, inverse, wrap_angle

# Chi-square of three degrees of freedom exceeds this once in 100,000 times.
GATE = 25.9
WINDOW = 1_000_000_000  # ns
# Smallest doubt of a difference [m, m, rad]: counts that did not change are taken as exact.
LEAST = np.array([1e-3, 1e-3, 1e-3])
# Standard deviations of wheels' systematic errors before they are known [share, share, rad/m]: a
# tape measures radii and track to some per cent, and 1 % of one wheel is 2 deg/m at 0.3 m of track.
USUAL = np.array([0.05, 0.1, math.radians(5.0)])
# And by how much of that they change in a metre (tyres, load, floors), as a random walk.
CHANGING = 0.002


def fuse(a: Motion, b: Motion) -> Motion:
    """The likeliest motion given two independent ones over the same time, and its covariance."""
    S = a.covariance + b.covariance
    if not S.any():
        return a
    # Between exact and doubtful numbers S is near singular; the exact ones are then kept.
    gain = a.covariance @ np.linalg.pinv(S, hermitian=True)
    difference = _difference(a, b)
    increment = a.increment + gain @ difference
    increment[2] = wrap_angle(increment[2])
    # Joseph's form keeps it symmetric and positive.
    rest = np.eye(3) - gain
    covariance = rest @ a.covariance @ rest.T + gain @ b.covariance @ gain.T
    return Motion(increment, covariance, a.first, a.last)


def disagreement(a: Motion, b: Motion) -> float:
    """Squared Mahalanobis length of the difference of two motions over the same time."""
    difference = _difference(a, b)
    S = a.covariance + b.covariance + np.diag(LEAST**2)
    return float(difference @ np.linalg.solve(S, difference))


def without(whole: Motion, begun: Motion) -> Motion:
    """The rest of a motion of which the beginning is known from elsewhere."""
    back = Motion(inverse(begun.increment))
    c, s = np.cos(begun.increment[2]), np.sin(begun.increment[2])
    dx, dy = compose(back.increment, whole.increment)[:2]
    # d rest / d whole is the rotation back; d rest / d begun the adjoint's inverse, rotated.
    J1 = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    J2 = np.array([[c, s, -dy], [-s, c, dx], [0.0, 0.0, 1.0]])
    covariance = J1 @ whole.covariance @ J1.T + J2 @ begun.covariance @ J2.T
    return Motion(compose(back.increment, whole.increment), covariance, begun.last, whole.last)


class SystematicErrors:
    """What one odometry does wrong throughout, learnt from another that does not.

    Errors that come with every step (a wheel's radius, the track) add up with the way, not with
    its square root, so that no covariance of independent steps describes them: they are estimated
    by a Kalman filter, and taken off. value: (3,) what it makes too much of distance and of
    rotation, as shares, and how far it turns to the left where the robot does not [rad/m];
    covariance: (3, 3).
    """

    def __init__(self) -> None:
        self.value = np.zeros(3)
        self.covariance = np.diag(USUAL**2)

    def corrected(self, motion: Motion) -> Motion:
        """The motion without them; its covariance as it was."""
        increment = motion.increment - _jacobian(motion.increment) @ self.value
        return replace(motion, increment=increment)

    def uncertain(self, motion: Motion) -> Motion:
        """The motion with the covariance that comes from not knowing them exactly."""
        J = _jacobian(motion.increment)
        return replace(motion, covariance=motion.covariance + J @ self.covariance @ J.T)

    def learn(self, corrected: Motion, better: Motion) -> None:
        """Take in both odometries' motion over the same time.

        The way is the better one's: in that of the wheels every error of a step is held against
        itself, as if all of it were a part of what the wheels report.
        """
        J = _jacobian(better.increment)
        travel = math.hypot(*better.increment[:2]) + abs(better.increment[2])
        self.covariance = self.covariance + np.diag((CHANGING * USUAL) ** 2) * travel
        left = _difference(better, corrected)
        S = J @ self.covariance @ J.T + corrected.covariance + better.covariance + np.diag(LEAST**2)
        gain = np.linalg.solve(S, J @ self.covariance).T
        self.value = self.value + gain @ left
        self.covariance = self.covariance - gain @ J @ self.covariance


def _jacobian(increment: np.ndarray) -> np.ndarray:
    """(3, 3): an increment's error by distance, rotation and drift, turning evenly on the way."""
    x, y, turn = increment.tolist()
    way = math.copysign(math.hypot(x, y), x)
    turned = np.array([-0.5 * y, 0.5 * x, 1.0])
    return np.column_stack([[x, y, 0.0], turn * turned, way * turned])


def _difference(a: Motion, b: Motion) -> np.ndarray:
    difference = b.increment - a.increment
    difference[2] = wrap_angle(difference[2])
    return difference


class Agreement:
    """Whether two odometries tell of the same motion, step by step."""

    def __init__(self) -> None:
        self._steps: deque[tuple[Motion, Motion]] = deque()

    def step(self, a: Motion, b: Motion) -> tuple[Motion, Motion] | None:
        """None while they agree, on this step and, with it, on the last second.

        Else the two motions that disagree, of the step or of the last second. What is too small
        to see in one step stays suspect until a second without it has passed.
        """
        self._steps.append((a, b))
        while self._steps[0][0].last < a.last - WINDOW:
            self._steps.popleft()
        sums = self._steps[0]
        for step in itertools.islice(self._steps, 1, None):
            sums = (sums[0].then(step[0]), sums[1].then(step[1]))
        for span in ((a, b), sums):
            if disagreement(*span) > GATE:
                return span
        return None

    def forget(self) -> None:
        """Begin anew, after a step that only one of them knew."""
        self._steps.clear()
