"""MotionSource: how the robot moved between two moments; here, from wheel encoders."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from odometry.differential_drive import drive
from odometry.encoders import EncoderParameters, unwrap_counts, within_counter
from odometry.errors import OdometryError
from odometry.motion import Motion
from odometry.settings import OdometrySettings
from odometry.tick_log import TickLog

# More readings than this share beyond the counter's range are no damage: its width is wrong.
MOST_OUT_OF_RANGE = 0.01


class MotionSource(Protocol):
    """Any odometry, asked once for every stereo pair in order of time."""

    def until(self, stamp: int) -> Motion | None:
        """Motion since the last stamp that was answered; the first answer is no motion.

        None: nothing is known at that stamp; the next answer then spans it.
        """
        ...

    def report(self) -> dict[str, int | float]:
        """Counts for the summary of a run."""
        ...


class EncoderOdometry:
    """Recorded ticks of a differential drive as motion (see `MotionSource`).

    Counts are interpolated at the asked stamps and every interval between two readings is
    driven as one exact arc. Stamps before the first reading, after the last, or earlier than
    the one answered before get None. Motion across a gap in the ticks is still given, with
    the larger covariance of `differential_drive.drive`.

    Raises:
        OdometryError: the counts do not fit counters of `counter_bits`.
    """

    def __init__(
        self, ticks: TickLog, parameters: EncoderParameters, settings: OdometrySettings
    ) -> None:
        usable = _usable(ticks, parameters)
        self._out_of_range = int(len(ticks) - usable.sum())
        self._ticks = TickLog(
            ticks.stamps[usable], ticks.left[usable], ticks.right[usable], ticks.skipped
        )
        counts = [
            unwrap_counts(raw, parameters.counter_bits)
            for raw in (self._ticks.left, self._ticks.right)
        ]
        paths = np.stack([c - c[0] for c in counts], axis=1) * parameters.metres_per_tick
        self._paths = paths
        self._in_gap = self._ticks.in_gap
        self._track = parameters.track
        self._tick = np.abs(parameters.metres_per_tick)
        self._settings = settings
        self._previous: int | None = None
        self._unanswered = 0

    def until(self, stamp: int) -> Motion | None:
        """Motion since the stamp answered before; None where no ticks tell."""
        first, last = self._ticks.stamps[[0, -1]]
        previous = self._previous
        if not max(first, first if previous is None else previous) <= stamp <= last:
            self._unanswered += 1
            return None
        self._previous = stamp
        if previous is None or previous == stamp:
            return Motion.none(stamp)
        stamps = self._ticks.stamps
        begin = int(np.searchsorted(stamps, previous, side="right"))
        end = int(np.searchsorted(stamps, stamp, side="left"))
        covered = np.concatenate(
            [self._at(previous, begin - 1), self._paths[begin:end], self._at(stamp, end - 1)]
        )
        paths = covered[1:] - covered[:-1]
        increment, covariance = drive(
            paths, self._track, self._tick, self._settings, self._in_gap[begin - 1 : end]
        )
        return Motion(increment, covariance, previous, stamp)

    def report(self) -> dict[str, int | float]:
        """Readings used, lines skipped by reason, gaps, and stamps that got no answer."""
        gaps = np.diff(self._ticks.gaps, axis=1)
        return {
            "ticks": len(self._ticks),
            **{f"ticks_{reason}": n for reason, n in self._ticks.skipped.items()},
            "ticks_out_of_range": self._out_of_range,
            "tick_gaps": len(gaps),
            "longest_tick_gap_s": float(gaps.max() / 1e9) if len(gaps) else 0.0,
            "pairs_without_motion": self._unanswered,
        }

    def _at(self, stamp: int, interval: int) -> np.ndarray:
        """Wheel paths (1, 2) at a stamp inside the interval after reading number `interval`."""
        t0, t1 = self._ticks.stamps[interval : interval + 2].tolist()
        before = self._paths[interval : interval + 1]
        after = self._paths[interval + 1 : interval + 2]
        return before + (after - before) * ((stamp - t0) / (t1 - t0))


def _usable(ticks: TickLog, parameters: EncoderParameters) -> np.ndarray:
    bits = parameters.counter_bits
    usable = within_counter(ticks.left, bits) & within_counter(ticks.right, bits)
    if usable.mean() < 1.0 - MOST_OUT_OF_RANGE or usable.sum() < 2:
        both = np.concatenate([ticks.left, ticks.right])
        raise OdometryError(
            f"counter_bits: {bits} does not fit the ticks, which run from {both.min()} to "
            f"{both.max()}: give the counters' true width in odom0/sensor.yaml or the rig"
        )
    return usable
