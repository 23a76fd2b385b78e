"""ObservationGate: which pairs are observations.

The paper observes at 2 Hz while driving 0.34 m/s. What counts is the motion: a robot that
stands still, or a faster camera, must not fill a local map with the same view ten times.
"""

from __future__ import annotations

import math

import numpy as np

from mapping.settings import MappingSettings
from odometry.motion import compose, wrap_angle

# A camera whose pairs fall just at the spacing must not lose every other one to odometry noise.
SLACK = 0.9


class ObservationGate:
    """Open for the first pair, then after each `spacing` [m] of travel or `angle` [rad] of turn."""

    def __init__(self, spacing: float, angle: float):
        self.spacing = spacing
        self.angle = angle
        self._since: np.ndarray | None = None

    def step(self, increment: np.ndarray) -> bool:
        """Whether the pair after this pose increment (3,) is an observation."""
        if self._since is None:
            self._since = np.zeros(3)
            return True
        self._since = compose(self._since, increment)
        travel = math.hypot(self._since[0], self._since[1])
        turn = abs(float(wrap_angle(self._since[2])))
        if travel < SLACK * self.spacing and turn < SLACK * self.angle:
            return False
        self._since = np.zeros(3)
        return True


def gate_of(settings: MappingSettings) -> ObservationGate:
    """The gate of a run with these settings."""
    return ObservationGate(settings.spacing, math.radians(settings.spacing_angle))
