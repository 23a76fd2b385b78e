"""What goes to a page, as few bytes, made cheaply."""

from __future__ import annotations

import zlib

import cv2
import numpy as np

from stereo.encoded import TAIL, is_cut_short

# A camera's JPEG goes out as it came, unless it is larger than this [bytes].
LARGE = 180_000
WIDE, QUALITY = 640, 75  # [px] of images packed here


def packed(codes: np.ndarray) -> bytes:
    """zlib, at its fastest."""
    return zlib.compress(np.ascontiguousarray(codes).data, 1)


def jpeg(image: np.ndarray, wide: int = WIDE) -> bytes:
    """An image (H, W) or (H, W, 3), no wider than `wide`."""
    if image.dtype != np.uint8:
        image = (image >> 8).astype(np.uint8)
    if image.shape[1] > wide:
        height = round(image.shape[0] * wide / image.shape[1])
        image = cv2.resize(image, (wide, height), interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()


def camera_jpeg(data: bytes | np.ndarray) -> bytes | None:
    """What a camera sent: a JPEG or pixels; None: it is damaged."""
    if isinstance(data, np.ndarray):
        return jpeg(data)
    if not data or is_cut_short(data[:8], data[-TAIL:]):
        return None
    if len(data) > LARGE:
        small = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_REDUCED_COLOR_2)
        return None if small is None else jpeg(small)
    return data
