"""The main job for scan logs: they enter after the stereo stage."""

from __future__ import annotations

from collections.abc import Iterator

from mapping.gate import ObservationGate
from mapping.known_map import KnownMap
from mapping.mapper import HierarchicalMapper
from odometry.motion import Motion
from odometry.walk import walk
from pipeline.frontend import Observation
from pipeline.recordings.scan_log import ScanLog
from pipeline.run import Interrupted, MapRun, Progress
from pipeline.settings import Settings
from pipeline.watcher import NOBODY, Moment, Watcher
from stereo.scan import RangeScan


def map_log(
    log: ScanLog,
    settings: Settings,
    seed: int = 0,
    progress: Progress = lambda done, total: None,
    interrupted: Interrupted = lambda: False,
    begin: KnownMap | None = None,
    watcher: Watcher = NOBODY,
) -> MapRun:
    """Map a scan log; `progress` and `interrupted` as in `MapRun.each`; begin: a map to go on in;
    watcher: is shown how the run goes.

    Every scan gets a pose, in the order of the file; those that the gate lets through are seen
    by the mapper.
    """
    mapper = HierarchicalMapper(settings.mapping, seed, begin)
    run = MapRun(mapper, unit="scans", key_frames=None)
    watcher.begins(run, None)
    looks = look_at_log(log, mapper.gate, settings)
    for motion, scan in run.each(looks, len(log), progress, interrupted):
        mapper.move(motion)
        run.counts["scans used"] += 1
        if scan is not None:
            run.counts["observations"] += 1
            mapper.observe(scan)
        seen = None if scan is None else Observation(scan)
        maps = len(mapper.filter.health)
        watcher.mapped(Moment(motion.last, None, seen, mapper.pose, maps))
    mapper.finish()
    return run


def look_at_log(
    log: ScanLog, gate: ObservationGate, settings: Settings
) -> Iterator[tuple[Motion, RangeScan | None]]:
    """The motion to each scan, and the scan where it is due: all that a mapper is given."""
    scans = log.taken(settings.laser, settings.mapping.max_range)
    motions = walk(log.stamps, log.odometry, settings.odometry)
    for index, motion in enumerate(motions):
        yield motion, scans[index] if gate.step(motion.increment) else None
