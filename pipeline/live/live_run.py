"""A live run: capture, recording, mapping and saving, each in a thread of its own.

    run = live_run(load_live_rig(path), output, settings, on_pose=drive, on_map=plan, stop=event)

Policy. Recording never waits for mapping. Mapping that is late skips the oldest waiting pair, and
counts it. A disk that is late loses pairs, for the map too, and counts them: the recording holds
all that the map was made from, so that mapping it offline gives the same map when no pair was
skipped.
"""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from calibration.rig import StereoRig
from mapping.known_map import KnownMap
from odometry.live import LiveOdometry
from pipeline.checkpoint import NOTHING, Observations
from pipeline.errors import InputError
from pipeline.fitting import with_body
from pipeline.folders import forget_earlier, put_back, replace_files, set_aside
from pipeline.live.capture import Session, capture
from pipeline.live.devices import LiveRig
from pipeline.live.events import MapEvent, OnMap, OnPose
from pipeline.live.map_saver import MapSaver
from pipeline.live.mapping_thread import LiveMapper
from pipeline.live.status import Status
from pipeline.live.warm_up import warm_up
from pipeline.motion import LOOKING, looking
from pipeline.output_lock import unmake
from pipeline.recordings import open_recording
from pipeline.results import write_results
from pipeline.rig import NO_MOUNT
from pipeline.run import MapRun
from pipeline.run_report.origin import Origin
from pipeline.seeing import AnyMotion
from pipeline.settings import Settings
from pipeline.trajectory import Trajectory
from pipeline.watcher import NOBODY, Watcher

STATUS_EVERY = 1.0  # s
TICK = 0.05  # s between looks at what the threads do


@dataclass
class LiveOptions:
    """settings, seed: as of `map`; duration: ends by itself after so many seconds; stop: ends it
    when set; opened: called when all devices are open, before anything is taken; it returns where
    observations are kept for `--resume`; facts: for run.json; begin: a map to go on in; places:
    those marked in it; motion: "encoders", "visual" or "fused"; watcher: who looks on."""

    settings: Settings
    seed: int = 1
    duration: float | None = None
    stop: threading.Event = field(default_factory=threading.Event)
    opened: Callable[[], Observations] = lambda: NOTHING
    facts: dict[str, Any] = field(default_factory=dict)
    begin: KnownMap | None = None
    places: list[dict[str, Any]] = field(default_factory=list)
    motion: str = "fused"
    watcher: Watcher = NOBODY


def _ignore(*_: object) -> None:
    """For events that nobody wants."""


def live_run(
    rig: LiveRig,
    output: Path,
    recording: Path,
    options: LiveOptions,
    on_pose: OnPose = _ignore,
    on_map: OnMap = _ignore,
    tell: Callable[[str], None] = _ignore,
    on_status: Callable[[Status], None] = _ignore,
) -> dict[str, Any]:
    """Map live into `output`, which exists when `options.opened` was called; record into
    `recording`. The content of run.json.

    on_pose, on_map: called from the threads that map and save; they must not wait.

    Raises:
        RigError: not calibrated; CameraError, OdometryError, InputError: devices or folders, or
        wheels are wanted that the rig has not; the results so far are saved first where there are
        any.
    """
    begin = time.perf_counter()
    stereo_rig = rig.source.calibrated()
    if options.motion != "visual":
        rig.wheels()
    if stereo_rig.mount is None:
        tell(NO_MOUNT)
        from calibration.rig import Mount

        stereo_rig = stereo_rig.with_mount(Mount())
    settings, watcher = with_body(options.settings, stereo_rig, rig.parameters), options.watcher

    def saved(event: MapEvent) -> None:
        on_map(event)
        watcher.saved(event)

    warm_up(stereo_rig, settings, looks=options.motion in LOOKING)
    with capture(rig, recording, settings.odometry, tell, settings.mapping.cell) as session:
        known = options.opened()
        saver = MapSaver(output, saved)
        motion = _motion(rig, stereo_rig, session, options)
        mapper = LiveMapper(
            stereo_rig,
            motion,
            settings,
            options.seed,
            known,
            saver,
            on_pose,
            session.note,
            options.begin,
            watcher,
        )
        mapper.run.earlier_places = options.places
        session.sinks += [watcher.captured, mapper.offer]
        mapper.start()
        session.start()
        try:
            _watch(session, mapper, options, on_status)
        finally:
            session.stop()
            run = mapper.finish()
            saver.close()
        facts = {**options.facts, "odometry": motion.report(), **_counts(session, mapper, saver)}
        run.seconds["total"] = time.perf_counter() - begin
        arguments = [str(recording), "--motion", options.motion]
        origin = Origin(output, recording, arguments, pairs=lambda: open_recording(recording).pairs)
        # Before the devices are closed: a driver that crashes then costs no map.
        summary = save_results(output, run, settings, facts, origin=origin)
    watcher.ended(run)
    error = mapper.error or (InputError(session.recorder.error) if session.recorder.error else None)
    if error is not None:
        raise error
    return summary


