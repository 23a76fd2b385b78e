"""Recording alone: the devices of a rig into a recording, until it is asked to stop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from odometry.settings import OdometrySettings
from pipeline.errors import InputError
from pipeline.live.capture import capture
from pipeline.live.devices import LiveRig
from pipeline.live.live_run import STATUS_EVERY, TICK
from pipeline.live.status import Status


def record_run(
    rig: LiveRig,
    folder: Path,
    stop: threading.Event,
    settings: OdometrySettings,
    duration: float | None = None,
    tell: Callable[[str], None] = lambda text: None,
    on_status: Callable[[Status], None] = lambda status: None,
) -> dict[str, Any]:
    """Record into `folder` until `stop` is set or `duration` seconds are over; what came of it.

    settings: which readings of the wheels are believed; the raw log has them all.

    Raises:
        CameraError, OdometryError: a device cannot be opened; InputError: the folder cannot be
        written, or the disk became full: what was recorded is kept.
    """
    with capture(rig, folder, settings, tell) as session:
        status = Status(session)
        session.start()
        begin = last = time.monotonic()
        while not stop.wait(TICK) and session.recorder.error is None:
            now = time.monotonic()
            if duration is not None and now - begin >= duration:
                break
            if now - last >= STATUS_EVERY:
                status.measure(now - last)
                on_status(status)
                last = now
    recorder = session.recorder
    if recorder.error is not None:
        raise InputError(recorder.error)
    return session.report()
