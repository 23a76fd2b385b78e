"""Cameras before which somebody holds a board, each view until it was taken."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from odometry.encoders import EncoderParameters
from simulation.virtual_cameras import VirtualCameras
from simulation.virtual_drive import RecordedDrive, Timeline
from stereo.pair import StereoPair

WHEELS = EncoderParameters(2000.0, 0.075, 0.075, 0.3, 16)


def jpeg(image: np.ndarray) -> bytes:
    """As a camera sends it."""
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 97])[1].tobytes()


@contextmanager
def board_cameras(
    views: Sequence[StereoPair],
    shots: Path,
    rig_file: Path,
    begin: threading.Event | None = None,
    fps: int = 20,
) -> Iterator[list[tuple[bytes, bytes]]]:
    """Serve the views one after the other, the next one as soon as `shots` holds a pair more, so
    that the same pairs are taken however busy the machine is; and write a rig file that names the
    cameras. Yields what is sent.

    begin: until it is set nobody stands there.
    """
    sent = [(jpeg(view.left), jpeg(view.right)) for view in views]
    nobody = jpeg(np.full_like(views[0].left, 120))
    period = round(1e9 / fps)

    def held(number: int) -> tuple[bytes, bytes]:
        if begin is not None and not begin.is_set():
            return nobody, nobody
        taken = sum(1 for _ in (shots / "left").glob("*"))
        return sent[min(taken, len(sent) - 1)]

    stamps = np.arange(2) * period
    drive = RecordedDrive(stamps, held, stamps, np.zeros((2, 2), np.int64), WHEELS)
    cameras = VirtualCameras(Timeline(drive, 1.0))
    cameras.start()
    rig_file.write_text(
        f"beemap_rig: 1\ndevices: {{left: {cameras.address('left')}, "
        f"right: {cameras.address('right')}, fps: {fps}}}\n"
    )
    try:
        yield sent
    finally:
        cameras.stop()
