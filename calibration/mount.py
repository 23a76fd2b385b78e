"""Height, pitch and roll of the left camera from the floor that many pairs show.

samples of all disparities -> the plane they share (`floor`) -> both images aligned through it
(`floor_alignment`) -> mount of the raw camera, with its doubt.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.floor import RectifiedView, find_floor
from calibration.floor_alignment import FloorFrame, align_floor

SAMPLES = 20_000  # disparities drawn from all frames together
# Nothing is known better than this, however well the frames agree: relative height, rad.
LEAST_DOUBT = (0.001, math.radians(0.03), math.radians(0.03))


@dataclass(frozen=True)
class FloorMount:
    """Height [m], pitch and roll [rad] of the raw left camera, each with a standard deviation.

    The deviations come from the scatter over the `frames` frames that show the floor. What the
    frames share they do not hold: an error of the rig, above all of the angle between the
    cameras, which turns into pitch times height over baseline.
    """

    height: float
    pitch: float
    roll: float
    sigma: tuple[float, float, float]
    frames: int


def mount_from_floor(
    frames: Sequence[FloorFrame], view: RectifiedView, seed: int = 0
) -> FloorMount:
    """The mount that the floor in these frames tells.

    Raises:
        CalibrationError: no floor is in view, or in too few frames.
    """
    floor = find_floor(drawn_samples(frames, seed), view, seed)
    aligned = align_floor(frames, view, floor)
    values = view.mount(aligned.plane)
    nudges = np.diag(1e-5 * (abs(aligned.plane) + 1e-3))
    J = np.array(
        [
            (view.mount(aligned.plane + h) - view.mount(aligned.plane - h)) / (2.0 * h.sum())
            for h in nudges
        ]
    ).T
    scatter = np.sqrt(np.diag(J @ aligned.covariance @ J.T))
    least = np.array(LEAST_DOUBT) * (values[0], 1.0, 1.0)
    sigma = np.hypot(scatter, least).tolist()
    return FloorMount(*values.tolist(), sigma=tuple(sigma), frames=aligned.frames)


def drawn_samples(frames: Sequence[FloorFrame], seed: int, most: int = SAMPLES) -> np.ndarray:
    """At most so many pixels and disparities (n, 3) [px], as many from each frame."""
    each = max(1, most // max(len(frames), 1))
    drawn = []
    for number, frame in enumerate(frames):
        v, u = np.nonzero(frame.disparity > 0)
        chance = np.random.default_rng((seed, 1, number))
        some = chance.choice(len(u), min(each, len(u)), replace=False)
        drawn.append(np.column_stack([u[some], v[some], frame.disparity[v[some], u[some]]]))
    return np.concatenate(drawn).astype(float) if drawn else np.zeros((0, 3))
