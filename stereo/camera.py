"""Camera: one stream of images, whatever delivers it; and the images as it delivers them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from stereo.encoded import decode_image
from stereo.errors import CameraError, StereoError
from stereo.pair import StereoPair


@dataclass(frozen=True, eq=False)
class Frame:
    """One image as the camera gave it.

    stamp: when it was taken, or arrived, by this machine's monotonic clock [ns].
    data: the JPEG as it was sent, or pixels uint8 (H, W) or (H, W, 3).
    taken: when it was taken by the camera's own clock, where it says so [ns].
    """

    stamp: int
    data: bytes | np.ndarray
    taken: int | None = None

    def decode(self) -> np.ndarray:
        """The pixels. Raises StereoError for a JPEG that is damaged."""
        if isinstance(self.data, np.ndarray):
            return self.data
        image = decode_image(self.data)
        if isinstance(image, str):
            raise StereoError(f"image of {self.stamp}: {image}")
        return image


@dataclass(frozen=True, eq=False)
class CapturedPair:
    """Two images taken together; right is None where left holds both side by side.

    skew: how much later the right one was taken [ns].
    """

    left: Frame
    right: Frame | None
    skew: int = 0

    @property
    def stamp(self) -> int:
        """Of the left image [ns]."""
        return self.left.stamp

    @property
    def name(self) -> str:
        """What the pair is called in messages."""
        return str(self.stamp)

    def where(self, right: bool) -> str:
        """Which image of it."""
        return f"{'right' if right else 'left'} image of {self.stamp}"

    def load(self) -> StereoPair:
        """Decode both images. Raises StereoError for a damaged one."""
        left = self.left.decode()
        if self.right is not None:
            return StereoPair(self.stamp, left, self.right.decode())
        return StereoPair(self.stamp, *halves(left))


def halves(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Left and right half of an image that shows both cameras' side by side."""
    middle = image.shape[1] // 2
    return image[:, :middle], image[:, middle : 2 * middle]


class Camera(ABC):
    """A stream of frames; a context manager. Used by one thread, `interrupt` alone by any."""

    garbage = 0  # bytes received so far that belonged to no image

    @abstractmethod
    def connect(self) -> None:
        """Open it. Raises CameraError in words."""

    @abstractmethod
    def read(self) -> Frame:
        """The next frame; waits for it.

        Raises:
            CameraError: the camera is lost, or sends nothing any more.
        """

    @abstractmethod
    def close(self) -> None:
        """Release it, in the thread that reads: libraries crash when it is another one."""

    def interrupt(self) -> None:  # noqa: B027 - most drivers cannot be woken
        """Let a `read` that waits in another thread end soon, where that can be done safely."""

    def __enter__(self) -> Camera:
        self.connect()
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()


def open_camera(
    address: str | int, size: tuple[int, int] | None, rate: float, exposure: float | None
) -> Camera:
    """The camera of a device or an address, not yet connected; size of its whole images [px],
    rate [1/s], exposure [ms]."""
    from stereo.camera_network import NetworkCamera
    from stereo.camera_settings import is_network
    from stereo.camera_v4l2 import VideoDevice

    if is_network(address):
        if exposure is not None:
            raise CameraError(f"{address}: its exposure must be fixed at the camera itself")
        return NetworkCamera(str(address))
    path = f"/dev/video{address}" if isinstance(address, int) else address
    return VideoDevice(path, size, rate, exposure)
