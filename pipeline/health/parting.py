"""How far odometry and the matched path part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mapping.path import travelled
from odometry.motion import compose, inverse

# They are compared over stretches of this travel [m], turns included, from so many on.
STRETCH = 1.0
FEW_STRETCHES = 5


@dataclass(frozen=True)
class Parting:
    """In the median of `stretches`: distance m, angle rad."""

    distance: float
    angle: float
    stretches: int


def parting(odometry: np.ndarray, path: np.ndarray) -> Parting | None:
    """Of odometry and the matched path, poses (n, 3); None: the run was too short."""
    if not len(odometry):
        return None
    way = travelled(odometry)
    ends = np.unique(np.searchsorted(way, np.arange(0.0, way[-1], STRETCH)))
    if len(ends) <= FEW_STRETCHES:
        return None
    found, true = (_stretches(poses, ends) for poses in (odometry, path))
    apart = float(np.median(np.hypot(*(found - true)[:, :2].T)))
    turned = float(np.median(np.abs(found[:, 2] - true[:, 2])))
    return Parting(apart, turned, len(found))


def _stretches(poses: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Motion (m - 1, 3) between the poses numbered `ends` (m,); turns are not wrapped."""
    motion = compose(inverse(poses[ends[:-1]]), poses[ends[1:]])
    motion[:, 2] = np.diff(np.unwrap(poses[:, 2])[ends])
    return motion
