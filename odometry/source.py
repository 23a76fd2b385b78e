"""MotionSource: how the robot moved between two moments; here, from recorded wheel encoders."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from odometry.counters import CounterTracker, Limits, all_believable
from odometry.encoders import EncoderParameters, unwrap_counts, within_counter
from odometry.errors import OdometryError
from odometry.motion import Motion
from odometry.settings import OdometrySettings
from odometry.tick_log import TickLog
from odometry.tick_track import TickTrack, gap_doubt, gaps, lost_motion

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
    the larger covariance of `differential_drive.drive`. Where the counters began anew there is no
    motion, with much doubt; wild readings are left out (`counters.CounterTracker`).

    Raises:
        OdometryError: the counts do not fit counters of `counter_bits`.
    """

    def __init__(
        self, ticks: TickLog, parameters: EncoderParameters, settings: OdometrySettings
    ) -> None:
        self.ticks, self.parameters = ticks, parameters
        usable = _usable(ticks, parameters)
        self._skipped = ticks.skipped
        self._counts = {"out_of_range": int(len(ticks) - usable.sum())}
        self.track, counts = _track(ticks, usable, parameters, settings)
        self._counts |= counts
        self._settings = settings
        self._previous: int | None = None
        self._unanswered = 0

    def until(self, stamp: int) -> Motion | None:
        """Motion since the stamp answered before; None where no ticks tell."""
        first, last = self.track.stamps[[0, -1]]
        previous = self._previous
        if not max(first, first if previous is None else previous) <= stamp <= last:
            self._unanswered += 1
            return None
        self._previous = stamp
        if previous is None or previous == stamp:
            return Motion.none(stamp)
        return self.track.motion(previous, stamp, self.parameters, self._settings)

    def report(self) -> dict[str, int | float]:
        """Readings used, lines skipped by reason, gaps, and stamps that got no answer."""
        found = self.track.in_gap
        intervals = np.diff(self.track.stamps)[found]
        return {
            "ticks": len(self.track.stamps),
            **{f"ticks_{reason}": n for reason, n in self._skipped.items()},
            **{f"ticks_{reason}": n for reason, n in self._counts.items()},
            "tick_gaps": len(intervals),
            "longest_tick_gap_s": float(intervals.max() / 1e9) if len(intervals) else 0.0,
            "pairs_without_motion": self._unanswered,
        }


def _track(
    ticks: TickLog,
    usable: np.ndarray,
    parameters: EncoderParameters,
    settings: OdometrySettings,
) -> tuple[TickTrack, dict[str, int]]:
    """The track, and how many readings were wild or began anew."""
    stamps = ticks.stamps[usable] + round(parameters.time_offset * 1e9)
    raw = np.stack([ticks.left[usable], ticks.right[usable]], axis=1)
    limits = Limits(parameters, settings.max_speed)
    counts: dict[str, int] = {}
    if not ticks.reset[usable].any() and all_believable(stamps, raw, limits):
        totals = np.stack([unwrap_counts(c, parameters.counter_bits) for c in raw.T], axis=1)
        reset = np.zeros(len(stamps), bool)
    else:
        tracker = CounterTracker(limits)
        rows = zip(stamps.tolist(), raw.tolist(), ticks.reset[usable].tolist(), strict=True)
        readings = [r for stamp, (a, b), new in rows for r in tracker.take(stamp, a, b, new)]
        counts = dict(tracker.counts)
        stamps, _, _, *totals, reset = (np.array(column) for column in zip(*readings, strict=True))
        totals = np.stack(totals, axis=1)
    paths = (totals - totals[0]) * parameters.metres_per_tick
    lost = np.zeros((len(stamps) - 1, 2))
    for i in np.flatnonzero(reset[1:]).tolist():
        seconds = float(stamps[i + 1] - stamps[i]) / 1e9
        lost[i] = lost_motion(stamps[: i + 1], paths[: i + 1], seconds, parameters, settings)
    in_gap = gaps(stamps)
    for i in np.flatnonzero(in_gap).tolist():
        lost[i, 0] += gap_doubt(paths[i + 1] - paths[i], float(stamps[i + 1] - stamps[i]) / 1e9)
    return TickTrack(stamps, paths, in_gap, lost), counts


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
