"""A run as a bag: map, path, odometry, tf, scans and images on the recording's own stamps.

The folder holds map, path and odometry; scans, covariances and images are made of the recording
once more, as the run made them, where it is at hand.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from calibration.rig import Mount
from calibration.rotation import turn_matrix
from odometry.motion import Motion, compose, inverse
from pipeline.job import Job, Look
from pipeline.recordings.base import DamagedFrameError, PairFiles, RecordedPair, Recording
from pipeline.ros.bag_writer import BagWriter
from pipeline.ros.calibration import info_fields
from pipeline.ros.images import DamagedImageError, encode, image_file
from pipeline.ros.messages import (
    MAP,
    ODOM,
    ROBOT,
    SENSOR,
    grid_message,
    image_message,
    info_message,
    odometry_message,
    path_message,
    planar_transform,
    scan_message,
    transform,
    transforms_message,
)
from pipeline.ros.types import CAMERA_INFO, COMPRESSED, GRID, ODOMETRY, PATH, SCAN, TF
from pipeline.run_folder import RunFolder
from stereo.errors import StereoError
from stereo.scan import RangeScan

SIDES = ("left", "right")


def optical(side: str) -> str:
    """Name of a camera's frame: x right, y down, z ahead."""
    return f"{side}_camera_optical_frame"


def export(
    run: RunFolder,
    job: Job | None,
    writer: BagWriter,
    images: bool,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[Counter[str], dict[str, list[str]]]:
    """Write the run; how many messages of each type, and what was skipped, by reason.

    job: the run that made the folder, None when its recording is not at hand.
    """
    exporter = _Exporter(run, job, writer, images)
    exporter.begin()
    total = len(run.trajectory)
    for done, (stamp, look) in enumerate(exporter.looks(), start=1):
        exporter.add(stamp, look)
        progress(min(done, total), total)
    return exporter.counts, exporter.skipped


class _Exporter:
    def __init__(self, run: RunFolder, job: Job | None, writer: BagWriter, images: bool) -> None:
        self.counts: Counter[str] = Counter()
        self.skipped: dict[str, list[str]] = {}
        self._run, self._job, self._writer, self._make = run, job, writer, writer.make
        stamps = run.trajectory.stamps.tolist()
        self._start = int(stamps[0])
        self._index = {stamp: number for number, stamp in enumerate(stamps)}
        self._since: Motion | None = None  # all motion up to now
        self._sensor: tuple[float, float, float] | None = None  # where it was told to be
        self._fixed: list[object] = []  # transforms of /tf_static
        self._pairs: dict[int, RecordedPair] = {}
        if job is not None and images and isinstance(job.opened, Recording):
            self._pairs = {pair.stamp: pair for pair in job.opened.pairs}
        rig = None if job is None else job.rig
        self._infos = None if rig is None else info_fields(rig)

    def begin(self) -> None:
        """Map and path, which are kept for whoever comes later."""
        run, make, start = self._run, self._make, self._start
        self._write("/map", GRID, start, grid_message(make, start, run.grid), latched=True)
        path = path_message(make, start, run.trajectory.stamps, run.trajectory.poses)
        self._write("/path", PATH, start, path, latched=True)
        rig = None if self._job is None else self._job.rig
        if rig is None:
            return
        mount = rig.mount or Mount()
        left, right = (optical(side) for side in SIDES)
        # The right camera in the left one's frame: R, T carry points the other way.
        self._fixed = [
            transform(make, start, ROBOT, left, mount.rotation, mount.position),
            transform(make, start, left, right, rig.R.T, -rig.R.T @ rig.T),
        ]

    def looks(self) -> Iterator[tuple[int, Look | None]]:
        """(stamp, look) of every pose of the path; no look where the recording is not there."""
        if self._job is None:
            for stamp in self._index:
                yield stamp, None
            return
        for look in self._job.looks():
            # Beyond the end of a run that was interrupted there is no path.
            if look.stamp in self._index:
                yield look.stamp, look

    def add(self, stamp: int, look: Look | None) -> None:
        """All messages of one stamp."""
        make, number = self._make, self._index[stamp]
        pose = self._run.trajectory.poses[number]
        motion = None if look is None else look.motion
        if motion is not None:
            self._since = motion if self._since is None else self._since.then(motion)
        odometry = self._run.odometry
        # Without dead reckoning the robot's place is told in the map alone.
        there = pose if odometry is None else odometry.poses[number]
        correction = compose(pose, inverse(there))
        frames = [
            planar_transform(make, stamp, MAP, ODOM, correction),
            planar_transform(make, stamp, ODOM, ROBOT, there),
        ]
        self._write("/tf", TF, stamp, transforms_message(make, frames))
        covariance = None if self._since is None else self._since.covariance
        message = odometry_message(make, stamp, there, covariance, motion)
        self._write("/odom", ODOMETRY, stamp, message)
        if stamp in self._pairs:
            self._add_images(stamp, self._pairs[stamp])
        if look is not None and look.scan is not None:
            self._add_scan(stamp, look.scan)

    def _add_scan(self, stamp: int, scan: RangeScan) -> None:
        if scan.origin != self._sensor:
            self._sensor = scan.origin
            rig = None if self._job is None else self._job.rig
            height = 0.0 if rig is None else (rig.mount or Mount()).height
            x, y, yaw = scan.origin
            turn = turn_matrix(np.array([0.0, 0.0, yaw]))
            place = np.array([x, y, height])
            frame = transform(self._make, stamp, ROBOT, SENSOR, turn, place)
            # Whoever comes later gets the last message alone: it tells all of them.
            message = transforms_message(self._make, [*self._fixed, frame])
            self._write("/tf_static", TF, stamp, message, latched=True)
        self._write("/scan", SCAN, stamp, scan_message(self._make, scan))

    def _add_images(self, stamp: int, pair: RecordedPair) -> None:
        assert self._infos is not None
        try:
            files = _files(pair)
        except (DamagedFrameError, DamagedImageError, StereoError) as error:
            self.skipped.setdefault("unreadable pair", []).append(str(error))
            return
        for side, (ending, data), fields in zip(SIDES, files, self._infos, strict=True):
            told = "jpeg" if ending == "jpg" else ending
            image = image_message(self._make, stamp, optical(side), data, told)
            self._write(f"/stereo/{side}/image_raw/compressed", COMPRESSED, stamp, image)
            info = info_message(self._make, stamp, optical(side), fields)
            self._write(f"/stereo/{side}/camera_info", CAMERA_INFO, stamp, info)

    def _write(
        self, topic: str, kind: str, stamp: int, message: object, latched: bool = False
    ) -> None:
        self._writer.write(topic, kind, stamp, message, latched)
        self.counts[kind] += 1


def _files(pair: RecordedPair) -> list[tuple[str, bytes]]:
    """Ending and bytes of the left and the right image: files as they are, else PNGs."""
    if isinstance(pair, PairFiles):
        return [image_file(_read(file)) for file in pair.files]
    loaded = pair.load()
    return [("png", encode(image)) for image in (loaded.left, loaded.right)]


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise DamagedFrameError(f"{file}: {error.strerror or error}") from None
