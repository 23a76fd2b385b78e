"""Movers: models that walk to and fro along a path, at any time where they are then."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simulation.boxes import Box


@dataclass(frozen=True)
class Mover:
    """Boxes about their own origin that face +x, on the way along `path` (n, 2) m and back."""

    boxes: tuple[Box, ...]
    path: tuple[tuple[float, float], ...]
    speed: float

    def pose(self, time: float) -> tuple[float, float, float]:
        """x m, y m and heading rad at `time` s; at 0 it leaves the path's first point."""
        points = np.array(self.path)
        legs = np.diff(points, axis=0)
        ends = np.cumsum(np.hypot(*legs.T))
        walked = (self.speed * time) % (2.0 * ends[-1])
        back = walked > ends[-1]
        along = 2.0 * ends[-1] - walked if back else walked
        leg = min(int(np.searchsorted(ends, along)), len(legs) - 1)
        dx, dy = legs[leg]
        short = (ends[leg] - along) / math.hypot(dx, dy)
        heading = math.atan2(dy, dx) + (math.pi if back else 0.0)
        return (*(points[leg + 1] - short * legs[leg]).tolist(), heading)
