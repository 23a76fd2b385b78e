"""Taking pairs of a board by itself: those worth keeping are written as they come."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from pipeline.board_capture import BoardCapture, Look
from pipeline.errors import InputError
from stereo.camera import CapturedPair
from stereo.camera_settings import CameraSettings
from stereo.errors import StereoError
from stereo.stereo_camera import StereoCamera

SILENT_S = 5.0
SIDES = ("left", "right")


class CaptureWatcher:
    """Looks at nothing: what looks overrides some of this.

    Called by the thread that takes pairs, which a watcher must not hold up.
    """

    def begins(self, camera: StereoCamera) -> None:
        """The cameras send."""

    def looked(self, pair: CapturedPair, look: Look, capture: BoardCapture) -> None:
        """A pair was judged; one that is kept is written already."""


def take_pairs(
    cameras: CameraSettings,
    capture: BoardCapture,
    output: Path,
    most: int,
    stop: threading.Event,
    watchers: Sequence[CaptureWatcher],
) -> None:
    """Take pairs until there are enough, or `most`, or `stop` is set.

    output: folder, with left/ and right/ in it.

    Raises:
        CameraError: a camera cannot be opened; InputError: none sends.
    """
    last = time.monotonic()
    with StereoCamera(cameras) as camera:
        for watcher in watchers:
            watcher.begins(camera)
        while not stop.is_set() and len(capture.kept) < most and capture.views.wishes:
            pair = _latest(camera)
            if pair is None:
                if time.monotonic() - last > SILENT_S:
                    raise InputError(f"no pair for {SILENT_S:g} s: are both cameras running?")
                continue
            last = time.monotonic()
            try:
                look = capture.look(pair.load())
            except StereoError:
                capture.damaged += 1
                continue
            if look.kept:
                _write(output, len(capture.kept), pair)
            for watcher in watchers:
                watcher.looked(pair, look, capture)


def _latest(camera: StereoCamera) -> CapturedPair | None:
    """The newest pair: the board is looked for more slowly than pairs come."""
    pair = camera.read(0.2)
    while pair is not None and (newer := camera.read(0.0)) is not None:
        pair = newer
    return pair


def _write(output: Path, number: int, pair: CapturedPair) -> None:
    """A JPEG as it was sent, pixels as PNG."""
    frames = [pair.left, pair.right]
    if pair.right is None:
        loaded = pair.load()
        images = [loaded.left, loaded.right]
    else:
        images = [frame.data for frame in frames if frame is not None]
    for side, image in zip(SIDES, images, strict=True):
        if isinstance(image, np.ndarray):
            data, ending = cv2.imencode(".png", image)[1].tobytes(), "png"
        else:
            data, ending = image, "jpg"
        (output / side / f"{number:03d}.{ending}").write_bytes(data)