def _motion(
    rig: LiveRig, stereo_rig: StereoRig, session: Session, options: LiveOptions
) -> AnyMotion:
    """The motion that is asked for, from the devices that are open."""
    settings = options.settings
    if options.motion == "visual":
        return looking(stereo_rig, None, settings, options.seed)
    assert session.tap is not None
    wheels = LiveOdometry(session.tap, rig.wheels()[1], settings.odometry)
    if options.motion == "fused":
        return looking(stereo_rig, wheels, settings, options.seed)
    return wheels


def _watch(
    session: Session, mapper: LiveMapper, options: LiveOptions, on_status: Callable[[Status], None]
) -> None:
    """Until it is asked to stop, or something ends it."""
    begin = last = time.monotonic()
    status = Status(session, mapper)
    while not options.stop.wait(TICK):
        now = time.monotonic()
        if options.duration is not None and now - begin >= options.duration:
            return
        if mapper.error is not None or session.recorder.error is not None:
            return
        if now - last >= STATUS_EVERY:
            status.measure(now - last)
            on_status(status)
            last = now


def _counts(session: Session, mapper: LiveMapper, saver: MapSaver) -> dict[str, Any]:
    return {
        **session.report(),
        "pairs_skipped": mapper.skipped,
        "pair_to_pose_s": _spread(mapper.latencies),
        "map_to_file_s": _spread(saver.latencies),
    }


def _spread(seconds: list[float]) -> dict[str, float]:
    """Median, 95 % and the most."""
    if not seconds:
        return {}
    middle, most = np.quantile(seconds, [0.5, 0.95]).tolist()
    return {"median": round(middle, 4), "p95": round(most, 4), "most": round(max(seconds), 4)}


def save_results(
    output: Path,
    run: MapRun,
    settings: Settings,
    facts: dict[str, Any],
    truth: Trajectory | None = None,
    origin: Origin | None = None,
) -> dict[str, Any]:
    """All result files, each in place of an earlier one, run.json last.

    Raises InputError when they cannot be written: the last saved map is still there.
    """
    partial = output / ".saving"
    shutil.rmtree(partial, ignore_errors=True)
    try:
        partial.mkdir()
        summary = write_results(partial, run, settings, truth, facts, origin)
        replace_files(partial, output, "run.json")
        forget_earlier(output)
    except OSError as error:
        raise InputError(
            f"{output}: the results cannot be written ({error.strerror or error}): the map saved "
            "last is still there"
        ) from None
    return summary


def begin_output(output: Path, asked: dict[str, Any]) -> None:
    """A result folder with a run.json that says that the run is going on; what stood there is set
    aside until there are results.

    Raises:
        InputError: it cannot be made.
    """
    try:
        output.mkdir(parents=True, exist_ok=True)
        set_aside(output)
        text = json.dumps({**asked, "partial": True, "live": True}, indent=2)
        (output / "run.json").write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{output}: cannot be written ({error.strerror})") from None


def abandon_output(output: Path) -> None:
    """After a run that failed: where it saved no map the folder is as it was before."""
    if (output / "map.yaml").exists() or not (output / "run.json").exists():
        return
    (output / "run.json").unlink()
    (output / "checkpoint").unlink(missing_ok=True)
    put_back(output)
    unmake([output])
