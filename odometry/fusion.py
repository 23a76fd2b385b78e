"""Two odometries of one robot made into one, as long as they agree.

Each is weighed by its covariance (the product of both normal distributions). Whether they agree
is asked of the last step and of the last second together: a wheel that slips a little in every
step is found as well. Their difference, measured by the sum of both covariances, is chi-square
distributed with three degrees of freedom (the normalised innovation squared: Bar-Shalom, Li and
Kirubarajan 2001, Sec. 5.4).
"""

from __future__ import annotations

import itertools
from collections import deque

import numpy as np

from odometry.motion import Motion, compose, inverse, wrap_angle

# Chi-square of three degrees of freedom exceeds this once in 100,000 times.
GATE = 25.9
WINDOW = 1_000_000_000  # ns
# Smallest doubt of a difference [m, m, rad]: counts that did not change are taken as exact.
LEAST = np.array([1e-3, 1e-3, 1e-3])


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

        Else the two motions that disagree, of the step or of the last second; what they told up
        to here is then forgotten.
        """
        self._steps.append((a, b))
        while self._steps[0][0].last < a.last - WINDOW:
            self._steps.popleft()
        sums = self._steps[0]
        for step in itertools.islice(self._steps, 1, None):
            sums = (sums[0].then(step[0]), sums[1].then(step[1]))
        for span in ((a, b), sums):
            if disagreement(*span) > GATE:
                self.forget()
                return span
        return None

    def forget(self) -> None:
        """Begin anew, after a step that only one of them knew."""
        self._steps.clear()
