"""Drive: one trip along a scene's route, as the robot's clocks and wheels record it.

Frame of all poses: the scene's. Truth for a map is wanted in the frame of the first pose; see
`Drive.truth`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from odometry.encoders import EncoderParameters
from odometry.motion import compose, inverse
from simulation.route import Route
from simulation.wheels import WheelNoise, wheel_ticks

FIRST_STAMP = 1_000_000_000_000  # ns
PAIR_RATE = 2.0  # pairs a second
TICK_PERIOD = 50_000_000  # ns: 20 readings a second
TICK_OFFSET = 13_000_000  # ns: the wheels' clock does not tick with the cameras'


@dataclass(frozen=True)
class Drive:
    """stamps (n,) int64 ns and poses (n, 3) of the pairs; velocities (n, 2) m/s in the frame of
    the first pose; tick_stamps (m,) ns, ticks (m, 2), which begin before the first pair and end
    after the last; distance driven [m]."""

    stamps: np.ndarray
    poses: np.ndarray
    velocities: np.ndarray
    tick_stamps: np.ndarray
    ticks: np.ndarray
    distance: float

    @property
    def times(self) -> np.ndarray:
        """(n,) s: when on the route the pairs are taken."""
        return (self.stamps - FIRST_STAMP) / 1e9

    @property
    def truth(self) -> np.ndarray:
        """(n, 3) poses in the frame of the first one."""
        return compose(inverse(self.poses[0]), self.poses)


def drive(
    route: Route,
    encoders: EncoderParameters,
    noise: WheelNoise,
    seed: int,
    duration: float = math.inf,
    rate: float = PAIR_RATE,
) -> Drive:
    """Drive `route` for at most `duration` s and take `rate` pairs a second."""
    end = min(duration, route.duration)
    stamps = np.arange(0, int(end * 1e9) + 1, round(1e9 / rate), dtype=np.int64)
    poses = route.poses(stamps / 1e9)
    tick_stamps = np.arange(
        TICK_OFFSET - 2 * TICK_PERIOD, stamps[-1] + 2 * TICK_PERIOD, TICK_PERIOD, dtype=np.int64
    )
    steps = np.hypot(*np.diff(route.poses(np.arange(0.0, stamps[-1] / 1e9, 0.01))[:, :2], axis=0).T)
    return Drive(
        FIRST_STAMP + stamps,
        poses,
        _velocities(route, stamps / 1e9, poses[0, 2]),
        FIRST_STAMP + tick_stamps,
        wheel_ticks(route.poses(tick_stamps / 1e9), encoders, noise, seed),
        float(steps.sum()),
    )


def _velocities(route: Route, times: np.ndarray, heading: float) -> np.ndarray:
    h = 1e-3
    velocity = (route.poses(times + h) - route.poses(times - h))[:, :2] / (2.0 * h)
    c, s = math.cos(heading), math.sin(heading)
    return velocity @ np.array([[c, -s], [s, c]])
