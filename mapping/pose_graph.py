"""A chain of poses bent to agree with what was measured between them (Lu and Milios 1997).

Every measurement says where one pose lies in the frame of another, with its information. The
poses with the least sum of squared, weighted contradictions are found by Gauss-Newton on the
sparse normal equations. Measurements that contradict the rest lose their weight (Cauchy), so that
one false match does not bend the path.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from odometry.motion import compose, inverse, wrap_angle

MOST_STEPS = 20
# The square of an error at which a measurement has half its weight: three degrees of freedom
# make three the usual square.
CAUCHY = 3.0
# Steps below this are no change [m, rad].
SETTLED = 1e-5

# Numbers (m,) of the poses that errors depend on, and the derivatives (m, 3, 3), for each side.
Sides = tuple[tuple[np.ndarray, np.ndarray], ...]


@dataclass(frozen=True)
class Measurements:
    """m measured relative poses.

    base, other: (m,) numbers of the poses; relative: (m, 3) pose of `other` in the frame of
    `base`; information: (m, 3, 3) inverse covariance of it, in the frame of `base`.
    """

    base: np.ndarray
    other: np.ndarray
    relative: np.ndarray
    information: np.ndarray

    @staticmethod
    def none() -> Measurements:
        """No measurement at all."""
        nowhere = np.zeros(0, np.int64)
        return Measurements(nowhere, nowhere, np.zeros((0, 3)), np.zeros((0, 3, 3)))

    def shifted(self, by: int) -> Measurements:
        """The same, the poses numbered from `by` on."""
        return replace(self, base=self.base + by, other=self.other + by)

    def only(self, chosen: np.ndarray) -> Measurements:
        """Those that are chosen, (m,) bool."""
        return Measurements(
            self.base[chosen], self.other[chosen], self.relative[chosen], self.information[chosen]
        )

    def followed_by(self, more: Measurements) -> Measurements:
        """These, then `more`."""
        return Measurements(
            np.concatenate([self.base, more.base]),
            np.concatenate([self.other, more.other]),
            np.concatenate([self.relative, more.relative]),
            np.concatenate([self.information, more.information]),
        )


def relax(poses: np.ndarray, sure: Measurements, doubtful: Measurements) -> np.ndarray:
    """The poses (n, 3) that agree best; the first stays where it is.

    sure: measurements of which none is false (odometry); doubtful: matches, some perhaps false.
    """
    measured = sure.followed_by(doubtful)
    poses = poses.copy()
    for _ in range(MOST_STEPS):
        error, by_base, by_other = _linearised(poses, measured)
        squared = _squared(error, measured)
        weight = 1.0 / (1.0 + squared / CAUCHY)
        weight[: len(sure.base)] = 1.0
        weighted = weight[:, None, None] * measured.information
        sides = ((measured.base, by_base), (measured.other, by_other))
        step = _solve(len(poses), sides, weighted, error)
        poses[1:] += step
        poses[:, 2] = wrap_angle(poses[:, 2])
        if np.abs(step).max(initial=0.0) < SETTLED:
            break
    return poses


def contradictions(poses: np.ndarray, measured: Measurements) -> np.ndarray:
    """Normalised squared errors (m,) of the measurements at poses (n, 3): 3 on average where
    poses and covariances are true."""
    return _squared(_linearised(poses, measured)[0], measured)


def _squared(error: np.ndarray, measured: Measurements) -> np.ndarray:
    return np.einsum("mi,mij,mj->m", error, measured.information, error)


def _solve(n: int, sides: Sides, information: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Gauss-Newton's step (n - 1, 3) of all poses but the first."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    gradient = np.zeros((n, 3))
    rows, columns, values = [], [], []
    for one, J in sides:
        np.add.at(gradient, one, -np.einsum("mki,mkl,ml->mi", J, information, error))
        for two, K in sides:
            block = np.einsum("mki,mkl,mlj->mij", J, information, K)
            row = 3 * one[:, None, None] + np.arange(3)[:, None]
            column = 3 * two[:, None, None] + np.arange(3)
            rows.append(np.broadcast_to(row, block.shape).ravel() - 3)
            columns.append(np.broadcast_to(column, block.shape).ravel() - 3)
            values.append(block.ravel())
    row, column, value = (np.concatenate(part) for part in (rows, columns, values))
    free = (row >= 0) & (column >= 0)
    unknown = 3 * (n - 1)
    A = coo_array((value[free], (row[free], column[free])), shape=(unknown, unknown))
    return splu(A.tocsc()).solve(gradient[1:].ravel()).reshape(-1, 3)


def _linearised(
    poses: np.ndarray, measured: Measurements
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors (m, 3) of the measurements at `poses`, and their derivatives (m, 3, 3) by the pose
    of the base and by the other one."""
    base, other = poses[measured.base], poses[measured.other]
    error = compose(inverse(base), other) - measured.relative
    error[:, 2] = wrap_angle(error[:, 2])
    c, s = np.cos(base[:, 2]), np.sin(base[:, 2])
    dx, dy = (other - base)[:, :2].T
    by_base, by_other = np.zeros((2, len(base), 3, 3))
    by_other[:, 0, 0], by_other[:, 0, 1] = c, s
    by_other[:, 1, 0], by_other[:, 1, 1] = -s, c
    by_other[:, 2, 2] = 1.0
    by_base[:, :2, :2] = -by_other[:, :2, :2]
    by_base[:, 0, 2] = -s * dx + c * dy
    by_base[:, 1, 2] = -c * dx - s * dy
    by_base[:, 2, 2] = -1.0
    return error, by_base, by_other
