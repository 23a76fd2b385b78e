"""Motion: a planar pose increment with its covariance, and the algebra of SE(2).

Poses are (x m, y m, theta rad); theta counter-clockwise (REP 103). `compose(a, b)` is the pose
b, given in the frame of a, seen from the frame of a's parent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np


def wrap_angle(angle):
    """Angle(s) brought into [-pi, pi)."""
    return (np.asarray(angle) + math.pi) % (2.0 * math.pi) - math.pi


def compose(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a (+) b for poses (..., 3); theta is wrapped."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    if a.ndim == b.ndim == 1:  # one pose at a time: numpy's bookkeeping would cost most
        ax, ay, at = a.tolist()
        bx, by, bt = b.tolist()
        c, s = math.cos(at), math.sin(at)
        return np.array([ax + c * bx - s * by, ay + s * bx + c * by, _wrapped(at + bt)])
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    pose = np.empty(np.broadcast_shapes(a.shape, b.shape))
    pose[..., 0] = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    pose[..., 1] = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    pose[..., 2] = wrap_angle(a[..., 2] + b[..., 2])
    return pose


def inverse(a: np.ndarray) -> np.ndarray:
    """The pose of a's parent in the frame of a, for poses (..., 3)."""
    a = np.asarray(a, float)
    if a.ndim == 1:
        x, y, t = a.tolist()
        c, s = math.cos(t), math.sin(t)
        return np.array([-c * x - s * y, s * x - c * y, _wrapped(-t)])
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack(
        [
            -c * a[..., 0] - s * a[..., 1],
            s * a[..., 0] - c * a[..., 1],
            wrap_angle(-a[..., 2]),
        ],
        axis=-1,
    )


def placed(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 2) of the frame that stands at `pose` (3,)."""
    return points @ rotation(pose[2]).T + pose[:2]


def rotation(angle: float) -> np.ndarray:
    """Matrix (2, 2) that turns by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@dataclass(frozen=True)
class Motion:
    """Pose increment (3,) in the earlier robot frame, covariance (3, 3) in that same frame.

    The covariance is that of (x, y, theta) of the increment; first and last stamp in ns.
    """

    increment: np.ndarray
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    first: int = 0
    last: int = 0

    @staticmethod
    def none(stamp: int) -> Motion:
        """No motion at all, known exactly."""
        return Motion(np.zeros(3), np.zeros((3, 3)), stamp, stamp)

    def then(self, later: Motion) -> Motion:
        """This motion followed by `later` (first-order propagation, Smith and Cheeseman 1986)."""
        dx, dy = later.increment[:2]
        c, s = math.cos(self.increment[2]), math.sin(self.increment[2])
        J1 = np.array([[1.0, 0.0, -s * dx - c * dy], [0.0, 1.0, c * dx - s * dy], [0.0, 0.0, 1.0]])
        J2 = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        covariance = J1 @ self.covariance @ J1.T + J2 @ later.covariance @ J2.T
        return Motion(compose(self.increment, later.increment), covariance, self.first, later.last)
