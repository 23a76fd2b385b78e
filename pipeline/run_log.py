"""The main job for scan logs: they enter after the stereo stage."""

from __future__ import annotations

from mapping.known_map import KnownMap
from mapping.mapper import HierarchicalMapper
from odometry.walk import walk
from pipeline.frontend import Observation
from pipeline.recordings.scan_log import ScanLog
from pipeline.run import Interrupted, MapRun, Progress
from pipeline.settings import Settings
from pipeline.watcher import NOBODY, Moment, Watcher


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
    watcher: who looks on.

    Every scan gets a pose, in the order of the file; those that the gate lets through are seen
    by the mapper.
    """
    mapper = HierarchicalMapper(settings.mapping, seed, begin)
    run = MapRun(mapper, unit="scans", key_frames=None)
    scans = log.taken(settings.laser, settings.mapping.max_range)
    watcher.begins(run, None)
    motions = enumerate(walk(log.stamps, log.odometry, settings.odometry))
    for index, motion in run.each(motions, len(log), progress, interrupted):
        due = mapper.gate.step(motion.increment)
        mapper.move(motion)
        run.counts["scans used"] += 1
        seen = Observation(scans[index]) if due else None
        if seen is not None and seen.scan is not None:
            run.counts["observations"] += 1
            mapper.observe(seen.scan)
        maps = len(mapper.filter.health)
        watcher.mapped(Moment(motion.last, None, seen, mapper.pose, maps))
    mapper.finish()
    return run
