"""What a solved rig is worth: everything that is measured of it, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calibration.attitudes import Attitudes, attitudes
from calibration.board import Board
from calibration.coverage import Coverage, coverage
from calibration.depth_doubt import DepthDoubt, depth_doubt
from calibration.heldout import HeldOut
from calibration.misfits import Misfits, find_misfits
from calibration.scale_check import (
    RulerCheck,
    Squares,
    check_ruler,
    doubtful_size,
    reconstructed_squares,
)
from calibration.solution import StereoSolution
from calibration.timing import Timing, judge_timing
from calibration.verdict import verdict


@dataclass(frozen=True, eq=False)
class Judgement:
    """What is measured of a solution. Views count as in the solution.

    verdict: a word of `calibration.verdict`, by the held-out row error alone.
    coverage: of the left and of the right camera's images, by the boards that were used.
    attitudes: of the boards that were used.
    size_doubt: what is wrong with the size of the squares, or None.
    """

    verdict: str
    coverage: tuple[Coverage, Coverage]
    attitudes: Attitudes
    misfits: Misfits
    timing: Timing
    squares: Squares
    ruler: RulerCheck | None
    size_doubt: str | None
    depth: DepthDoubt


def judge(
    solution: StereoSolution,
    heldout: HeldOut,
    board: Board,
    stamps: Sequence[int | None],
    ruler: float | None = None,
) -> Judgement:
    """Judge a solution.

    Args:
        stamps: of each view [ns], None for a still.
        ruler: distance between the lenses as a person measured it [m].
    """
    used = list(solution.used_views)
    views = [solution.views[index] for index in used]
    misfits = find_misfits(solution)
    ruler_check = None if ruler is None else check_ruler(solution, board.square, ruler)
    size = solution.rig.image_size
    return Judgement(
        verdict=verdict(heldout.row_rms),
        coverage=(
            coverage(size, [view.left.corners for view in views]),
            coverage(size, [view.right.corners for view in views]),
        ),
        attitudes=attitudes(solution.poses[used], solution.points),
        misfits=misfits,
        timing=judge_timing(solution, misfits, stamps),
        squares=reconstructed_squares(solution, board),
        ruler=ruler_check,
        size_doubt=doubtful_size(board, ruler_check),
        depth=depth_doubt(solution),
    )
