"""Noise of an image, measured where it shows the least (Lee and Hoppel 1989: smoothest blocks)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

BLOCK = 8  # px
# Of the blocks, this share is taken to show nothing but noise.
SMOOTHEST = 0.1


def grey_noise(image: np.ndarray) -> float:
    """Standard deviation of the noise [grey levels] of an image (H, W) uint8; 0 where it is too
    small to hold a block."""
    deviations = block_deviations(image)
    return float(np.quantile(deviations, SMOOTHEST)) if deviations.size else 0.0


@njit(cache=True, nogil=True)
def block_deviations(image):
    """(n,) standard deviation of the noise in each block, from second differences along rows:
    slopes do not count, and of white noise they have six times the variance."""
    rows, columns = image.shape
    down, across = rows // BLOCK, (columns - 2) // BLOCK
    deviations = np.empty(down * across)
    for i in range(down):
        for j in range(across):
            total = 0.0
            for v in range(i * BLOCK, (i + 1) * BLOCK):
                for u in range(j * BLOCK + 1, (j + 1) * BLOCK + 1):
                    second = (
                        float(image[v, u - 1]) - 2.0 * float(image[v, u]) + float(image[v, u + 1])
                    )
                    total += second * second
            deviations[i * across + j] = math.sqrt(total / (6.0 * BLOCK * BLOCK))
    return deviations
