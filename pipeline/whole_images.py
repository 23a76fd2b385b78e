"""Rectified whole images: every row, not only those that can hold obstacles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.rig import Mount, StereoRig
from pipeline.recordings.base import RecordedPair
from stereo.rectify import Rectifier

EVERY_ROW = (-1e3, 1e3)  # heights of interest that leave no row out [m]
NEAREST = 0.1  # m


def whole_rectifier(rig: StereoRig, mount: Mount | None = None) -> Rectifier:
    """Rectifier of whole images for that mount; None: turned no more than rectification needs."""
    return Rectifier(rig.with_mount(mount or Mount()), EVERY_ROW, NEAREST)


def spread(pairs: Sequence[RecordedPair], most: int) -> list[RecordedPair]:
    """At most so many pairs, evenly from first to last."""
    chosen = np.linspace(0, len(pairs) - 1, min(most, len(pairs))).round().astype(int)
    return [pairs[i] for i in chosen]
