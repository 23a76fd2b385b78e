"""A run shown on one time line: made again where its recording is at hand, else what is kept."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import rerun as rr

from pipeline.checkpoint import NOTHING
from pipeline.frontend import Observation
from pipeline.job import Job
from pipeline.run import Interrupted, MapRun
from pipeline.run_folder import RunFolder
from pipeline.trajectory import Trajectory, read_tum
from pipeline.view import entities
from pipeline.watcher import Moment, Watcher
from stereo.ranger import StereoRanger

TIME = "time"
# So many maps are shown on the way: a map is the largest thing there is.
MAPS = 60
# Numbers of a health line that are drawn.
DRAWN = ("n_eff", "matched_share", "columns_answered")
SAME = 1e-6  # m, what a path loses in its file


class Shown(Watcher):
    """Logs into a rerun recording; times count from the first pair."""

    def __init__(self, recording: rr.RecordingStream, run: RunFolder) -> None:
        self._recording, self._run = recording, run
        self._again: MapRun | None = None
        self._depth: float | None = None  # of a disparity of one pixel [m]
        self._start = int(run.trajectory.stamps[0])
        truth = run.path / "truth.tum"
        self._truth = read_tum(truth) if truth.is_file() else None
        self._log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._log("world/robot/heading", entities.heading(), static=True)
        self._maps = 0  # local maps shown
        self._every = max(1, math.ceil(int(run.facts.get("local_maps", 0)) / MAPS))

    def folder(self) -> None:
        """What the result folder holds."""
        path = self._run.trajectory
        self._at(self._start)
        self._log("world/map", entities.grid_map(self._run.grid))
        self._log("world/path", entities.path(path.poses, entities.PATH))
        if self._run.odometry is not None:
            odometry = entities.path(self._run.odometry.poses, entities.ODOMETRY)
            self._log("world/odometry", odometry)
        self._add_truth(path)
        for stamp, pose in zip(path.stamps.tolist(), path.poses, strict=True):
            self._at(stamp)
            self._log("world/robot", entities.robot(pose))
        for row in self._health():
            self._at(int(row["stamp_ns"]))
            for name in DRAWN:
                self._log(f"plots/{name}", rr.Scalars(float(row[name])))
        self._words(int(path.stamps[-1]))

    def again(
        self, job: Job, progress: Callable[[int, int], None], interrupted: Interrupted
    ) -> float:
        """The run, made again; how far its path is from the one in the folder [m]."""
        run = job.run(progress, interrupted, NOTHING, self)
        return 0.0 if run.partial else self._finish(run)

    def begins(self, run: MapRun, ranger: StereoRanger | None) -> None:
        """The run that is shown."""
        self._again = run
        self._depth = None if ranger is None else ranger.camera.depth_factor

    def mapped(self, moment: Moment) -> None:
        """Where the robot is, what it saw, what became of it."""
        self._at(moment.stamp)
        self._log("world/robot", entities.robot(moment.pose))
        if moment.seen is not None:
            self._observed(moment.seen)
        if moment.local_maps > self._maps:
            assert self._again is not None
            self._closed(self._again)

    def _observed(self, seen: Observation) -> None:
        if seen.scan is None:
            text = rr.TextLog(f"{seen.kind}: {seen.damage}", level=rr.TextLogLevel.WARN)
            self._log("log", text)
            return
        self._log("world/robot/scan", entities.scan_points(seen.scan))
        if seen.pair is None or seen.frame is None or self._depth is None:
            return
        self._log("cameras/left", entities.picture(seen.pair.left))
        self._log("cameras/right", entities.picture(seen.pair.right))
        self._log("cameras/disparity", entities.disparity(seen.frame, self._depth))

    def _closed(self, run: MapRun) -> None:
        """A local map was closed and the filter has taken it in."""
        mapper, particles = run.mapper, run.mapper.filter
        assert mapper.latest is not None
        pose = particles.poses[particles.best]
        self._log("world/local_map", entities.local_map(mapper.latest, pose))
        self._log("world/particles", entities.particles(particles.poses))
        health = particles.health[-1]
        for name, value in zip(DRAWN, (health.n_eff, health.matched, health.answered), strict=True):
            self._log(f"plots/{name}", rr.Scalars(value))
        if self._maps % self._every == 0:
            self._log("world/map", entities.grid_map(mapper.grid(), whole=False))
            self._log("world/path", entities.path(mapper.path(), entities.PATH))
        self._maps += 1

    def _finish(self, run: MapRun) -> float:
        """The smoothed path and its map, at the end of the time line."""
        mapper = run.mapper
        stamps = np.array(mapper.stamps, np.int64)
        path, kept = mapper.path(), self._run.trajectory
        self._at(int(stamps[-1]))
        if len(mapper.filter.health) > self._maps:  # the rest of the run, which is a shorter one
            self._closed(run)
        self._log("world/map", entities.grid_map(mapper.grid()))
        self._log("world/path", entities.path(path, entities.PATH))
        odometry = np.array(mapper.odometry).reshape(-1, 3)
        self._log("world/odometry", entities.path(odometry, entities.ODOMETRY))
        self._add_truth(Trajectory(stamps, path))
        self._words(int(stamps[-1]))
        if not np.array_equal(stamps, kept.stamps):
            return math.inf
        return float(np.hypot(*(path - kept.poses)[:, :2].T).max())

    def _add_truth(self, path: Trajectory) -> None:
        if self._truth is None:
            return
        from odometry.motion import compose
        from pipeline.evaluate_path import align, match

        # Laid over the path as `evaluate path` does: its own frame is another.
        index, true = match(path, self._truth)
        if len(index) > 1:
            poses = compose(align(true, path.poses[index]), true)
            self._log("world/truth", entities.path(poses, entities.TRUTH))

    def _health(self) -> Iterator[dict[str, str]]:
        file = self._run.path / "health.csv"
        if file.is_file():
            with file.open(encoding="ascii", newline="") as table:
                yield from csv.DictReader(table)

    def _words(self, stamp: int) -> None:
        self._at(stamp)
        for line in self._run.facts.get("health", []):
            self._log("log", rr.TextLog(line, level=rr.TextLogLevel.INFO))

    def _at(self, stamp: int) -> None:
        self._recording.set_time(TIME, duration=(stamp - self._start) / 1e9)

    def _log(self, entity: str, what: rr.AsComponents, static: bool = False) -> None:
        self._recording.log(entity, what, static=static)


@contextmanager
def new_recording(run: RunFolder) -> Iterator[rr.RecordingStream]:
    """A rerun recording of that name, on one time line; flushed at the end."""
    recording = rr.RecordingStream("beemap", recording_id=run.path.resolve().name)
    rr.set_log_time_enabled(False, recording)
    rr.set_log_tick_enabled(False, recording)
    try:
        yield recording
    finally:
        recording.flush()
        recording.disconnect()


def layout(run: RunFolder) -> rr.blueprint.Blueprint:
    """The map from above, images and numbers to its right."""
    import rerun.blueprint as rrb

    images = [
        rrb.Spatial2DView(origin=f"cameras/{name}", name=name)
        for name in ("left", "right", "disparity")
    ]
    plots = [rrb.TimeSeriesView(origin=f"plots/{name}", name=name) for name in DRAWN]
    size = run.grid.cell * np.array(run.grid.probability.shape[::-1])
    x, y = run.grid.origin + size / 2.0
    above = rrb.EyeControls3D(
        position=(x, y - 0.2 * size.max(), size.max()), look_target=(x, y, 0.0), eye_up=(0, 0, 1)
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(origin="world", name="map", eye_controls=above),
            rrb.Vertical(*images, rrb.Tabs(*plots, rrb.TextLogView(origin="log", name="log"))),
            column_shares=[3, 1],
        ),
        collapse_panels=True,
    )
