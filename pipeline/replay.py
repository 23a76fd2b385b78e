"""A run made again at the pace at which it was recorded, for somebody who watches."""

from __future__ import annotations

import threading
import time

from pipeline.job import Job
from pipeline.live.map_saver import MapSaver, Snapshot
from pipeline.live.status import mapping_checks, mapping_figures
from pipeline.recordings.base import Recording
from pipeline.run import MapRun
from pipeline.watcher import Moment, Watcher
from pipeline.web.run_state import RunState
from stereo.ranger import StereoRanger

STATUS_EVERY = 1.0  # s


class Paced(Watcher):
    """Shows a run to `state` at `speed` times the pace of its stamps; a run that is slower than
    that is not held up.

    total: how many pairs or scans there are; stop: nothing is waited for once it is set; saver:
    where the map is written as it grows.
    """

    def __init__(
        self,
        state: RunState,
        speed: float,
        total: int,
        stop: threading.Event,
        saver: MapSaver | None,
    ) -> None:
        self._state = state
        self._speed = speed
        self._total = total
        self._stop = stop
        self._saver = saver
        self._run: MapRun | None = None
        self._begin: tuple[int, float] | None = None
        self._told = (0.0, 0)  # when the status was, and how many pairs then
        self._maps = self._count = 0

    def begins(self, run: MapRun, ranger: StereoRanger | None) -> None:
        """Hand on."""
        self._run = run
        self._state.begins(run, ranger)

    def mapped(self, moment: Moment) -> None:
        """Wait until it is time, and hand on."""
        now = time.monotonic()
        if self._begin is None:
            self._begin = moment.stamp, now
            self._told = now, 0
        first, begin = self._begin
        due = begin + (moment.stamp - first) / 1e9 / self._speed
        if due > now:
            self._stop.wait(due - now)
        self._count += 1
        self._state.mapped(moment)
        self._show_map(moment)
        self._show_status((moment.stamp - first) / 1e9)

    def _show_map(self, moment: Moment) -> None:
        run = self._run
        assert run is not None
        if moment.local_maps > self._maps or self._state.wants_map():
            self._maps = moment.local_maps
            snapshot = Snapshot.of(run)
            self._state.grew(snapshot)
            if self._saver is not None:
                self._saver.offer(snapshot)

    def _show_status(self, played: float) -> None:
        before, count = self._told
        now = time.monotonic()
        if now - before < STATUS_EVERY and self._count > 1:
            return
        run, state = self._run, self._state
        assert run is not None
        rate = (self._count - count) / max(now - before, STATUS_EVERY)
        self._told = now, self._count
        figures = {
            f"{run.unit} a second": f"{rate:.1f}",
            f"{run.unit} played": f"{self._count} of {self._total}",
            "recorded time": f"{played:.0f} s, {self._speed:g} x",
        }
        state.status(figures | mapping_figures(run.mapper), mapping_checks(run.mapper))


def count(job: Job) -> int:
    """Pairs or scans of a job."""
    opened = job.opened
    return len(opened.pairs) if isinstance(opened, Recording) else len(opened)
