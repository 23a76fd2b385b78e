"""StereoPair: what the cameras deliver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class StereoPair:
    """One raw (unrectified) image pair.

    stamp: integer nanoseconds; left, right: uint8 or uint16, (H, W) or (H, W, 3) BGR.
    """

    stamp: int
    left: np.ndarray
    right: np.ndarray
