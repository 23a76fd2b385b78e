"""What an error in disparity does to depth: z = f B / d, so sigma_z = z^2 / (f B) sigma_d.

A constant offset of the disparity, as a wrong angle between the cameras leaves it, moves the
depth by the same law: put it in as `disparity_sigma`, or beside the noise as their hypotenuse.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

DISPARITY_SIGMA = 0.25  # of a matched disparity, as `stereo.noise` has it [px]
TOLERANCE = 0.10  # two cells of the default map [m]
DISTANCES = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0)  # at which people are told the error of depth [m]


def depth_sigma(
    focal: float, baseline: float, distance: npt.ArrayLike, disparity_sigma: float = DISPARITY_SIGMA
) -> np.ndarray:
    """Standard deviation of depth [m], in the shape of `distance`.

    Args:
        focal: focal length of the rectified cameras [px]. baseline: between them [m].
        distance: depth along the optical axis [m], any shape.
        disparity_sigma: standard deviation of the disparity [px].
    """
    return np.square(np.asarray(distance, float)) * (disparity_sigma / (focal * baseline))


def usable_range(
    focal: float,
    baseline: float,
    disparity_sigma: float = DISPARITY_SIGMA,
    tolerance: float = TOLERANCE,
) -> float:
    """Depth [m] at which `depth_sigma` reaches `tolerance` [m]: the range that mapping uses."""
    return math.sqrt(tolerance * focal * baseline / disparity_sigma)
