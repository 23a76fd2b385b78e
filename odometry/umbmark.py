"""UMBmark: wheel diameters and track from where a square drive ends, driven both ways round.

Source: Borenstein and Feng, Measurement and correction of systematic odometry errors in mobile
robots, IEEE T-RA 12(6), 1996; but E_d and E_b are fitted to all end points through exact arcs
instead of their first-order formulas, which are a fifth off for errors of a few per cent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from odometry.errors import OdometryError
from odometry.motion import compose

STEPS = 30
DELTA = 1e-6


@dataclass(frozen=True)
class UmbMark:
    """E_d: true diameter of the right wheel over the left one's; E_b: true track over the nominal
    one; sigma (2,) of both. left, right: factors of the radii, their mean kept.

    worst: E_max,syst, the greater distance of the two mean end points from the start [m];
    rest: the same with what remains after the correction.
    """

    E_d: float
    E_b: float
    sigma: np.ndarray
    worst: float
    rest: float

    @property
    def left(self) -> float:
        """Factor of the left radius."""
        return 2.0 / (self.E_d + 1.0)

    @property
    def right(self) -> float:
        """Factor of the right radius."""
        return 2.0 / (1.0 / self.E_d + 1.0)


def umbmark(cw: np.ndarray, ccw: np.ndarray, side: float, track: float) -> UmbMark:
    """E_d and E_b of least squares over all end points.

    cw, ccw: (n, 2) end point by the tape less that by odometry [m], in the robot's frame at the
    start (x ahead, y left), of squares to the right and to the left; side, nominal track: [m].

    Raises:
        OdometryError: fewer than two runs either way, or ends that no such errors explain.
    """
    if min(len(cw), len(ccw)) < 2:
        raise OdometryError(
            f"{len(cw)} runs clockwise and {len(ccw)} counter-clockwise: at least 2 each are "
            "needed (5 are usual)"
        )
    ends = np.concatenate([cw, ccw])
    way = np.concatenate([-np.ones(len(cw)), np.ones(len(ccw))])

    def misses(values: np.ndarray) -> np.ndarray:
        E_d, E_b = values.tolist()
        predicted = {sign: square_end(E_d, E_b, side, track, sign)[:2] for sign in (-1.0, 1.0)}
        return (ends - np.array([predicted[sign] for sign in way.tolist()])).ravel()

    values = np.ones(2)
    J = np.empty((ends.size, 2))
    for _ in range(STEPS):
        r = misses(values)
        for i, step in enumerate(DELTA * np.eye(2)):
            J[:, i] = (misses(values + step) - misses(values - step)) / (2.0 * DELTA)
        values = values - np.clip(np.linalg.lstsq(J, r, rcond=None)[0], -0.05, 0.05)
        if (np.abs(values - 1.0) > 0.5).any():
            raise OdometryError(
                "the ends fit no wheels: check their signs (x ahead, y left of the start, in "
                "metres) and the side of the square"
            )
    variance = float(np.sum(misses(values) ** 2)) / (ends.size - 2)
    sigma = np.sqrt(variance * np.diag(np.linalg.inv(J.T @ J)))
    left = misses(values).reshape(-1, 2)
    worst, rest = (
        max(float(np.hypot(*points[way == sign].mean(axis=0))) for sign in (-1.0, 1.0))
        for points in (ends, left)
    )
    return UmbMark(float(values[0]), float(values[1]), sigma, worst, rest)


def square_end(E_d: float, E_b: float, side: float, track: float, way: float) -> np.ndarray:
    """Pose (3,) after a square that odometry believes to be perfect.

    way: +1 to the left (counter-clockwise), -1 to the right.
    """
    left, right = 2.0 / (E_d + 1.0), 2.0 / (1.0 / E_d + 1.0)
    quarter = way * track * math.pi / 4.0  # path of each wheel in a turn of 90 deg
    pose = np.zeros(3)
    for _ in range(4):
        for a, b in ((side, side), (-quarter, quarter)):
            travel, turn = 0.5 * (left * a + right * b), (right * b - left * a) / (E_b * track)
            chord = travel * np.sinc(turn / (2.0 * math.pi))
            half = 0.5 * turn
            pose = compose(pose, np.array([chord * math.cos(half), chord * math.sin(half), turn]))
    return pose
