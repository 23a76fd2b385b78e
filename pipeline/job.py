"""What `beemap map` is asked to do, made ready to run: a recording, or a scan log."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from calibration.rig import StereoRig
from mapping.gate import gate_of
from mapping.known_map import KnownMap
from odometry.motion import Motion
from odometry.walk import LEAP, leaps
from pipeline.checkpoint import Observations
from pipeline.input_check import check_input
from pipeline.motion import motion_of, usual_motion
from pipeline.recordings.base import Recording
from pipeline.recordings.scan_log import ODDITIES, USUAL, ScanLog
from pipeline.rig import choose_rig
from pipeline.run import (
    Interrupted,
    MapRun,
    Progress,
    look,
    make_ranger,
    map_recording,
)
from pipeline.run_log import look_at_log, map_log
from pipeline.run_report.origin import Origin
from pipeline.settings import Settings
from pipeline.trajectory import Trajectory, read_tum
from pipeline.watcher import NOBODY, Watcher
from stereo.scan import RangeScan


class Run(Protocol):
    """Makes the run; see `map_recording`."""

    def __call__(
        self,
        progress: Progress,
        interrupted: Interrupted,
        known: Observations,
        watcher: Watcher = NOBODY,
    ) -> MapRun: ...


class Look(NamedTuple):
    """A pair or scan: how the robot came there (None: not known), and the scan where it is due."""

    stamp: int
    motion: Motion | None
    scan: RangeScan | None


@dataclass(frozen=True)
class Job:
    """A run to be made.

    unit: what the input consists of; opened: that input; rig: with which it is read, None for
    logs; notes: what the user must hear before; skipped: what was passed over when the input was
    opened; facts(): what run.json says of it, asked afterwards; looks(): all that the mapper
    would be given, without mapping; run and looks use the motion up: one of them, once;
    chosen: settings that nobody set, with value and reason.
    """

    unit: str
    opened: Recording | ScanLog
    rig: StereoRig | None
    run: Run
    looks: Callable[[], Iterator[Look]]
    facts: Callable[[], dict[str, Any]]
    notes: list[str]
    skipped: dict[str, list[str]]
    truth: Trajectory | None
    chosen: dict[str, str] = field(default_factory=dict)


def recording_job(
    recording: Recording,
    rig_file: Path | None,
    motion: str | None,
    settings: Settings,
    seed: int,
    threads: int,
    begin: KnownMap | None = None,
    origin: Origin | None = None,
    unchecked: bool = False,
) -> Job:
    """A recording with the rig and the motion that the user chose; None: what it holds.

    origin, unchecked: as of `check_input`.

    Raises:
        InputError, RigError: rig or motion are missing or wrong, or the images do not fit the rig.
    """
    rig, notes = choose_rig(recording, rig_file)
    checked = check_input(recording, rig, origin or Origin.unknown(Path("run")), unchecked)
    rig = checked.rig
    if motion is None:
        motion, more = usual_motion(recording, rig, settings.odometry)
        notes += more
    source = motion_of(motion, recording, rig, settings, seed)

    def run(
        progress: Progress,
        interrupted: Interrupted,
        known: Observations,
        watcher: Watcher = NOBODY,
    ) -> MapRun:
        done = (progress, interrupted, known, begin, watcher)
        made = map_recording(recording, rig, source, settings, seed, threads, *done)
        made.told = [*checked.findings, *made.told]
        return made

    def looks() -> Iterator[Look]:
        ranger = make_ranger(rig, settings)
        for step, seen in look(recording, ranger, gate_of(settings.mapping), source, threads):
            yield Look(step.pair.stamp, step.motion, None if seen is None else seen.scan)

    def facts() -> dict[str, Any]:
        return {
            "format": recording.kind,
            "motion": motion,
            "rig": str(rig_file) if rig_file else recording.rig_source,
            "odometry": source.report(),
        }

    return Job(
        "pairs", recording, rig, run, looks, facts, notes, recording.skipped, recording.poses
    )


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
        del known  # a log is read faster than a checkpoint
        return map_log(log, settings, seed, progress, interrupted, begin, watcher)

    def looks() -> Iterator[Look]:
        for motion, scan in look_at_log(log, gate_of(settings.mapping), settings):
            yield Look(motion.last, motion, scan)

    truth = read_tum(log.truth_file) if log.truth_file else None
    return Job("scans", log, None, run, looks, facts, notes, log.skipped, truth)


def _told(stages: dict[str, dict[str, Any]]) -> str:
    """As in `odometry.along 0.03, mapping.spread False`."""
    return ", ".join(
        f"{stage}.{key} {value:g}" if isinstance(value, float) else f"{stage}.{key} {value}"
        for stage, values in stages.items()
        for key, value in values.items()
    )
