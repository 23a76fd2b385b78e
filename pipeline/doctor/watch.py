"""All devices of a rig watched for some seconds at once, whichever of them can be opened."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from odometry.counters import TickReading
from odometry.errors import OdometryError
from odometry.reader import LiveEncoders, open_encoders
from odometry.settings import OdometrySettings
from pipeline.live.devices import LiveRig
from stereo.camera import CapturedPair
from stereo.errors import CameraError, StereoError
from stereo.stereo_camera import CameraReport, StereoCamera

READY_S = 4.0
MOST_PAIRS = 300


@dataclass
class Watched:
    """What came within `seconds`; an error where a device could not be opened."""

    seconds: float
    pairs: list[CapturedPair] = field(default_factory=list)
    cameras: CameraReport | None = None
    camera_error: CameraError | None = None
    readings: list[TickReading] = field(default_factory=list)
    encoders: dict[str, int] = field(default_factory=dict)
    encoder_error: OdometryError | None = None

    def size(self) -> tuple[int, int] | None:
        """(width, height) of the first left image that can be decoded [px]."""
        for pair in self.pairs:
            try:
                height, width = pair.load().left.shape[:2]
            except StereoError:
                continue
            return width, height
        return None


def watch(rig: LiveRig, seconds: float, settings: OdometrySettings) -> Watched:
    """Open what can be opened and take what comes."""
    seen = Watched(seconds)
    encoders = _open_encoders(rig, settings, seen)
    camera = StereoCamera(rig.cameras)
    try:
        camera.connect()
    except CameraError as error:
        seen.camera_error = error
    try:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if seen.camera_error is not None:
                time.sleep(0.05)
            elif (pair := camera.read(0.05)) is not None and len(seen.pairs) < MOST_PAIRS:
                seen.pairs.append(pair)
    finally:
        camera.close()
        if encoders is not None:
            seen.readings = encoders.readings()
            seen.encoders = encoders.report()
            encoders.close()
    seen.cameras = camera.report()
    return seen


def _open_encoders(rig: LiveRig, settings: OdometrySettings, seen: Watched) -> LiveEncoders | None:
    if rig.device is None or rig.parameters is None:
        return None
    encoders = None
    try:
        encoders = open_encoders(rig.device, rig.parameters, settings)
        encoders.wait_ready(READY_S)
    except OdometryError as error:
        seen.encoder_error = error
        if encoders is not None:
            encoders.close()
        return None
    return encoders
