"""Whether a pair can be stereo at all: is there light, do both cameras see, do they differ?

A look at every eighth pixel of every eighth row (some 50 us), before any work is spent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STEP = 8
# Grey levels of 255. A closed lens shows nothing but the sensor's noise.
BLACK_MEAN, BLACK_SD = 8.0, 4.0
WHITE = 250
WHITE_SHARE = 0.95
# A camera whose image is so flat, while the other's is not, is covered.
FLAT_SD, NOT_FLAT_SD = 5.0, 15.0
# Two cameras differ by their noise and by what they see, two copies of an image hardly.
SAME_MEAN = 0.3

BLACK = "black images"
SATURATED = "saturated images"
LEFT_COVERED = "left camera covered"
RIGHT_COVERED = "right camera covered"
SAME = "left and right images are the same"


@dataclass(frozen=True)
class PairCheck:
    """defect: one of the words above, "" for a pair in order; brightness: mean of the left image
    over that of the right one."""

    defect: str
    brightness: float


def check_pair(left: np.ndarray, right: np.ndarray) -> PairCheck:
    """Look at a raw pair, (H, W) or (H, W, 3) each, uint8 or deeper.

    Images of different size are not judged: the rectifier names them.
    """
    a, b = left[::STEP, ::STEP], right[::STEP, ::STEP]
    # As the rectifier scales deeper images: by the least number of bits that holds both.
    bits = max(8, int(max(a.max(), b.max())).bit_length())
    a, b = (image.astype(np.float32) * (255.0 / (2**bits - 1)) for image in (a, b))
    means, deviations = (a.mean(), b.mean()), (a.std(), b.std())
    brightness = float((means[0] + 1.0) / (means[1] + 1.0))
    return PairCheck(_defect(a, b, means, deviations), brightness)


def _defect(a: np.ndarray, b: np.ndarray, means, deviations) -> str:
    dark = [m < BLACK_MEAN and s < BLACK_SD for m, s in zip(means, deviations, strict=True)]
    if all(dark):
        return BLACK
    if any(np.mean(image >= WHITE) > WHITE_SHARE for image in (a, b)):
        return SATURATED
    flat = [s < FLAT_SD for s in deviations]
    seeing = [s > NOT_FLAT_SD for s in deviations]
    if (flat[0] and seeing[1]) or (dark[0] and not dark[1]):
        return LEFT_COVERED
    if (flat[1] and seeing[0]) or (dark[1] and not dark[0]):
        return RIGHT_COVERED
    if a.shape == b.shape and not all(flat) and np.mean(np.abs(a - b)) < SAME_MEAN:
        return SAME
    return ""
