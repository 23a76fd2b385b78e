"""Do both cameras look at the same instant? Signs of exposures that differ.

A board held in the hand moves. Cameras that expose one after the other see it in two places, in
many pairs rather than in one. Where the images have time stamps the delay itself can be told: the
board lies beside its place by its speed in the image times the delay, pair after pair.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.misfits import Misfits
from calibration.solution import StereoSolution

MANY = 0.25  # share of pairs, and
FEWEST = 3  # this many of them, that make it the cameras' fault and not a pair's
USUALLY_APART = 0.25  # px: a median distance that still boards do not show, if it is more
# than the usual error within the images, too: a lens that fits badly shows both
MOST_DOUBT = 1.5  # noises of a corner: of a view that can tell; of whole boards it is less
LONGEST_STEP = 0.5  # s between two pairs that a speed may be told from
SIGNIFICANT = 4.0  # sigmas
LEAST_SPEEDS = 8


@dataclass(frozen=True)
class Timing:
    """What speaks for exposures that differ.

    moved: in how many views the images are right by themselves and miss each other.
    usual: median distance by which they do [px]; usual_bent: median error within an image [px].
    delay, delay_sigma: of the right camera's exposure behind the left one's [s]; None where
        stamps do not tell.
    """

    views: int
    moved: int
    usual: float
    usual_bent: float
    delay: float | None = None
    delay_sigma: float | None = None

    @property
    def delayed(self) -> bool:
        """Whether the delay is certain and long enough to matter."""
        if self.delay is None or self.delay_sigma is None:
            return False
        return abs(self.delay) > max(SIGNIFICANT * self.delay_sigma, 1e-3)

    @property
    def usually_apart(self) -> bool:
        """Whether most pairs show a board that moved."""
        return self.usual > max(USUALLY_APART, self.usual_bent)

    @property
    def unsynchronised(self) -> bool:
        """Whether the cameras seem not to expose together."""
        many = self.moved >= max(FEWEST, MANY * self.views)
        return many or self.usually_apart or self.delayed


def judge_timing(
    solution: StereoSolution, misfits: Misfits, stamps: Sequence[int | None]
) -> Timing:
    """Look for signs of exposures that differ.

    Args:
        stamps: of each view [ns], None for a still.
    """
    # Those that can tell: right by themselves, and with enough of the board.
    still = ~misfits.is_bent.any(axis=1) & (misfits.apart_doubt < MOST_DOUBT * misfits.noise)
    usual = float(np.median(misfits.distance[still])) if np.sum(still) >= FEWEST else 0.0
    usual_bent = float(np.median(misfits.bent))
    found = Timing(len(solution.views), int(misfits.is_apart.sum()), usual, usual_bent)
    speeds = image_speeds(solution, stamps)
    told = still & np.isfinite(speeds).all(axis=1)
    if np.count_nonzero(told) < LEAST_SPEEDS:
        return found
    v, a = speeds[told].ravel(), misfits.apart[told].ravel()
    power = float(v @ v)
    if power <= 0.0:
        return found
    delay = float(v @ a) / power
    noise = 1.4826 * float(np.median(np.abs(a - delay * v)))
    return replace(found, delay=delay, delay_sigma=noise / math.sqrt(power))


def image_speeds(solution: StereoSolution, stamps: Sequence[int | None]) -> np.ndarray:
    """(views, 2) speed of the board in the right image [px/s]; NaN where stamps do not tell.

    From the shift of its corners to the view before and the view after, both close in time.
    """
    speeds = np.full((len(stamps), 2), np.nan)
    for index in range(1, len(stamps) - 1):
        before, now, after = stamps[index - 1], stamps[index], stamps[index + 1]
        if before is None or now is None or after is None:
            continue
        seconds = (after - before) * 1e-9
        if not 0.0 < seconds <= 2.0 * LONGEST_STEP:
            continue
        earlier, later = (solution.views[index + step].right for step in (-1, 1))
        _, a, b = np.intersect1d(earlier.ids, later.ids, return_indices=True)
        if len(a):
            shift = later.corners[b] - earlier.corners[a]
            speeds[index] = np.median(shift, axis=0) / seconds
    return speeds
