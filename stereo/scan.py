"""RangeScan: the nearest obstacle in every direction the camera sees, with its doubt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RangeScan:
    """Ranges in the robot's horizontal plane.

    stamp: integer nanoseconds.
    origin: (x m, y m, yaw rad) of the sensor on the robot.
    bearing: (n,) rad, left positive, strictly increasing, in the sensor's frame.
    range: (n,) m; NaN = no measurement (unknown, never free), +inf = nothing within
        `max_range` (free up to it).
    sigma: (n,) m, standard deviation of `range`; NaN where the range is not finite.
    max_range: m.
    """

    stamp: int
    origin: tuple[float, float, float]
    bearing: np.ndarray
    range: np.ndarray
    sigma: np.ndarray
    max_range: float

    @property
    def answered(self) -> float:
        """Share of bearings with an answer (an obstacle, or nothing up to `max_range`)."""
        return float(np.mean(~np.isnan(self.range))) if self.range.size else 0.0

    @property
    def spacing(self) -> float:
        """Mean angle between neighbouring bearings [rad]; 0 for a single one."""
        n = self.bearing.size
        return float(self.bearing[-1] - self.bearing[0]) / (n - 1) if n > 1 else 0.0
