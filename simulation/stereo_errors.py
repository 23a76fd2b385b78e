"""The paper's stereo error model: depth noise and false blocks (Sec. IV-C, eqs (11), (12)).

    noise:  every depth gets a Gaussian error, sd a share of the depth
    blocks: `blocks` times a frame a stretch of neighbouring directions gets one false depth d,
            d ~ N(4.886, 1.773) m within the depth range R,
            width ~ N(3 alpha (R - d) / R + 3 alpha, 3) deg  (alpha = 5/3: eq (11)), R = 8 m,
            centre uniform in the field of view

The range vector is by definition the nearest depth of a column: of a true and a false match the
nearer is kept ("nearest"). "replace" is the other reading: the false depth stands in any case.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import ndtr, ndtri

from stereo.scan import RangeScan

FALSE_DEPTH_MEAN, FALSE_DEPTH_SD = 4.886, 1.773  # m
WIDTH_SD = 3.0  # deg

# Keys of the random generators: (seed, purpose, frame). Each purpose draws the same numbers
# whatever the settings, so that two values of alpha are compared on the same noise.
DEPTH_PURPOSE, BLOCK_PURPOSE = 11, 12


@dataclass(frozen=True)
class StereoErrors:
    """depth_noise: sd as a share of the depth; alpha, blocks, false_depth: of the false blocks;
    max_range: the end R of the depth range [m]."""

    depth_noise: float = 0.02
    alpha: float = 5.0 / 3.0
    blocks: int = 1
    false_depth: Literal["nearest", "replace"] = "nearest"
    max_range: float = 8.0

    def measure(self, true: np.ndarray, bearing: np.ndarray, seed: int, frame: int) -> np.ndarray:
        """What the camera measures in one frame.

        Args:
            true: (n,) true ranges [m], not cut at `max_range`; +inf nothing, NaN no answer.
            bearing: (n,) rad, increasing.

        Returns:
            (n,) m; +inf beyond `max_range`, NaN where there was and is no answer.
        """
        chance = np.random.default_rng((seed, DEPTH_PURPOSE, frame)).standard_normal(len(true))
        measured = true * (1.0 + self.depth_noise * chance)
        chance = np.random.default_rng((seed, BLOCK_PURPOSE, frame)).random((self.blocks, 3))
        for depth, low, high in self.false_blocks(chance, bearing[0], bearing[-1]):
            inside = (bearing >= low) & (bearing <= high)
            keeps = (measured < depth) if self.false_depth == "nearest" else np.False_
            measured = np.where(inside & ~keeps, depth, measured)
        return np.where(measured > self.max_range, np.inf, measured)

    def seen(self, scan: RangeScan, seed: int, frame: int) -> RangeScan:
        """A laser's scan as the camera would have measured it, beam by beam.

        Beyond the reach of the laser nobody knows: there the camera's reach ends too.
        """
        ranges = self.measure(scan.range, scan.bearing, seed, frame)
        reach = min(self.max_range, scan.max_range)
        ranges = np.where(ranges > reach, np.inf, ranges)
        doubt = self.depth_noise * np.where(np.isfinite(ranges), ranges, np.nan)
        return replace(scan, range=ranges, sigma=doubt, max_range=reach)

    def false_blocks(self, chance: np.ndarray, right: float, left: float) -> np.ndarray:
        """(k, 3) false depth [m], first and last bearing [rad] of k blocks.

        chance: (k, 3) uniform in [0, 1), one each for depth, width and centre; the field of view
        reaches from `right` to `left` [rad].
        """
        reach = self.max_range
        least, most = ndtr((np.array([0.0, reach]) - FALSE_DEPTH_MEAN) / FALSE_DEPTH_SD)
        between = least + (most - least) * chance[:, 0]
        depth = FALSE_DEPTH_MEAN + FALSE_DEPTH_SD * ndtri(between)
        mean = 3.0 * self.alpha * (reach - depth) / reach + 3.0 * self.alpha  # eq (12)
        # random() may return 0 exactly, where ndtri is -inf; a width is at least 0 anyway.
        width = np.radians(np.maximum(mean + WIDTH_SD * ndtri(chance[:, 1]), 0.0))
        centre = right + (left - right) * chance[:, 2]
        return np.stack([depth, centre - width / 2.0, centre + width / 2.0], axis=1)
