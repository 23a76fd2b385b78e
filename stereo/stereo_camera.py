"""StereoCamera: the cameras of a rig as one source of pairs, with what went wrong counted.

with StereoCamera(settings) as camera:
    while pair := camera.read(timeout=1.0):
        ...
"""

from __future__ import annotations

import threading
import time
from collections import deque
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from stereo.camera import Camera, CapturedPair, Frame, open_camera
from stereo.camera_feed import CameraFeed
from stereo.camera_settings import CameraSettings
from stereo.errors import CameraError
from stereo.frame_pairing import FramePairing

WAITING = 64  # pairs kept for a reader that is late; the oldest go first
SKEWS = 1000  # of the latest pairs, that the measured skew is about


@dataclass(frozen=True)
class CameraReport:
    """What a stereo camera did so far.

    counts: per camera, as in `CameraFeed`; pairs; lonely: frames without a partner; late: pairs
    given up because nobody read them; backwards: pairs given up because they are stamped no later
    than the one before; skew_ms: (median, 95 % of the sizes) right minus left.
    """

    counts: dict[str, dict[str, int]]
    pairs: int
    lonely: int
    late: int
    backwards: int
    skew_ms: tuple[float, float]


class StereoCamera:
    """Each camera is read in a thread of its own; frames are paired by their stamps.

    A camera lost while running is connected again; one that cannot be opened at the start is an
    error.

    newest: the last pair that came, whether it was read or not.
    """

    def __init__(self, settings: CameraSettings) -> None:
        self.settings = settings
        self.newest: CapturedPair | None = None
        self._pairing = FramePairing(settings.skew_limit, settings.one_host)
        self._pairs: deque[CapturedPair] = deque()
        self._news = threading.Condition()
        self._events: list[tuple[int, str]] = []
        self._skews: deque[int] = deque(maxlen=SKEWS)
        self._count = self._late = self._backwards = 0
        self._ended = False
        self._last = -1
        self._feeds: list[CameraFeed] = []

    def connect(self) -> None:
        """Open all cameras, then start reading them together.

        Raises:
            CameraError: one cannot be opened; the message says what became of the other.
        """
        opened: dict[str, Camera] = {}
        failed: dict[str, CameraError] = {}
        size = self.settings.size
        for name, address in self.settings.addresses.items():
            both = size and (2 * size[0], size[1]) if name == "stereo" else size
            camera = open_camera(address, both, self.settings.fps, self.settings.exposure)
            try:
                camera.connect()
                opened[name] = camera
            except CameraError as error:
                failed[name] = error
        if failed:
            for camera in opened.values():
                camera.close()
            (name, error) = next(iter(failed.items()))
            if opened:
                (other,) = opened
                raise CameraError(f"only the {other} camera was found; {name} camera: {error}")
            raise CameraError(f"{name} camera: {error}")
        for name, camera in opened.items():
            feed = CameraFeed(name, camera, self.settings.period, self._deliver, self._tell)
            self._feeds.append(feed)
        for feed in self._feeds:
            feed.start()

    def end(self) -> None:
        """Take no more frames, at once; pairs that wait may still be read. `close` still must."""
        with self._news:
            self._ended = True
            self._news.notify_all()

    def close(self) -> None:
        """Stop reading and release all cameras; pairs read before may still be taken."""
        with ExitStack() as stack:
            for feed in self._feeds:
                stack.callback(feed.stop)
        with self._news:
            self._news.notify_all()

    def __enter__(self) -> StereoCamera:
        self.connect()
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def read(self, timeout: float) -> CapturedPair | None:
        """The next pair; None when `timeout` seconds passed without one."""
        with self._news:
            self._news.wait_for(lambda: self._pairs or self._ended, timeout)
            return self._pairs.popleft() if self._pairs else None

    def events(self) -> list[tuple[int, str]]:
        """What happened since the last call: (monotonic ns, in words)."""
        with self._news:
            events, self._events = self._events, []
        return events

    def silence(self) -> float:
        """How long the more silent camera has sent nothing [s]."""
        now = time.monotonic_ns()
        return max((feed.silence(now) for feed in self._feeds), default=0) / 1e9

    def report(self) -> CameraReport:
        """Counts and skew so far."""
        skews = np.array(self._skews, float) / 1e6
        skew = (np.median(skews), np.quantile(np.abs(skews), 0.95)) if len(skews) else (0.0, 0.0)
        return CameraReport(
            {feed.name: dict(feed.counts) for feed in self._feeds},
            self._count,
            self._pairing.lonely,
            self._late,
            self._backwards,
            (float(skew[0]), float(skew[1])),
        )

    def _deliver(self, name: str, frame: Frame) -> None:
        if self._ended:
            return
        stereo = name == "stereo"
        pairs = [CapturedPair(frame, None)] if stereo else self._pairing.add(name, frame)
        with self._news:
            for pair in pairs:
                if pair.stamp <= self._last:  # a clock that turned back makes no second past
                    self._backwards += 1
                    if self._backwards == 1:
                        now = time.monotonic_ns()
                        self._events.append(
                            (
                                now,
                                "pairs that are stamped no later than the one "
                                "before are left out: the cameras' clock turned back",
                            )
                        )
                    continue
                self._last = pair.stamp
                self._count += 1
                self._skews.append(pair.skew)
                self._pairs.append(pair)
                self.newest = pair
                if len(self._pairs) > WAITING:
                    self._pairs.popleft()
                    self._late += 1
            self._news.notify_all()

    def _tell(self, text: str) -> None:
        with self._news:
            self._events.append((time.monotonic_ns(), text))
