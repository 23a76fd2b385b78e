"""What ranges of a stereo camera are wrong about, against the true ones (paper Sec. II-C, IV-C).

Every column whose true range is known is either

    unanswered   no range
    right        within tolerance of the truth
    false        a range that is off by more than that: an obstacle where none is
    false free   said to be free beyond its true obstacle: no range up to `max_range`, or one that
                 is too long by more than the tolerance (which is false as well)

The tolerance is max(10 % of the truth, 3 sigma, 2 cells of the map): what lies within it, stage 1
of the mapper takes in its stride. A *block* is a run of neighbouring false columns; where an
unanswered column lies between two of them the run goes on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

TOLERANCE = 0.10  # of the true range
TOLERANCE_SIGMAS = 3.0
TOLERANCE_CELLS = 2.0
# A false range that is right for a column so near stands at the edge of something [rad].
EDGE = math.radians(1.0)
# 68.3 % of a normal distribution lie within one standard deviation.
ONE_SIGMA = 0.6827


@dataclass(frozen=True)
class Compared:
    """Measured and true ranges of the same columns.

    bearing: (b,) rad, increasing; measured, sigma, truth: (n, b) m, n frames. NaN: no answer, or
    the truth is not known; +inf: nothing up to `max_range` m. depth_factor: f B [m px];
    cell: side of a map cell [m].
    """

    bearing: np.ndarray
    measured: np.ndarray
    sigma: np.ndarray
    truth: np.ndarray
    max_range: float
    depth_factor: float
    cell: float

    def __post_init__(self) -> None:
        assert self.measured.shape == self.sigma.shape == self.truth.shape
        assert self.truth.shape[1] == self.bearing.size

    @property
    def tolerance(self) -> np.ndarray:
        """How far (n, b) m a range may be off and still be right."""
        sigma = np.where(np.isfinite(self.sigma), self.sigma, 0.0)
        allowed = np.maximum(TOLERANCE_SIGMAS * sigma, TOLERANCE_CELLS * self.cell)
        return np.fmax(TOLERANCE * np.where(np.isfinite(self.truth), self.truth, 0.0), allowed)


@dataclass(frozen=True)
class Classes:
    """Masks (n, b) of the columns; known: those whose truth is known."""

    known: np.ndarray
    unanswered: np.ndarray
    right: np.ndarray
    false: np.ndarray
    false_free: np.ndarray


@dataclass(frozen=True)
class Blocks:
    """Runs of false columns: frame (k,), width (k,) rad, range (k,) m (median of its columns)."""

    frame: np.ndarray
    width: np.ndarray
    range: np.ndarray


def classify(compared: Compared) -> Classes:
    """Put every column into its class."""
    c = compared
    known = ~np.isnan(c.truth)
    answered = known & ~np.isnan(c.measured)
    # Obstacles farther than the camera is trusted are none that it could miss.
    there = np.where(c.truth > c.max_range, np.inf, c.truth)
    tolerance = c.tolerance
    with np.errstate(invalid="ignore"):
        off = np.abs(c.measured - c.truth)  # inf - inf: NaN, both say that nothing is there
        false = answered & np.isfinite(c.measured) & (off > tolerance)
        too_far = answered & (np.minimum(c.measured, c.max_range) > there + tolerance)
    right = answered & ~false & ~too_far
    return Classes(known, known & ~answered, right, false, too_far)


def find_blocks(compared: Compared, classes: Classes) -> Blocks:
    """Runs of neighbouring false columns of every frame."""
    spacing = np.gradient(compared.bearing)
    rows: list[tuple[int, float, float]] = []
    for frame, (false, silent) in enumerate(zip(classes.false, classes.unanswered, strict=True)):
        columns = np.flatnonzero(false)
        if not columns.size:
            continue
        # How many columns that are neither false nor silent lie before each column.
        others = np.cumsum(~(false | silent))
        breaks = np.flatnonzero(np.diff(others[columns]) > 0) + 1
        for run in np.split(columns, breaks):
            width = float(np.sum(spacing[run[0] : run[-1] + 1]))
            rows.append((frame, width, float(np.median(compared.measured[frame, run]))))
    frames, widths, ranges = np.array(rows).reshape(-1, 3).T
    return Blocks(frames.astype(int), widths, ranges)


def disparity_errors(compared: Compared, classes: Classes) -> list[np.ndarray]:
    """Measured less true disparity [px] of right columns, frame by frame; finite ranges only."""
    factor = compared.depth_factor / np.cos(compared.bearing)
    with np.errstate(invalid="ignore", divide="ignore"):
        errors = factor / compared.measured - factor / compared.truth
    return _by_frame(errors, _ranged(compared, classes.right))


def relative_errors(compared: Compared, classes: Classes) -> list[np.ndarray]:
    """Measured over true range, less 1, of the right columns, frame by frame."""
    with np.errstate(invalid="ignore"):
        errors = compared.measured / compared.truth - 1.0
    return _by_frame(errors, _ranged(compared, classes.right))


def half_width(errors: np.ndarray) -> float:
    """Half the width of the middle 68.3 %: the standard deviation, deaf to outliers."""
    low, high = np.quantile(errors, (0.5 - ONE_SIGMA / 2, 0.5 + ONE_SIGMA / 2))
    return float(high - low) / 2.0


def at_edge(compared: Compared, classes: Classes) -> np.ndarray:
    """False columns (n, b) whose range is right for a column within EDGE of them."""
    count = compared.bearing.size
    reach = min(math.ceil(EDGE / float(np.mean(np.diff(compared.bearing)))), count - 1)
    tolerance = compared.tolerance
    found = np.zeros(classes.false.shape, bool)
    for step in range(-reach, reach + 1):
        here = slice(max(0, -step), count - max(0, step))
        there = slice(max(0, step), count + min(0, step))
        with np.errstate(invalid="ignore"):
            off = np.abs(compared.measured[:, here] - compared.truth[:, there])
        found[:, here] |= off <= tolerance[:, here]
    return classes.false & found


def in_sigmas(compared: Compared) -> list[np.ndarray]:
    """|measured - true| over the range's own sigma, frame by frame; columns where both ranges
    are finite, right or not."""
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = np.abs(compared.measured - compared.truth) / compared.sigma
    return _by_frame(scaled, _ranged(compared, ~np.isnan(compared.truth)))


def _ranged(compared: Compared, mask: np.ndarray) -> np.ndarray:
    return mask & np.isfinite(compared.measured) & np.isfinite(compared.truth)


def _by_frame(values: np.ndarray, mask: np.ndarray) -> list[np.ndarray]:
    return [row[chosen] for row, chosen in zip(values, mask, strict=True)]
