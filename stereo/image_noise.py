"""Noise of an image's gradients, measured where the image shows the least."""

from __future__ import annotations

import cv2
import numpy as np

BLOCK = 8  # px
# Of the blocks, this share is taken to show nothing but noise.
SMOOTHEST = 0.03
# Half a grey level in Sobel's operator, which sums four differences over two pixels.
LEAST = 2.0
# Noise of 7 grey levels. What shows more in its smoothest blocks is textured everywhere.
MOST = 24.0


def gradient_noise(gradients: np.ndarray, first: np.ndarray, last: np.ndarray) -> float:
    """Root mean square of the gradients (H, W) int16 in the smoothest blocks of an image.

    first, last: (H,) first column and one past the last that the camera saw, in every row; the
    rim outside them shows no noise at all. Never below LEAST: compression leaves such blocks too;
    never above MOST.
    """
    rows, columns = (n // BLOCK for n in gradients.shape)
    if not rows * columns:
        return LEAST
    squares = np.square(gradients[: rows * BLOCK, : columns * BLOCK].astype(np.float32))
    means = cv2.resize(squares, (columns, rows), interpolation=cv2.INTER_AREA)
    begin = first[: rows * BLOCK].reshape(rows, BLOCK).max(axis=1, keepdims=True)
    end = last[: rows * BLOCK].reshape(rows, BLOCK).min(axis=1, keepdims=True)
    left = BLOCK * np.arange(columns)
    seen = means[(left >= begin) & (left + BLOCK <= end)]
    if not seen.size:
        return LEAST
    return min(max(LEAST, float(np.sqrt(np.quantile(seen, SMOOTHEST)))), MOST)
