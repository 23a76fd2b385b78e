"""CameraFeed: a camera read in a thread of its own, connected again whenever it is lost."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from statistics import median

from stereo.camera import Camera, Frame
from stereo.errors import CameraError

FIRST_WAIT, LONGEST_WAIT = 0.1, 5.0  # s between attempts to connect
# An interval so many periods long is a stall, if it is also longer than this [ns].
STALL_PERIODS, STALL_NS = 4.0, 500_000_000
# A driver that hangs is left to its thread after this [s]: it must not hold up what is saved.
JOIN_S = 15.0
LATE_PERIODS = 1.5  # a longer interval has lost frames, unless the next ones catch up
KNOWN = 30  # intervals that tell the camera's period

Deliver = Callable[[str, Frame], None]
Tell = Callable[[str], None]


class CameraFeed:
    """Reads one camera until it is stopped.

    counts: frames; dropped (by gaps in the stamps); stalls; lost (connections); garbage: bytes
    that belonged to no image.
    deliver(name, frame) and tell(what happened) are called from the feed's thread.
    """

    def __init__(
        self, name: str, camera: Camera, period: int, deliver: Deliver, tell: Tell
    ) -> None:
        self.name = name
        self.counts: Counter[str] = Counter(frames=0, dropped=0, stalls=0, lost=0, garbage=0)
        self._camera = camera
        self._deliver = deliver
        self._tell = tell
        self._intervals: deque[int] = deque([period], maxlen=KNOWN)
        self._last: int | None = None
        self._late = 0  # the interval before, where it was long [ns]
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Read the camera, which is connected."""
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, name=f"camera {self.name}", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop reading; the thread that reads closes the camera, then ends."""
        self._stop.set()
        if self._thread is None:
            self._camera.close()
            return
        self._camera.interrupt()
        self._thread.join(JOIN_S)
        if self._thread.is_alive():
            self._tell(f"{self.name} camera: its driver hangs: left open")
        self._thread = None

    @property
    def period(self) -> float:
        """The usual time between two frames [ns]."""
        return median(self._intervals)

    def silence(self, now: int) -> int:
        """How long nothing has come [ns]; 0 before the first frame."""
        return 0 if self._last is None else now - self._last

    def _run(self) -> None:
        try:
            self._read()
        finally:
            self._camera.close()

    def _read(self) -> None:
        while not self._stop.is_set():
            try:
                while not self._stop.is_set():
                    frame = self._camera.read()
                    self._count(frame.stamp)
                    self.counts["garbage"] = self._camera.garbage
                    self._deliver(self.name, frame)
            except CameraError as error:
                if self._stop.is_set():
                    break
                self.counts["lost"] += 1
                self._tell(f"{self.name} camera lost: {error}")
                self._reconnect()

    def _reconnect(self) -> None:
        """Try again and again, ever more slowly, until it works or the feed is stopped."""
        self._camera.close()
        wait, begin = FIRST_WAIT, time.monotonic()
        while not self._stop.wait(wait):
            try:
                self._camera.connect()
            except CameraError:
                wait = min(2.0 * wait, LONGEST_WAIT)
                continue
            self._tell(f"{self.name} camera is back after {time.monotonic() - begin:.1f} s")
            return

    def _count(self, stamp: int) -> None:
        self.counts["frames"] += 1
        last, self._last = self._last, stamp
        if last is None:
            return
        interval, period, late = stamp - last, self.period, self._late
        self._late = 0
        if interval > max(STALL_PERIODS * period, STALL_NS):
            self.counts["stalls"] += 1
            self.counts["dropped"] += max(0, round(interval / period) - 1)
            self._tell(f"{self.name} camera stalled for {interval / 1e9:.1f} s")
            return
        if late and late + interval > (LATE_PERIODS + 1.0) * period:
            self.counts["dropped"] += round((late + interval) / period) - 2
        elif interval > LATE_PERIODS * period:
            self._late = interval
        self._intervals.append(interval)
