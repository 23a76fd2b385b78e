"""Capture: the devices of a rig opened together and recorded; pairs handed on as they come.

with capture(rig, folder, settings, tell) as session:
    session.sinks.append(mapper.offer)
    session.start()
    ...
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from odometry.reader import LiveEncoders, Tap, open_encoders
from odometry.settings import OdometrySettings
from pipeline.encoder_sheet import encoder_sheet
from pipeline.errors import InputError
from pipeline.live.devices import LiveRig
from pipeline.live.recorder import Recorder
from pipeline.live.recording_files import RecordingFiles
from pipeline.output_lock import make_folder, unmake
from stereo.camera import CapturedPair
from stereo.stereo_camera import StereoCamera

READY_S = 5.0  # the encoders must have spoken within this
POLL_S = 0.1

Tell = Callable[[str], None]


class Session:
    """Open devices and the recording they go into.

    sinks: called with every pair that is recorded, from the capturing thread; they must not wait.
    tap: readings of the encoders for whoever computes motion; None without encoders.
    """

    def __init__(
        self,
        camera: StereoCamera,
        encoders: LiveEncoders | None,
        recorder: Recorder,
        tap: Tap | None,
        tell: Tell,
    ) -> None:
        self.camera = camera
        self.encoders = encoders
        self.recorder = recorder
        self.tap = tap
        self.sinks: list[Callable[[CapturedPair], None]] = []
        self._tell = tell
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="capture", daemon=True)

    def start(self) -> None:
        """Begin to take pairs."""
        self.recorder.start()
        self._thread.start()

    def stop(self) -> None:
        """Record what has come and take no more pairs; the devices stay open until `capture` ends:
        a driver that hangs or crashes when it is closed must not cost what is still to be saved.
        """
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
            self.recorder.drain()
        self.camera.end()

    def note(self, text: str, stamp: int | None = None) -> None:
        """Write something into the log of the recording, and tell it."""
        self.recorder.note(time.monotonic_ns() if stamp is None else stamp, text)
        self._tell(text)

    def report(self) -> dict[str, Any]:
        """What came and what was lost, as run.json keeps it."""
        report, recorder = self.camera.report(), self.recorder
        lost = {"lonely": report.lonely, "late": report.late, "backwards": report.backwards}
        return {
            "cameras": {**report.counts, "pairs": report.pairs, **lost},
            "skew_ms": [round(v, 3) for v in report.skew_ms],
            "encoders": self.encoders.report() if self.encoders else {},
            "recorded": {**recorder.counts, "slowest_sync_s": round(recorder.slowest_sync, 3)},
        }

    def _run(self) -> None:
        while not self._stop.is_set():
            self._take(self.camera.read(POLL_S))
        self.camera.end()
        while (pair := self.camera.read(0.0)) is not None:
            self._take(pair)

    def _take(self, pair: CapturedPair | None) -> None:
        if pair is not None and self.recorder.add(pair):
            for sink in self.sinks:
                sink(pair)
        for stamp, text in self.camera.events():
            self.note(text, stamp)
        for text in self.encoders.events() if self.encoders else ():
            self.note(text)


@contextmanager
def capture(
    rig: LiveRig,
    folder: Path,
    settings: OdometrySettings,
    tell: Tell,
    cell: float | None = None,
) -> Iterator[Session]:
    """Open all devices, and a recording at `folder`, which must not hold anything yet.
    cell: of the map that is made meanwhile [m].

    Raises:
        CameraError, OdometryError: a device cannot be opened; InputError: the folder cannot be
        written. Nothing is left behind then.
    """
    wheels = None if rig.parameters is None else encoder_sheet(rig.parameters)
    stereo = rig.cameras.stereo is not None
    made: list[Path] = []
    encoders = tap = files = None
    try:
        made = make_folder(folder)
        files = RecordingFiles(folder, rig.source, rig.cameras.fps, stereo, wheels, cell)
        recorder = Recorder(files, tell)
        camera = StereoCamera(rig.cameras)
        if rig.device is not None and rig.parameters is not None:
            encoders = open_encoders(rig.device, rig.parameters, settings, files.serial_log)
            recorded, tap = encoders.taps(2)
            recorder.listen(recorded)
            encoders.wait_ready(READY_S)
        camera.connect()
    except BaseException as error:
        if encoders is not None:
            encoders.close()
        if files is not None:
            files.close()
        for entry in folder.iterdir() if folder.is_dir() else ():
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
        unmake(made)
        if isinstance(error, OSError):
            raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
        raise
    session = Session(camera, encoders, recorder, tap, tell)
    with ExitStack() as stack:
        # Undone in this order: the recorder last: every reading is written.
        stack.callback(recorder.close)
        if encoders is not None:
            stack.callback(encoders.close)
        stack.callback(camera.close)
        stack.callback(session.stop)
        yield session
