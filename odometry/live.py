"""LiveOdometry: motion from encoders that are being read."""

from __future__ import annotations

from collections import Counter, deque

import numpy as np

from odometry.counters import TickReading
from odometry.encoders import EncoderParameters
from odometry.motion import Motion
from odometry.reader import Tap
from odometry.settings import OdometrySettings
from odometry.tick_track import (
    RECENT_NS,
    USUAL_OF,
    TickTrack,
    gap_doubt,
    gaps,
    lost_motion,
)

WAIT_S = 0.5  # an image whose ticks do not come in this time gets no motion


class LiveOdometry:
    """Readings as they arrive, as motion (see `odometry.source.MotionSource`).

    `until` waits until a reading at or past the image's stamp has arrived, `wait_s` at most;
    then None: nothing is known there, and the next answer spans it. The same readings, recorded,
    give the same motion by `EncoderOdometry`.

    tap: one of its own (`encoders.tap()`); what it was given is taken from it.
    """

    def __init__(
        self,
        tap: Tap,
        parameters: EncoderParameters,
        settings: OdometrySettings,
        wait_s: float = WAIT_S,
    ) -> None:
        self._tap = tap
        self._parameters = parameters
        self._settings = settings
        self._wait_s = wait_s
        self._offset = round(parameters.time_offset * 1e9)
        # Of each reading: stamp, paths, and of the interval before it: gap, lost variances.
        self._rows: deque[tuple[int, float, float, bool, float, float]] = deque()
        self._origin: tuple[int, int] | None = None
        self._previous: int | None = None
        self._silent = False
        self._counts: Counter[str] = Counter(ticks=0, pairs_without_motion=0)

    def until(self, stamp: int) -> Motion | None:
        """Motion since the stamp answered before; None where no ticks came."""
        # Silent wheels are waited for once: a camera is not to wait for them pair after pair.
        in_time = self._tap.wait_until(stamp - self._offset, 0.0 if self._silent else self._wait_s)
        readings = self._tap.readings()
        self._silent = not in_time and not readings
        for reading in readings:
            self._add(reading)
        if not in_time or stamp < self._rows[0][0] or stamp < (self._previous or stamp):
            self._counts["pairs_without_motion"] += 1
            return None
        previous, self._previous = self._previous, stamp
        if previous is None or previous == stamp:
            return Motion.none(stamp)
        motion = self._track().motion(previous, stamp, self._parameters, self._settings)
        self._forget(stamp)
        return motion

    def report(self) -> dict[str, int | float]:
        """Readings, gaps, restarts of the counters, and stamps that got no answer."""
        return dict(self._counts)

    def _add(self, reading: TickReading) -> None:
        if self._origin is None:
            self._origin = (reading.left_total, reading.right_total)
        stamp = reading.stamp + self._offset
        left, right = self._parameters.metres_per_tick.tolist()
        paths = (
            (reading.left_total - self._origin[0]) * left,
            (reading.right_total - self._origin[1]) * right,
        )
        gap, lost = False, (0.0, 0.0)
        if self._rows:
            recent = list(self._rows)[-(USUAL_OF + 1) :]
            gap = bool(gaps(np.array([*(row[0] for row in recent), stamp]))[-1])
            if reading.reset:
                lost = self._lost(stamp)
            if gap:
                last = self._rows[-1]
                step = np.subtract(paths, last[1:3])
                lost = (lost[0] + gap_doubt(step, (stamp - last[0]) / 1e9), lost[1])
        self._rows.append((stamp, *paths, gap, *lost))
        self._counts["ticks"] += 1
        self._counts["tick_gaps"] += gap
        self._counts["ticks_resets"] += reading.reset

    def _lost(self, stamp: int) -> tuple[float, float]:
        track = self._track()
        seconds = (stamp - int(track.stamps[-1])) / 1e9
        return lost_motion(track.stamps, track.paths, seconds, self._parameters, self._settings)

    def _track(self) -> TickTrack:
        rows = list(self._rows)
        return TickTrack(
            np.array([row[0] for row in rows], np.int64),
            np.array([row[1:3] for row in rows]),
            np.array([row[3] for row in rows[1:]], bool),
            np.array([row[4:6] for row in rows[1:]]).reshape(-1, 2),
        )

    def _forget(self, stamp: int) -> None:
        """Drop what neither a motion from here on nor the judgement of a gap needs."""
        while len(self._rows) > USUAL_OF + 2 and self._rows[1][0] < stamp - 2 * RECENT_NS:
            self._rows.popleft()
