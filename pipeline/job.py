"""What `beemap map` is asked to do, made ready to run: a recording, or a scan log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from mapping.known_map import KnownMap
from odometry.walk import LEAP, leaps
from pipeline.checkpoint import Observations
from pipeline.motion import motion_of, usual_motion
from pipeline.recordings.base import Recording
from pipeline.recordings.scan_log import ODDITIES, USUAL, ScanLog
from pipeline.rig import choose_rig
from pipeline.run import Interrupted, MapRun, Progress, map_recording
from pipeline.run_log import map_log
from pipeline.settings import Settings
from pipeline.trajectory import Trajectory, read_tum
from pipeline.watcher import NOBODY, Watcher


class Mapping(Protocol):
    """Does the work; see `map_recording`."""

    def __call__(
        self,
        progress: Progress,
        interrupted: Interrupted,
        known: Observations,
        watcher: Watcher = NOBODY,
    ) -> MapRun: ...


@dataclass(frozen=True)
class Job:
    """A run to be made.

    unit: what the input consists of; total: how many of them; notes: what the user must hear
    before; skipped: what was passed over when the input was opened; facts(): what run.json says of
    it, asked afterwards.
    """

    unit: str
    total: int
    run: Mapping
    facts: Callable[[], dict[str, Any]]
    notes: list[str]
    skipped: dict[str, list[str]]
    truth: Trajectory | None


def recording_job(
    recording: Recording,
    rig_file: Path | None,
    motion: str | None,
    settings: Settings,
    seed: int,
    threads: int,
    begin: KnownMap | None = None,
) -> Job:
    """A recording with the rig and the motion that the user chose; None: what it holds.

    Raises:
        InputError, RigError: rig or motion are missing or wrong.
    """
    rig, notes = choose_rig(recording, rig_file)
    if motion is None:
        motion, more = usual_motion(recording)
        notes += more
    source = motion_of(motion, recording, rig, settings, seed)

    def run(
        progress: Progress,
        interrupted: Interrupted,
        known: Observations,
        watcher: Watcher = NOBODY,
    ) -> MapRun:
        how = (settings, seed, threads, progress, interrupted, known, begin, watcher)
        return map_recording(recording, rig, source, *how)

    def facts() -> dict[str, Any]:
        return {
            "format": recording.kind,
            "motion": motion,
            "rig": str(rig_file) if rig_file else recording.rig_source,
            "odometry": source.report(),
        }

    return Job("pairs", len(recording.pairs), run, facts, notes, recording.skipped, recording.poses)


def log_job(log: ScanLog, settings: Settings, seed: int, begin: KnownMap | None = None) -> Job:
    """A scan log, with the truth that lies beside it.

    Raises:
        InputError: that truth cannot be read.
    """
    notes = []
    if log.suggested:
        notes.append("the log says of itself: " + _told(log.suggested))
    assumed = {
        stage: {k: v for k, v in values.items() if k not in log.suggested.get(stage, {})}
        for stage, values in USUAL.items()
    }
    if any(assumed.values()):
        notes.append("usual for a laser, unless set: " + _told(assumed))
    odd = [f"{log.counts[what]} {what}" for what in ODDITIES if log.counts[what]]
    if odd:
        notes.append(f"{', '.join(odd)}: scans are taken as they stand, in the file's order")
    if leaped := int(leaps(log.odometry).sum()):
        notes.append(f"{leaped} leaps of odometry over {LEAP:g} m: taken as standing still")

    def facts() -> dict[str, Any]:
        return {
            "format": log.kind,
            "log": dict(log.counts),
            "suggested": log.suggested,
            "truth": str(log.truth_file) if log.truth_file else None,
        }

    def run(
        progress: Progress,
        interrupted: Interrupted,
        known: Observations,
        watcher: Watcher = NOBODY,
    ) -> MapRun:
        del known  # scans are read quickly
        return map_log(log, settings, seed, progress, interrupted, begin, watcher)

    truth = read_tum(log.truth_file) if log.truth_file else None
    return Job("scans", len(log), run, facts, notes, log.skipped, truth)


def _told(stages: dict[str, dict[str, Any]]) -> str:
    """As in `odometry.along 0.03, mapping.spread False`."""
    return ", ".join(
        f"{stage}.{key} {value:g}" if isinstance(value, float) else f"{stage}.{key} {value}"
        for stage, values in stages.items()
        for key, value in values.items()
    )
