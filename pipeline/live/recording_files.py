"""RecordingFiles: a recording as it grows: only appended to, safe on the disk up to the last sync.

An image is written whole before the line that lists it. After `kill -9` or a power cut the folder
opens as it is: at most the last line of each file and the images since the last sync are lost.
"""

from __future__ import annotations

import json
import os
import threading
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from calibration.device_rig import DeviceRig
from calibration.exchange.euroc import camera_sheets
from calibration.rig import RigError
from calibration.yamlfile import dump_yaml
from odometry.counters import TickReading
from odometry.tick_log import HEADER as TICKS_HEADER
from odometry.tick_log import tick_lines
from pipeline.recordings.asl_writer import IMAGE_HEADER
from pipeline.recordings.recorded_rig import META_FILE, RIG_FILE, marked
from stereo.camera import CapturedPair, Frame

SKEW_HEADER = "#timestamp [ns],right - left [ns]"
SERIAL_LOG = "serial.log"
LOG = "log.txt"


class RecordingFiles:
    """Writes `folder`, which exists and is empty. Used by one thread; `sync` by another.

    stereo: one camera sends both images side by side. encoders: what stands in their sensor.yaml.
    cell: of the map that is made meanwhile [m].

    Raises OSError where it cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        source: DeviceRig,
        rate: float,
        stereo: bool,
        encoders: dict[str, Any] | None,
        cell: float | None = None,
    ) -> None:
        self.folder = folder
        self.root = folder / "mav0"
        self.cameras = ("stereo0",) if stereo else ("cam0", "cam1")
        self._lists: dict[str, int] = {}
        self._fresh: list[Path] = []
        self._lock = threading.Lock()
        (folder / RIG_FILE).write_text(marked(source.text), encoding="utf-8")
        made = {"beemap": version("beemap"), "devices": source.devices}
        made |= {} if cell is None else {"cell": cell}
        (folder / META_FILE).write_text(json.dumps(made, indent=2, default=str) + "\n")
        for camera in self.cameras:
            (self.root / camera / "data").mkdir(parents=True)
            self._begin(self.root / camera / "data.csv", IMAGE_HEADER + "\n")
        self._begin(self.root / "skew.csv", SKEW_HEADER + "\n")
        self._begin(folder / LOG, "")
        self._write_sheets(source, rate, stereo)
        if encoders is not None:
            (self.root / "odom0").mkdir()
            # A field that must be there comes last: a file cut short is then known to be.
            ordered = {"sensor_type": "encoders", **encoders}
            ordered["counter_bits"] = ordered.pop("counter_bits")
            (self.root / "odom0" / "sensor.yaml").write_text(dump_yaml(ordered), encoding="utf-8")
            self._begin(self.root / "odom0" / "data.csv", TICKS_HEADER)
        self._fresh += [path for path in folder.rglob("*") if path.is_file()]
        self.sync()

    @property
    def serial_log(self) -> Path:
        """Where the encoders' raw log belongs."""
        return self.root / "odom0" / SERIAL_LOG

    def add_pair(self, pair: CapturedPair) -> None:
        """Append a pair, as its cameras sent it; both images under the left one's stamp."""
        frames = [pair.left] if pair.right is None else [pair.left, pair.right]
        for camera, frame in zip(self.cameras, frames, strict=True):
            ending, data = _encoded(frame)
            name = f"{pair.stamp}.{ending}"
            path = self.root / camera / "data" / name
            _write_new(path, data)
            with self._lock:
                self._fresh.append(path)
            self._append(self.root / camera / "data.csv", f"{pair.stamp},{name}\n")
        if pair.right is not None:
            self._append(self.root / "skew.csv", f"{pair.stamp},{pair.skew}\n")

    def add_readings(self, readings: list[TickReading]) -> None:
        """Append readings of the wheels."""
        if readings:
            lines = "".join(tick_lines(reading) for reading in readings)
            self._append(self.root / "odom0" / "data.csv", lines)

    def add_note(self, stamp: int, text: str) -> None:
        """Append what happened to the log."""
        self._append(self.folder / LOG, f"{stamp} {' '.join(text.split())}\n")

    def sync(self) -> None:
        """Bring all that was written so far safely to the disk."""
        with self._lock:
            fresh, self._fresh = self._fresh, []
        for path in [*fresh, *sorted({path.parent for path in fresh})]:
            fd = os.open(path, os.O_RDONLY)
            try:
                os.fsync(fd)
            finally:
                os.close(fd)
        # The lists last: what they name is on the disk.
        for fd in list(self._lists.values()):
            os.fsync(fd)

    def close(self) -> None:
        """Sync and close."""
        try:
            self.sync()
        finally:
            lists, self._lists = self._lists, {}
            for fd in lists.values():
                os.close(fd)

    def _begin(self, path: Path, header: str) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
        self._lists[str(path)] = os.open(path, flags, 0o644)
        self._append(path, header)

    def _append(self, path: Path, text: str) -> None:
        _write_all(self._lists[str(path)], text.encode("utf-8", "replace"))

    def _write_sheets(self, source: DeviceRig, rate: float, stereo: bool) -> None:
        """Sensor files for other programs; ours reads the rig file."""
        if source.rig is None or stereo:
            return
        try:
            sheets = camera_sheets(source.rig, rate)
        except RigError:  # a lens that the layout has no name for
            return
        for camera, sheet in sheets.items():
            (self.root / camera / "sensor.yaml").write_text(dump_yaml(sheet), encoding="utf-8")


def _encoded(frame: Frame) -> tuple[str, bytes]:
    """File ending and bytes: a JPEG as it came, pixels without loss."""
    if isinstance(frame.data, np.ndarray):
        import cv2

        # The least compression: it is the fastest.
        return "png", cv2.imencode(".png", frame.data, [cv2.IMWRITE_PNG_COMPRESSION, 1])[
            1
        ].tobytes()
    return "jpg", frame.data


def _write_new(path: Path, data: bytes) -> None:
    """All of it, or nothing where the disk is full."""
    fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
    try:
        _write_all(fd, data)
    except OSError:
        path.unlink(missing_ok=True)
        raise
    finally:
        os.close(fd)


def _write_all(fd: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(fd, view) :]
