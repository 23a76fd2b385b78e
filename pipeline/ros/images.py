"""Image messages as image files, and back. A JPEG or PNG stays what it is, byte for byte."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.ros.types import COMPRESSED
from stereo.encoded import JPEG_START, TAIL, decode_image, is_cut_short

PNG_START = b"\x89PNG\r\n\x1a\n"

# encoding -> bytes a pixel, conversion to what a PNG holds (None: none).
# Source: sensor_msgs/image_encodings.h; its yuv422 is UYVY.
ENCODINGS: dict[str, tuple[int, int | None]] = {
    "mono8": (1, None),
    "8UC1": (1, None),
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "8UC4": (4, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUYV),
    "yuyv": (2, cv2.COLOR_YUV2BGR_YUYV),
    # OpenCV names a pattern by its second row.
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2BGR),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2BGR),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2BGR),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2BGR),
}
DEEP = ("mono16", "16UC1")


class DamagedImageError(ValueError):
    """An image message whose content is not whole."""


class ImageFiles:
    """Turns image messages into files.

    bits: that the deepest of 16-bit images fill, told by the first of them; both cameras must be
    scaled alike, so that one object serves both.
    """

    def __init__(self) -> None:
        self.bits: int | None = None

    def file(self, topic: str, kind: str, message: Any) -> tuple[str, bytes]:
        """Ending and bytes of the file of one message; kind: its type.

        Raises:
            InputError: an encoding that is not known here; DamagedImageError.
        """
        if kind == COMPRESSED:
            return image_file(bytes(message.data))
        return "png", encode(self._pixels(topic, message))

    def _pixels(self, topic: str, message: Any) -> np.ndarray:
        encoding = message.encoding
        if encoding in DEEP:
            order = ">u2" if message.is_bigendian else "<u2"
            return self._scaled(_rows(message, 2).view(order).astype(np.uint16))
        if encoding not in ENCODINGS:
            known = ", ".join((*ENCODINGS, *DEEP))
            raise InputError(f"{topic}: encoding '{encoding}' is not known here (known: {known})")
        size, code = ENCODINGS[encoding]
        pixels = _rows(message, size)
        if size > 1:
            pixels = pixels.reshape(len(pixels), -1, size)
        return pixels if code is None else cv2.cvtColor(pixels, code)

    def _scaled(self, image: np.ndarray) -> np.ndarray:
        """8 bits of 16: cameras put 10, 12 or 14 into them."""
        if self.bits is None:
            self.bits = max(8, int(image.max(initial=0)).bit_length())
        return cv2.convertScaleAbs(image, alpha=255.0 / (2**self.bits - 1))


def encode(image: np.ndarray) -> bytes:
    """A PNG, with the least compression, which is the fastest."""
    _, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return data.tobytes()


def _rows(message: Any, size: int) -> np.ndarray:
    """Bytes (H, W * size) of an image; what pads its rows is left out."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    step = step or width * size
    data = np.asarray(message.data, np.uint8)
    if width < 1 or height < 1 or step < width * size or data.size < step * height:
        raise DamagedImageError(
            f"{width}x{height} pixels of {size} bytes in rows of {step}, {data.size} bytes"
        )
    rows = data[: step * height].reshape(height, step)[:, : width * size]
    return np.ascontiguousarray(rows)


def image_file(data: bytes) -> tuple[str, bytes]:
    """Ending and bytes of an image that is a file already: as it is where it is a JPEG or a PNG,
    else made a PNG.

    Raises:
        DamagedImageError: cut short, or no image.
    """
    for start, ending in ((JPEG_START, "jpg"), (PNG_START, "png")):
        if data.startswith(start):
            if is_cut_short(data[:8], data[-TAIL:]):
                raise DamagedImageError("cut short")
            return ending, data
    image = decode_image(data)
    if isinstance(image, str):
        raise DamagedImageError(image)
    return "png", encode(image)
