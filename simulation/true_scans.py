"""TrueScans: what a perfect range sensor would have measured beside every rendered pair."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class TrueScans:
    """True ranges on the bearings of the rectified left camera's columns.

    stamp: (n,) int64 ns of the pairs;
    bearing: (b,) rad, left positive, strictly increasing, in the sensor's frame, as in a
        `RangeScan` of the same rig;
    range: (n, b) float32 m, horizontal distance from the left camera to the nearest surface seen
        in that column within the height band of the stereo stage's defaults; +inf = nothing in
        the band up to where the column reaches; NaN = the column's view of the band is blocked
        by something outside it or lies outside the image;
    texture: (n, b) float32, root mean square of the horizontal grey-level gradient of the
        noise-free left image over the pixels that show that surface [grey levels per pixel];
        NaN where range is not finite.
    """

    stamp: np.ndarray
    bearing: np.ndarray
    range: np.ndarray
    texture: np.ndarray

    def save(self, path: Path) -> None:
        """Write one compressed file; it appears whole or not at all."""
        partial = path.with_name(path.name + ".part")
        with partial.open("wb") as file:
            np.savez_compressed(
                file,
                stamp=self.stamp,
                bearing=self.bearing,
                range=self.range,
                texture=self.texture,
            )
        os.replace(partial, path)


def load_true_scans(path: Path) -> TrueScans:
    """Read what `TrueScans.save` wrote.

    Raises OSError, ValueError or KeyError when the file is missing or damaged.
    """
    with np.load(path) as data:
        return TrueScans(data["stamp"], data["bearing"], data["range"], data["texture"])
