"""VideoDevice: a camera on Linux's video interface (V4L2), read through OpenCV."""

from __future__ import annotations

import errno
import os
import time
from pathlib import Path

import numpy as np

from stereo.camera import Camera, Frame
from stereo.encoded import JPEG_END, JPEG_START
from stereo.errors import CameraError

# V4L2's names for exposure: by hand, and by the camera (V4L2_CID_EXPOSURE_AUTO).
BY_HAND, BY_CAMERA = 1, 3
UNITS_A_MS = 10.0  # V4L2 counts exposure in 0.1 ms
# The kernel's stamp is trusted when it lies this shortly before now [ns].
RECENT = 1_000_000_000


class VideoDevice(Camera):
    """Frames of `/dev/videoN`; JPEG as the camera sent it where it has MJPG, else pixels.

    size: (width, height) [px]; rate [1/s]; exposure: fixed [ms], None: automatic.
    Frames carry the kernel's monotonic stamp where OpenCV passes it on.
    """

    def __init__(
        self, path: str, size: tuple[int, int] | None, rate: float, exposure: float | None
    ) -> None:
        self.path = path
        self.size = size
        self.rate = rate
        self.exposure = exposure
        self._capture = None

    def connect(self) -> None:
        """Open it in the wanted mode. Raises CameraError: absent, forbidden, in use, no such
        mode."""
        import cv2

        _look(self.path)
        capture = cv2.VideoCapture(self.path, cv2.CAP_V4L2)
        if not capture.isOpened():
            capture.release()
            raise CameraError(
                f"{self.path}: no camera, or in use by another program "
                f"('fuser -v {self.path}' names it): close that"
            )
        # The pixel format first: it decides which sizes and rates there are.
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        if self.size is not None:
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, self.size[0])
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self.size[1])
        capture.set(cv2.CAP_PROP_FPS, self.rate)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 2)
        if capture.get(cv2.CAP_PROP_FOURCC) == cv2.VideoWriter.fourcc(*"MJPG"):
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)  # the JPEG itself, not its pixels
        self._expose(capture, cv2)
        self._check_size(capture, cv2)
        self._capture = capture

    def read(self) -> Frame:
        """The next image. Raises CameraError when the device is lost."""
        import cv2

        capture = self._capture
        if capture is None:
            raise CameraError(f"{self.path}: not connected")
        grabbed = capture.grab()
        stamp = _stamp(capture.get(cv2.CAP_PROP_POS_MSEC), time.monotonic_ns())
        good, image = capture.retrieve() if grabbed else (False, None)
        if not good or image is None:
            raise CameraError(f"{self.path}: delivers no image any more: check its cable")
        if min(image.shape[:2]) == 1:
            return Frame(stamp, jpeg_of(image))
        return Frame(stamp, image)

    def close(self) -> None:
        """Release the device."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()

    def _expose(self, capture, cv2) -> None:
        if self.exposure is None:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, BY_CAMERA)
            return
        by_hand = capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, BY_HAND)
        if not (by_hand and capture.set(cv2.CAP_PROP_EXPOSURE, self.exposure * UNITS_A_MS)):
            capture.release()
            raise CameraError(
                f"{self.path}: its exposure cannot be fixed: leave devices.exposure out"
            )

    def _check_size(self, capture, cv2) -> None:
        got = tuple(
            int(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        if self.size is not None and got != tuple(self.size):
            capture.release()
            raise CameraError(
                f"{self.path}: offers {got[0]}x{got[1]} in place of {self.size[0]}x"
                f"{self.size[1]}: give a size it has ('v4l2-ctl --list-formats-ext')"
            )


def jpeg_of(row: np.ndarray) -> bytes:
    """The JPEG in a buffer (1, n) or (n, 1): drivers pad its end with zeros."""
    data = row.tobytes()
    end = data.rfind(JPEG_END)
    return data[: end + 2] if data.startswith(JPEG_START) and end > 0 else data


def _stamp(milliseconds: float, now: int) -> int:
    """The kernel's stamp [ns] where it is one, else now."""
    stamp = round(milliseconds * 1e6)
    return stamp if 0 <= now - stamp < RECENT else now


def _look(path: str) -> None:
    """Say why a device cannot be opened: OpenCV does not."""
    try:
        os.close(os.open(path, os.O_RDWR | os.O_NONBLOCK))
    except OSError as error:
        raise CameraError(f"{path}: {_reason(error)}") from None


def _reason(error: OSError) -> str:
    if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        there = ", ".join(sorted(str(p) for p in Path("/dev").glob("video*")))
        return f"no such camera (there are: {there or 'none'}): check its cable and the name"
    if error.errno in (errno.EACCES, errno.EPERM):
        return (
            "permission denied: join the group 'video' (sudo usermod -aG video $USER) and log "
            "in again"
        )
    if error.errno == errno.EBUSY:
        return "in use by another program: close that"
    return f"cannot be opened ({error.strerror})"
