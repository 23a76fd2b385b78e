"""Is the board as large as we were told? All lengths of the rig hang on the size of its squares.

The images alone cannot tell: a board twice as large, twice as far away, gives the same pixels.
A ruler held along the two lenses can, and so can common sense.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibration.board import Board
from calibration.solution import StereoSolution
from calibration.triangulate import triangulate

RULER_SIGMA = 1e-3  # m: two lenses are measured to a millimetre, no better
DISAGREEMENT = 3.0  # sigmas beyond which ruler and boards do not mean the same baseline
BOARD_LIMITS = (0.03, 1.5)  # m: diagonal of a board that a person prints and holds
UNIT_MATCH = 0.2  # how near a factor of ten a ratio must be to be a mistaken unit


@dataclass(frozen=True)
class Squares:
    """Distances between neighbouring corners, triangulated, over those on the board.

    ratio: their mean; a rig that fits its own boards gives 1 within a few tenths of a per cent.
    scatter: their standard deviation, for a single distance.
    """

    ratio: float
    scatter: float


@dataclass(frozen=True)
class RulerCheck:
    """The baseline from the boards against the one measured with a ruler [m].

    square: the size of the board's squares that would make them agree [m].
    """

    baseline: float
    ruler: float
    sigma: float
    square: float

    @property
    def excess(self) -> float:
        """How much longer the boards make the baseline than the ruler, as a share."""
        return self.baseline / self.ruler - 1.0

    @property
    def agrees(self) -> bool:
        """Whether the difference is one that the ruler may have made."""
        return abs(self.baseline - self.ruler) <= DISAGREEMENT * self.sigma


def reconstructed_squares(solution: StereoSolution, board: Board) -> Squares:
    """Triangulate the corners kept in both images and compare neighbours with the board."""
    ratios = []
    for view, (kept_left, kept_right) in zip(solution.views, solution.kept, strict=True):
        ids, left, right = view.common()
        kept = np.isin(ids, view.left.ids[kept_left]) & np.isin(ids, view.right.ids[kept_right])
        points = np.full(board.points.shape, np.nan)
        points[ids[kept]] = triangulate(solution.rig, left[kept], right[kept])
        ratios.append(_lengths(points, board) / _lengths(board.points, board))
    every = np.concatenate(ratios)
    known = every[np.isfinite(every)]
    if not known.size:
        return Squares(math.nan, math.nan)
    return Squares(float(known.mean()), float(known.std()))


def check_ruler(solution: StereoSolution, square: float, ruler: float) -> RulerCheck:
    """Hold the baseline against the one that a person measured.

    Args:
        square: size of a square as given [m]. ruler: distance between the lenses [m].
    """
    baseline = solution.rig.baseline
    direction = solution.rig.T / baseline
    at = [solution.names.index(f"translation.{axis}") for axis in "xyz"]
    variance = direction @ solution.covariance[np.ix_(at, at)] @ direction
    sigma = math.sqrt(RULER_SIGMA**2 + variance)
    return RulerCheck(baseline, ruler, sigma, square * ruler / baseline)


def doubtful_size(board: Board, ruler: RulerCheck | None) -> str | None:
    """What is wrong with the size of the squares, with the remedy; None when it may be right."""
    extent = np.ptp(board.points, axis=0)[:2]
    size = f"{extent[0] * 1e3:.4g} x {extent[1] * 1e3:.4g} mm"
    if ruler is not None and not ruler.agrees:
        given, likely = board.square * 1e3, ruler.square * 1e3
        told = (
            f"the ruler says {ruler.ruler * 1e3:.1f} mm from lens to lens, the boards "
            f"{ruler.baseline * 1e3:.1f} mm ({abs(ruler.excess):.1%} "
            f"{'more' if ruler.excess > 0 else 'less'}): "
        )
        if _is_unit(ruler.ruler / ruler.baseline):
            return f"{told}check the unit of --square: {given:g} mm may well be {likely:.3g} mm"
        return (
            f"{told}the squares are probably {likely:.2f} mm, not {given:g}: "
            "measure the board again, over many squares"
        )
    low, high = BOARD_LIMITS
    diagonal = float(np.hypot(*extent))
    if low <= diagonal <= high:
        return None
    extreme = "larger than any sheet of paper" if diagonal > high else "the size of a stamp"
    square = f"{board.square * 1e3:g} mm"
    return f"check the unit of --square: with {square} the board is {extreme} ({size})"


def _is_unit(factor: float) -> bool:
    power = math.log10(factor)
    return abs(round(power)) >= 1 and abs(power - round(power)) < math.log10(1 + UNIT_MATCH)


def _lengths(points: np.ndarray, board: Board) -> np.ndarray:
    """Distances between the board's neighbours, where points (m, 3) are."""
    a, b = board.neighbours.T
    return np.linalg.norm(points[a] - points[b], axis=1)
