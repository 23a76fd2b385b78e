"""The simplest lens model that no richer one clearly beats on pairs left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.errors import CalibrationError
from calibration.heldout import HeldOut, held_out
from calibration.lens import LENSES
from calibration.rotation import turn_matrix
from calibration.sighting import PairSighting
from calibration.solution import StereoSolution
from calibration.solve import solve_stereo

SIMPLEST = "radtan4"
RICHER = ("radtan5", "rational")
# A richer lens must lower the held-out row error by this share, and by more than chance.
CLEAR_GAIN = 0.05
CHANCE = 1.0  # standard errors over the pairs
# A fisheye lens is tried when boards were seen this far off the axis, or where the simplest lens
# does not do.
WIDE = np.radians(50.0)
BAD_FIT = 0.5  # px


@dataclass(frozen=True)
class LensTrial:
    """What one lens model gave.

    rms: reprojection error over all corners, row_rms: held-out row error [px]; both None when
    the views do not determine the lens. remark: why it was chosen or not.
    """

    lens: str
    rms: float | None
    row_rms: float | None
    chosen: bool
    remark: str


def choose_lens(
    views: Sequence[PairSighting], points: np.ndarray, image_size: tuple[int, int]
) -> tuple[StereoSolution, HeldOut, list[LensTrial]]:
    """Solve with the simplest lens, and with richer ones as long as they may do better.

    Arguments as in `solve_stereo`.

    Returns:
        the solution with the chosen lens, its held-out errors, and every trial.

    Raises:
        CalibrationError: no lens explains the views; what speaks against the simplest.
    """
    best: StereoSolution | None = None
    best_held: HeldOut | None = None
    refusal: CalibrationError | None = None
    trials: list[LensTrial] = []
    for lens in (SIMPLEST, *RICHER, "fisheye"):
        if lens == "fisheye" and best is not None and not _may_be_fisheye(best):
            continue
        try:
            # A bad fit leads astray.
            start = best if best is not None and best.rms < BAD_FIT else None
            solution = solve_stereo(views, points, image_size, lens, start)
        except CalibrationError as error:
            refusal = refusal or error
            trials.append(LensTrial(lens, None, None, False, str(error).partition(":")[0]))
            continue
        held = held_out(solution)
        better, remark = True, "the simplest"
        if best is not None and best_held is not None:
            better, remark = _compare(solution, held, best, best_held)
        trials.append(LensTrial(lens, solution.rms, held.row_rms, False, remark))
        if better:
            best, best_held = solution, held
    if best is None or best_held is None:
        assert refusal is not None
        raise refusal
    trials = [replace(trial, chosen=trial.lens == best.lens) for trial in trials]
    return best, best_held, trials


def _compare(
    other: StereoSolution, other_held: HeldOut, best: StereoSolution, best_held: HeldOut
) -> tuple[bool, str]:
    """Whether the other lens is to be preferred to the best so far, and why."""
    if LENSES[other.lens].wide:
        # Rows on a plane stretch without bound towards the rim: both on a sphere.
        best_held = held_out(best, spherical=True)
    common = sorted(set(other.used_views) & set(best.used_views))
    rms, rms_before = (
        float(np.sqrt(np.mean(np.concatenate([held.rows[i] for i in common]) ** 2)))
        for held in (other_held, best_held)
    )
    gain = (best_held.view_rms - other_held.view_rms)[common]
    chance = gain.std(ddof=1) / np.sqrt(len(gain))
    figures = f"held-out row error {rms:.3f} px, {best.lens} {rms_before:.3f} px"
    if rms < (1 - CLEAR_GAIN) * rms_before and gain.mean() > CHANCE * chance:
        return True, f"clearly better: {figures}"
    fewer = len(LENSES[other.lens].names) < len(LENSES[best.lens].names)
    if fewer and rms <= (1 + CLEAR_GAIN) * rms_before and other.rms <= (1 + CLEAR_GAIN) * best.rms:
        return True, f"as good with fewer numbers: {figures}"
    if rms > (1 + CLEAR_GAIN) * rms_before:
        return False, f"over-fitting: {figures}"
    return False, f"not clearly better: {figures}"


def _may_be_fisheye(solution: StereoSolution) -> bool:
    """Boards stood far off the axis, or the simplest lens does not do."""
    if solution.lens != SIMPLEST or solution.rms > BAD_FIT:
        return True
    poses = solution.poses
    boards = solution.points @ np.swapaxes(turn_matrix(poses[:, :3]), 1, 2) + poses[:, None, 3:]
    off_axis = np.arctan2(np.hypot(boards[..., 0], boards[..., 1]), boards[..., 2])
    return bool(off_axis.max() > WIDE)
