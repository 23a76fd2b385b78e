"""One image of one camera: a file, or a half of a side-by-side file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np


@dataclass(frozen=True, order=True)
class ImageSource:
    """Where an image is.

    half: "left" or "right" of a file that holds both cameras' images; None: the whole file.
    """

    path: Path
    half: str | None = None

    @property
    def name(self) -> str:
        """The image as a message names it."""
        return f"{self.path.name} ({self.half} half)" if self.half else self.path.name

    def decode(self, data: bytes) -> np.ndarray | None:
        """The grey image uint8 (H, W) in the file's bytes, or None when they hold none."""
        image = decode_grey(data)
        if image is None or self.half is None:
            return image
        middle = image.shape[1] // 2
        half = image[:, :middle] if self.half == "left" else image[:, middle : 2 * middle]
        return np.ascontiguousarray(half)

    def read(self) -> np.ndarray | None:
        """The grey image uint8 (H, W), or None when the file cannot be read."""
        try:
            return self.decode(self.path.read_bytes())
        except OSError:
            return None


def decode_grey(data: bytes) -> np.ndarray | None:
    """An image file's bytes as grey uint8 (H, W), or None.

    Images of more than 8 bits are stretched so that their brightest pixels are white: cameras of
    10 or 12 bits fill only the lower part of 16.
    """
    if not data:
        return None
    try:
        image = cv2.imdecode(
            np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH
        )
    except cv2.error:
        return None
    if image is None or image.dtype == np.uint8:
        return image
    grey = np.nan_to_num(image.astype(np.float64), posinf=0.0, neginf=0.0)
    white = max(float(np.percentile(grey, 99.9)), 1e-12)
    return np.clip(np.rint(grey * (255 / white)), 0, 255).astype(np.uint8)
