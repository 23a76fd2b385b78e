"""LiveMapper: a thread that maps the pairs as they come, and skips some when it is too slow."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from calibration.rig import StereoRig
from mapping.known_map import KnownMap
from mapping.mapper import HierarchicalMapper
from pipeline.checkpoint import Observations
from pipeline.errors import InputError
from pipeline.frontend import IMAGE_ERRORS, observe
from pipeline.live.events import OnPose, PoseEvent
from pipeline.live.map_saver import MapSaver, Snapshot
from pipeline.motion_told import told
from pipeline.recordings.base import Pair
from pipeline.run import MapRun, Stepper, make_ranger, show, take
from pipeline.seeing import AnyMotion, move
from pipeline.settings import Settings
from pipeline.watcher import NOBODY, Watcher
from stereo.camera import CapturedPair

# Pairs that wait; when one more comes the oldest is skipped: a late pose is of little use.
WAITING = 32
LOOKS = 3  # pairs looked at for exchanged cameras

Tell = Callable[[str], None]


class LiveMapper:
    """Maps pairs in a thread of its own.

    motion: looked at in this thread, too, where it looks at the images.
    run: as of a recording. skipped: pairs given up because mapping was late. error: what ended it.
    latencies: from an image to its pose [s].
    """

    def __init__(
        self,
        rig: StereoRig,
        motion: AnyMotion,
        settings: Settings,
        seed: int,
        known: Observations,
        saver: MapSaver,
        on_pose: OnPose,
        tell: Tell,
        begin: KnownMap | None = None,
        watcher: Watcher = NOBODY,
    ) -> None:
        self.mapper = HierarchicalMapper(settings.mapping, seed, begin)
        self.run = MapRun(self.mapper)
        self.skipped = 0
        self.error: Exception | None = None
        self.latencies: list[float] = []
        self._rig = rig
        self._ranger = make_ranger(rig, settings)
        self._motion = motion
        self._stepper = Stepper(self.mapper.gate)
        self._known = known
        self._saver = saver
        self._on_pose = on_pose
        self._tell = tell
        self._watcher = watcher
        self._looks: list[bool] = []
        self._first: int | None = None
        self._pairs: deque[CapturedPair] = deque()
        self._news = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._loop, name="mapping", daemon=True)

    def start(self) -> None:
        """Begin to map."""
        self._watcher.begins(self.run, self._ranger)
        self._thread.start()

    def offer(self, pair: CapturedPair) -> None:
        """Take a pair; never waits."""
        with self._news:
            self._pairs.append(pair)
            late = self._pairs.popleft() if len(self._pairs) > WAITING else None
            self._news.notify_all()
        if late is not None:
            self.skipped += 1
            self._tell(f"mapping is late: pair {late.name} skipped")

    @property
    def backlog(self) -> int:
        """Pairs that wait to be mapped."""
        return len(self._pairs)

    def finish(self) -> MapRun:
        """Map what is waiting, end the thread and finish the map."""
        with self._news:
            self._ended = True
            self._news.notify_all()
        self._thread.join()
        begin = time.perf_counter()
        self.mapper.finish()
        self.run.seconds["mapping"] += time.perf_counter() - begin
        self.run.told = told(self._motion, self._first or 0)
        return self.run

    def _loop(self) -> None:
        try:
            while True:
                with self._news:
                    self._news.wait_for(lambda: self._pairs or self._ended)
                    if not self._pairs:
                        return
                    pair = self._pairs.popleft()
                self._map(pair)
        except Exception as error:
            self.error = error

    def _map(self, captured: CapturedPair) -> None:
        local_maps = len(self.mapper.filter.health)
        pair, motion = move(captured, self._motion)
        self._first = self._first or pair.stamp
        step = self._stepper.step(pair, motion)
        seen = None
        if step.due:
            self._check(pair)
            seen = observe(pair, self._ranger, step.key_frame, keep=self._watcher is not NOBODY)
            self._known.add(pair.stamp, seen)
        begin = time.perf_counter()
        take(step, seen, self.run)
        self.run.seconds["mapping"] += time.perf_counter() - begin
        if step.motion is None:
            return
        latency = (time.monotonic_ns() - pair.stamp) / 1e9
        self.latencies.append(latency)
        self._on_pose(PoseEvent(pair.stamp, self.mapper.pose, latency, step.due))
        show(step, seen, self.run, self._watcher)
        if len(self.mapper.filter.health) > local_maps or self._watcher.wants_map():
            snapshot = Snapshot.of(self.run)
            self._saver.offer(snapshot)
            self._watcher.grew(snapshot)

    def _check(self, pair: Pair) -> None:
        """Refuse images that the rig does not fit, or that are exchanged, at the first looks."""
        if len(self._looks) >= LOOKS:
            return
        try:
            loaded = pair.load()
        except IMAGE_ERRORS:
            return  # damaged: counted when it is observed
        height, width = loaded.left.shape[:2]
        if (width, height) != tuple(self._rig.image_size):
            raise InputError(
                f"the cameras send images of {width}x{height}, the rig is calibrated for "
                f"{self._rig.image_size[0]}x{self._rig.image_size[1]}: set devices.size, or "
                "calibrate at this size"
            )
        self._looks.append(self._ranger.looks_swapped(loaded))
        if len(self._looks) == LOOKS and 2 * sum(self._looks) > LOOKS:
            raise InputError(
                "left and right images are exchanged (the disparities are negative): exchange "
                "left and right under devices"
            )
