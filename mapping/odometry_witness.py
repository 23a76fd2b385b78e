"""OdometryWitness: what odometry does wrong throughout, told by the scans alone.

The matched path of a run cannot tell: odometry holds it back, so that of a wheel taken for 3 % too
large the path itself takes over nearly all. Here every scan is matched once more to those before
it with hardly any help from odometry, and what odometry then is off by, weighed by the information
of each match, is put down to three systematic errors (generalised least squares):

    minimise  sum_t  (u_t - z_t - J_t b)' R_t^-1 (u_t - z_t - J_t b)

with odometry's increment u, the match z and its information R^-1, and the columns of J for
distance, rotation and drift. Only their sums are needed, and a match that says nothing adds
nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mapping.ego_motion import EgoMotion
from mapping.settings import MappingSettings
from odometry.motion import Motion
from stereo.scan import RangeScan

# What odometry is doubted by here: after a metre or radian, in distance [m] and in turn [rad].
DOUBT = (0.3, math.radians(20.0))
LEAST = 1e-3  # m and rad: keeps the doubt of a standing robot finite
# Errors are gathered over stretches of this travel [m], a radian counting as TURN_AS_TRAVEL; they
# are told from LEAST_STRETCHES on, with standard errors from so many blocks of neighbours.
STRETCH = 1.0
TURN_AS_TRAVEL = 0.3
LEAST_STRETCHES = 60
BLOCKS = 20
# A stretch further off than this many standard deviations is slip or a false match.
OUTLIER = 4.0
MEDIAN_OF_CHI_SQUARE = 2.366  # with three degrees of freedom
# Matching itself errs throughout by about this much (rendered rooms of known truth): dots attract
# dots, and a blank corridor hides what is along it. Share, share, rad/m.
MATCHING = np.array([0.005, 0.005, math.radians(0.05)])
# A smaller error is not worth a word.
WORTH_TELLING = np.array([0.01, 0.01, math.radians(0.1)])
SIGNIFICANT = 3.0  # standard errors


@dataclass(frozen=True)
class OdometryErrors:
    """What odometry does wrong throughout, (3,) each with its standard error.

    distance and rotation: what it makes of one, less one (+0.02 = 2 % too much); drift: turn to
    the left that it reports without there being one [rad per metre driven forward].
    """

    value: np.ndarray
    error: np.ndarray

    @property
    def significant(self) -> np.ndarray:
        """Which of the three are beyond doubt, and worth a word, (3,) bool."""
        size = np.abs(self.value)
        return (size > SIGNIFICANT * self.error) & (size > WORTH_TELLING)


class OdometryWitness:
    """Is shown all motion by odometry and every scan that is due; changes nothing."""

    def __init__(self, settings: MappingSettings) -> None:
        self._ego = EgoMotion(settings.cell, math.radians(settings.correlated))
        self._since: Motion | None = None
        self._way = 0.0
        # Of each stretch: normal matrix (3, 3) and right-hand side (3,).
        self._normal = [np.zeros((3, 3))]
        self._right = [np.zeros(3)]

    def move(self, motion: Motion) -> None:
        """The robot moved, by odometry."""
        self._since = motion if self._since is None else self._since.then(motion)

    def observe(self, scan: RangeScan) -> None:
        """The scan taken where the robot moved to."""
        assert self._since is not None, "move() comes before observe()"
        told, self._since = self._since, None
        x, y, turn = told.increment.tolist()
        travel = math.hypot(x, y)
        along, about = travel + LEAST, travel + abs(turn) + LEAST
        doubt = np.array([DOUBT[0] ** 2 * along, DOUBT[0] ** 2 * along, DOUBT[1] ** 2 * about])
        loose = Motion(told.increment, np.diag(doubt), told.first, told.last)
        found = self._ego.refine(scan, loose)
        self._way += travel + TURN_AS_TRAVEL * abs(turn)
        if self._way >= STRETCH * len(self._normal):
            self._normal.append(np.zeros((3, 3)))
            self._right.append(np.zeros(3))
        if found is loose:  # too few hits
            return
        posterior = np.linalg.inv(found.covariance)
        # A wheel's radius turns the robot the other way when it drives backwards.
        J = np.array([[x, 0.0, 0.0], [y, 0.0, 0.0], [0.0, turn, math.copysign(travel, x)]])
        # R^-1 is what the match added to odometry's information; R^-1 (u - z) needs no inverse.
        self._normal[-1] += J.T @ (posterior - np.diag(1.0 / doubt)) @ J
        self._right[-1] += J.T @ posterior @ (told.increment - found.increment)

    def errors(self) -> OdometryErrors | None:
        """What is wrong with odometry; None: the run was too short to tell, or the robot never
        drove or never turned."""
        normal, right = np.array(self._normal), np.array(self._right)
        told = normal.any(axis=(1, 2))
        normal, right = normal[told], right[told]
        if len(normal) < LEAST_STRETCHES or not np.trace(normal.sum(axis=0)[1:2, 1:2]):
            return None
        return _solved(normal, right)


def _solved(normal: np.ndarray, right: np.ndarray) -> OdometryErrors | None:
    """From the sums (n, 3, 3) and (n, 3) of all stretches; standard errors by the jackknife over
    blocks of neighbours, whose errors hang together."""

    def fit(rows: np.ndarray) -> np.ndarray:
        return np.linalg.solve(normal[rows].sum(axis=0), right[rows].sum(axis=0))

    rows = np.arange(len(normal))
    inverses = np.linalg.pinv(normal, rcond=1e-6, hermitian=True)
    try:
        for _ in range(3):
            off = right - normal @ fit(rows)
            chi = np.einsum("ni,nij,nj->n", off, inverses, off)
            scale = np.median(chi) / MEDIAN_OF_CHI_SQUARE
            rows = np.flatnonzero(chi <= OUTLIER**2 * scale + 1e-9)
        value = fit(rows)
        blocks = np.array_split(rows, BLOCKS)
        without = np.array([fit(np.setdiff1d(rows, block)) for block in blocks])
    except np.linalg.LinAlgError:
        return None
    spread = np.sum((without - without.mean(axis=0)) ** 2, axis=0)
    statistical = (BLOCKS - 1) / BLOCKS * spread
    return OdometryErrors(value, np.sqrt(statistical + MATCHING**2))
