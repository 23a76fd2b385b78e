"""MapSaver: a thread that writes the map and the path so far, each file replaced whole."""

from __future__ import annotations

import shutil
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mapping.grid import OccupancyGrid
from pipeline.folders import replace_files
from pipeline.live.events import MapEvent, OnMap
from pipeline.map_files import write_map_server, write_npz
from pipeline.places import run_places, write_places
from pipeline.trajectory import Trajectory, write_tum

if TYPE_CHECKING:
    from pipeline.run import MapRun


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A map and the path at one moment; ready: when it was taken [monotonic s]; particles: (N, 3)
    poses when the last local map closed, the best one's first; places: as `places.located`."""

    grid: OccupancyGrid
    trajectory: Trajectory
    local_maps: int
    ready: float
    particles: np.ndarray
    places: list[dict[str, Any]]

    @staticmethod
    def of(run: MapRun) -> Snapshot:
        """What a run knows now; in the thread that maps."""
        mapper, ready = run.mapper, time.monotonic()
        path = mapper.path()
        places = run_places(run, path)
        trajectory = Trajectory(np.array(mapper.stamps, np.int64), path)
        filter_ = mapper.filter
        particles = np.roll(filter_.poses, -filter_.best, axis=0)
        return Snapshot(mapper.grid(), trajectory, len(filter_.health), ready, particles, places)


class MapSaver:
    """Writes the latest snapshot into `folder`; one that came too late for the disk is passed over.

    latencies: from a snapshot to its files [s]. error: why the last one could not be written.
    """

    def __init__(self, folder: Path, on_map: OnMap) -> None:
        self.folder = folder
        self.latencies: list[float] = []
        self.error: str | None = None
        self._on_map = on_map
        self._latest: Snapshot | None = None
        self._news = threading.Condition()
        self._stop = False
        self._thread = threading.Thread(target=self._run, name="map saver", daemon=True)
        self._thread.start()

    def offer(self, snapshot: Snapshot) -> None:
        """Have it written; never waits."""
        with self._news:
            self._latest = snapshot
            self._news.notify_all()

    def close(self) -> None:
        """Write what is waiting and end."""
        with self._news:
            self._stop = True
            self._news.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._latest is not None or self._stop)
                snapshot, self._latest = self._latest, None
            if snapshot is None:
                return
            try:
                self._write(snapshot)
                self.error = None
            except OSError as error:
                self.error = f"{self.folder}: the map could not be saved ({error.strerror})"

    def _write(self, snapshot: Snapshot) -> None:
        partial = self.folder / ".saving"
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        write_map_server(partial, snapshot.grid)
        write_npz(partial / "map.npz", snapshot.grid)
        write_tum(partial / "trajectory.tum", snapshot.trajectory)
        write_places(partial, snapshot.places)
        replace_files(partial, self.folder, "map.yaml")
        latency = time.monotonic() - snapshot.ready
        self.latencies.append(latency)
        stamps = snapshot.trajectory.stamps
        stamp = int(stamps[-1]) if len(stamps) else 0
        self._on_map(MapEvent(stamp, self.folder / "map.yaml", snapshot.local_maps, latency))
