"""The drive of a virtual rig: a recording played by the clock once the cameras are watched."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from odometry.encoders import EncoderParameters, unwrap_counts

START_AFTER = 0.5  # s from both cameras being watched to the start
LEAVE_AFTER = 1.0  # s without any watcher: the robot is put back at the start


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """What the robot saw and its wheels counted.

    stamps: (n,) ns of the pairs; jpegs(n): left and right image of one; tick_stamps (m,) ns;
    ticks (m, 2): counters as read.
    """

    stamps: np.ndarray
    jpegs: Callable[[int], tuple[bytes, bytes]]
    tick_stamps: np.ndarray
    ticks: np.ndarray
    encoders: EncoderParameters

    @property
    def period(self) -> float:
        """Usual time between two pairs [s]."""
        return float(np.median(np.diff(self.stamps))) / 1e9 if len(self.stamps) > 1 else 0.1


class Timeline:
    """Where in the drive the robot is now.

    It stands at the start until both cameras are watched, drives `speed` times as fast as it was
    recorded, and stands at the end. When nobody watches any more it is put back at the start.
    """

    def __init__(self, drive: RecordedDrive, speed: float) -> None:
        self.drive = drive
        self.speed = speed
        self.finished = threading.Event()
        self._begin: float | None = None  # monotonic s
        self._watched: Counter[str] = Counter()
        self._left_at = 0.0
        self._lock = threading.Lock()
        bits = drive.encoders.counter_bits
        totals = [unwrap_counts(c, bits) - c[0] for c in drive.ticks.T]
        self._totals = np.stack(totals, axis=1)
        self._tick_times = (drive.tick_stamps - drive.stamps[0]) / 1e9
        self._times = (drive.stamps - drive.stamps[0]) / 1e9

    def watch(self, side: str) -> None:
        """A camera has a watcher."""
        with self._lock:
            gone = not +self._watched and time.monotonic() - self._left_at > LEAVE_AFTER
            if gone:
                self._begin = None
                self.finished.clear()
            self._watched[side] += 1
            if self._begin is None and self._watched["left"] and self._watched["right"]:
                self._begin = time.monotonic() + START_AFTER

    def leave(self, side: str) -> None:
        """A watcher has gone."""
        with self._lock:
            self._watched[side] -= 1
            self._left_at = time.monotonic()

    @property
    def waiting(self) -> bool:
        """Whether the robot still waits for its cameras to be watched."""
        return self._begin is None

    def seconds(self) -> float:
        """Time of the drive, negative before it begins [s]."""
        begin = self._begin
        return -1.0 if begin is None else (time.monotonic() - begin) * self.speed

    def pair_at(self, seconds: float) -> int:
        """Number of the latest pair that was taken by then; 0 before the start."""
        return max(0, int(np.searchsorted(self._times, seconds, side="right")) - 1)

    def time_of(self, pair: int) -> float:
        """When pair number `pair` is due [s of the drive]; after the last they go on as before."""
        last = len(self._times) - 1
        return float(self._times[min(pair, last)]) + max(0, pair - last) * self.drive.period

    def clock(self, seconds: float) -> float:
        """That time of the drive by the machine's monotonic clock [s]; now, before it begins."""
        begin = self._begin
        return time.monotonic() if begin is None else begin + seconds / self.speed

    def until(self, seconds: float) -> float:
        """How long it takes to that time of the drive by the clock [s]."""
        return (seconds - self.seconds()) / self.speed

    def counts(self, seconds: float) -> np.ndarray:
        """(2,) int64 counts since the start of the drive, not wrapping."""
        before = np.array([np.interp(seconds, self._tick_times, c) for c in self._totals.T])
        return np.floor(before).astype(np.int64)
