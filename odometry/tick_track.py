"""TickTrack: the paths of both wheels over time, and the motion between any two moments on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from odometry.differential_drive import drive
from odometry.encoders import EncoderParameters
from odometry.motion import Motion
from odometry.settings import OdometrySettings

# A gap is an interval that stands out among so many before it and is long for a moving robot.
GAP_INTERVALS = 5.0
GAP_NS = 200_000_000
USUAL_OF = 16

# While counters began anew the robot went on as in the second before, or did what robots do:
# a share of the greatest speed, rad/s; and a little that does not depend on time [m, rad].
RECENT_NS = 1_000_000_000
USUAL_SHARE = 0.25
USUAL_TURN = 0.5
LEAST_LOST = (0.05, math.radians(3.0))


@dataclass(frozen=True)
class TickTrack:
    """stamps: (n,) int64 ns, increasing; paths: (n, 2) of the left and right wheel [m].

    in_gap: (n - 1,) intervals without readings though some were due; lost: (n - 1, 2) further
    variance there, and where the counters began anew [m^2, rad^2], zero elsewhere.
    """

    stamps: np.ndarray
    paths: np.ndarray
    in_gap: np.ndarray
    lost: np.ndarray

    def motion(
        self, first: int, last: int, parameters: EncoderParameters, settings: OdometrySettings
    ) -> Motion:
        """Motion between two stamps [ns], first < last, both within the track.

        Paths are interpolated there, and each interval between two readings is one exact arc.
        """
        begin = int(np.searchsorted(self.stamps, first, side="right"))
        end = int(np.searchsorted(self.stamps, last, side="left"))
        covered = np.concatenate(
            [self._at(first, begin - 1), self.paths[begin:end], self._at(last, end - 1)]
        )
        intervals = slice(begin - 1, end)
        lost = self.lost[intervals]
        if lost.any():
            times = np.concatenate([[first], self.stamps[begin:end], [last]])
            share = np.diff(times) / np.diff(self.stamps[begin - 1 : end + 1])
            lost = lost * share[:, None]
        increment, covariance = drive(
            covered[1:] - covered[:-1],
            parameters.track,
            np.abs(parameters.metres_per_tick),
            settings,
            self.in_gap[intervals],
            lost,
        )
        return Motion(increment, covariance, first, last)

    def _at(self, stamp: int, interval: int) -> np.ndarray:
        """Wheel paths (1, 2) at a stamp inside the interval after reading number `interval`."""
        t0, t1 = self.stamps[interval : interval + 2].tolist()
        before = self.paths[interval : interval + 1]
        after = self.paths[interval + 1 : interval + 2]
        return before + (after - before) * ((stamp - t0) / (t1 - t0))


def gaps(stamps: np.ndarray) -> np.ndarray:
    """(n - 1,) which intervals between stamps (n,) ns are gaps, by those before them alone."""
    intervals = np.diff(stamps)
    found = np.zeros(len(intervals), bool)
    for i in np.flatnonzero(intervals > GAP_NS).tolist():
        before = intervals[max(i - USUAL_OF, 0) : i]
        found[i] = len(before) > 0 and intervals[i] > GAP_INTERVALS * np.median(before)
    return found


def gap_doubt(step: np.ndarray, seconds: float) -> float:
    """Variance [m^2] of where a robot went whose wheels went `step` (2,) m in a gap: it may have
    turned away and back."""
    travel = 0.5 * float(np.abs(step).sum())
    return (0.5 * travel * min(USUAL_TURN * seconds, 1.0)) ** 2


def lost_motion(
    stamps: np.ndarray,
    paths: np.ndarray,
    seconds: float,
    parameters: EncoderParameters,
    settings: OdometrySettings,
) -> tuple[float, float]:
    """Variance of a motion of which nothing is known [m^2, rad^2].

    stamps (k,), paths (k, 2): the readings before it, the last second of which counts;
    seconds: how long it took.
    """
    recent = stamps >= stamps[-1] - RECENT_NS
    elapsed = max((stamps[-1] - stamps[recent][0]) / 1e9, 1e-3)
    left, right = np.abs(paths[-1] - paths[recent][0]) / elapsed
    turn = abs(np.subtract(*(paths[-1] - paths[recent][0]))) / elapsed / parameters.track
    speed = max(0.5 * (left + right), USUAL_SHARE * settings.max_speed)
    travel = LEAST_LOST[0] + speed * seconds
    heading = LEAST_LOST[1] + max(turn, USUAL_TURN) * seconds
    return float(travel**2), float(heading**2)
