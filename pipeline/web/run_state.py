"""RunState: where the threads of a run leave what its page shows.

References only, each set whole: nothing is computed, copied or waited for.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from mapping.settings import MappingSettings
from pipeline.live.events import MapEvent
from pipeline.live.map_saver import Snapshot
from pipeline.run import MapRun
from pipeline.watcher import Moment, Watcher
from stereo.camera import CapturedPair
from stereo.ranger import StereoRanger
from stereo.scan import RangeScan

MOST_NOTES = 30
WAITING, MAPPING, FINISHING, ENDED, FAILED = "waiting", "mapping", "finishing", "ended", "failed"


@dataclass(frozen=True, eq=False)
class Seen:
    """The latest observation, with the others of its local map before it.

    window: poses (3,) and scans; closed: it was the last of them.
    """

    moment: Moment
    scan: RangeScan
    window: tuple[tuple[np.ndarray, RangeScan], ...]
    closed: bool


class RunState(Watcher):
    """moment: with the time [monotonic ns] at which its picture was taken, or was shown in a
    replay; figures and checks: as of `Status`; notes: time and text; failure: why it failed."""

    def __init__(self) -> None:
        self.run: MapRun | None = None
        self.ranger: StereoRanger | None = None
        self.newest: CapturedPair | None = None
        self.moment: tuple[Moment, int] | None = None
        self.seen: Seen | None = None
        self.snapshot: Snapshot | None = None
        self.figures: dict[str, str] = {}
        self.checks: dict[str, str] = {}
        self.notes: deque[tuple[str, str]] = deque(maxlen=MOST_NOTES)
        self.phase = WAITING
        self.failure = ""
        self._wanted = threading.Event()
        self._asked = threading.Event()

    @property
    def settings(self) -> MappingSettings:
        """Of the mapper."""
        return self.run.mapper.settings if self.run else MappingSettings()

    def begins(self, run: MapRun, ranger: StereoRanger | None) -> None:
        """The run that is shown."""
        self.run, self.ranger = run, ranger

    def captured(self, pair: CapturedPair) -> None:
        """The newest pair."""
        self.newest = pair

    def mapped(self, moment: Moment) -> None:
        """The newest pose; what was observed belongs to a local map."""
        if self.phase == WAITING:
            self.phase = MAPPING
        self.moment = moment, moment.stamp if self.newest else time.monotonic_ns()
        if moment.seen is None or moment.seen.scan is None:
            return
        scan, before = moment.seen.scan, self.seen
        window = () if before is None or before.closed else before.window
        maps = before.moment.local_maps if before else 0
        window = (*window, (moment.pose, scan))
        self.seen = Seen(moment, scan, window, moment.local_maps > maps)

    def want_map(self, tell: bool) -> None:
        """Have the map taken and saved at the next step; tell: say when it is."""
        if tell:
            self._asked.set()
        self._wanted.set()

    def wants_map(self) -> bool:
        """Whether somebody asked for it."""
        wanted = self._wanted.is_set()
        self._wanted.clear()
        return wanted

    def grew(self, snapshot: Snapshot) -> None:
        """The newest map."""
        self.snapshot = snapshot

    def saved(self, event: MapEvent) -> None:
        """Told where somebody asked for it."""
        if self._asked.is_set():
            self._asked.clear()
            self.tell(f"map saved: {event.file}")

    def ended(self, run: MapRun) -> None:
        """The last map; nothing comes after it."""
        self.snapshot = Snapshot.of(run)
        self.phase = ENDED

    def failed(self, why: str) -> None:
        """The run ended by an error; what it knew until then is shown."""
        self.failure = why
        self.phase = FAILED

    def tell(self, text: str) -> None:
        """Something happened."""
        self.notes.append((datetime.now().strftime("%H:%M:%S"), text))

    def status(self, figures: dict[str, str], checks: dict[str, str]) -> None:
        """How the run goes."""
        self.figures, self.checks = figures, checks
