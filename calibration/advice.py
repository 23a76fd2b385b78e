"""What to do next, in words: the most useful thing first.

In the order in which things matter: a wrong size of the squares spoils every length, a wrong
pair spoils the rest, cameras that do not expose together cannot be calibrated by hand, and only
then does it pay to take more pairs, of the kind that is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.coverage import POOR
from calibration.heldout import HeldOut
from calibration.judgement import Judgement
from calibration.solution import StereoSolution
from calibration.verdict import REDO

ENOUGH_PAIRS = 10
MOST_NAMED = 4  # more empty regions than that are told in one word
ODD_ROWS = 3.0  # times the median of the pairs' row errors makes a pair an odd one, ...
LEAST_ODD_ROWS = 0.3  # ... from this error on [px]
ROUGH = 0.4  # px RMS: corners of sharp images of a flat board fit better
SHARP = "in focus, of a flat board, held still in good light"
TILT = "by 20 to 40 deg"
NOTHING = "nothing to mend: find out next how the cameras sit on the robot"


@dataclass(frozen=True, eq=False)
class Case:
    """What the advice is drawn from; names: of the solution's views."""

    solution: StereoSolution
    heldout: HeldOut
    judgement: Judgement
    names: Sequence[str]


def advise(case: Case) -> list[str]:
    """What to do, the most useful first; never empty."""
    advice = [*_about_size(case), *_about_timing(case)]
    # What else seems wrong with pairs of a board that moved is no fault of theirs.
    if not case.judgement.timing.unsynchronised:
        advice += [*_about_pairs(case), *_about_corners(case)]
    if case.judgement.verdict == REDO and not advice:
        advice = [f"take all pairs again, {SHARP}"]
    advice += _about_views(case)
    if not case.judgement.timing.unsynchronised:
        advice += _about_doubt(case)
    return advice or [NOTHING]


def faults(case: Case) -> list[str | None]:
    """What is wrong with each view, as it follows "drop pair 02: "; None for the good ones."""
    return [
        case.judgement.misfits.fault(index)
        or ("its corners do not fit the other pairs" if left_out(case, index) else None)
        or _odd_rows(case.heldout, index)
        for index in range(len(case.names))
    ]


def left_out(case: Case, index: int) -> bool:
    """Whether the rig was solved without a view."""
    return index in case.solution.outlier_views


def _odd_rows(heldout: HeldOut, index: int) -> str | None:
    rms = heldout.view_rms
    usual = float(np.nanmedian(rms))
    # NaN where the two images of a pair show no corner in common.
    if not rms[index] > max(LEAST_ODD_ROWS, ODD_ROWS * usual):
        return None
    return f"its rows differ by {rms[index]:.2f} px where those of most pairs do by {usual:.2f}"


def _about_size(case: Case) -> Iterator[str]:
    if case.judgement.size_doubt:
        yield case.judgement.size_doubt


def _about_timing(case: Case) -> Iterator[str]:
    timing = case.judgement.timing
    if not timing.unsynchronised:
        return
    if timing.delayed and timing.delay is not None:
        late = "right" if timing.delay > 0 else "left"
        how = f"the {late} camera exposes about {abs(timing.delay) * 1e3:.0f} ms after the other"
    elif timing.usually_apart:
        how = f"the board moved between the exposures of most pairs, by about {timing.usual:.1f} px"
    else:
        how = f"the board moved between the exposures of {timing.moved} of {timing.views} pairs"
    yield f"synchronise the cameras, or rest the board on something while you shoot: {how}"


def _about_pairs(case: Case) -> Iterator[str]:
    """The wrong pairs, the worst first."""
    found = faults(case)
    rms = case.heldout.view_rms
    rows = np.nan_to_num(rms / max(float(np.nanmedian(rms)), 0.1) / ODD_ROWS)
    badness = np.maximum(case.judgement.misfits.badness, rows)
    for index in np.argsort(-badness, kind="stable"):
        fault = found[index]
        if fault is None:
            continue
        if left_out(case, index):
            yield f"drop pair {case.names[index]}: {fault}; the rig was solved without it"
        else:
            rest = _rows_without(case.heldout, index)
            gain = f"held-out rows without it: {rest:.2f} px"
            yield f"drop pair {case.names[index]}: {fault} ({gain})"


def _rows_without(heldout: HeldOut, index: int) -> float:
    """Held-out row error over the other views that were used [px RMS]."""
    used = [i for i, group in enumerate(heldout.groups) if group >= 0 and i != index]
    return float(np.sqrt(np.mean(np.concatenate([heldout.rows[i] for i in used]) ** 2)))


def _about_corners(case: Case) -> Iterator[str]:
    rms = case.solution.rms_kept
    if rms > ROUGH:
        yield f"take sharper pairs, {SHARP}: corners are off by {rms:.2f} px, where 0.2 px is usual"
    elif case.solution.rejection_capped:
        yield f"take sharper pairs, {SHARP}: too many corners to reject them all do not fit"


def _about_views(case: Case) -> Iterator[str]:
    """What kind of views is missing."""
    used = len(case.solution.used_views)
    stood = case.judgement.attitudes
    regions, lacking = _poor_regions(case), stood.lacking
    everywhere = len(regions) > MOST_NAMED
    where = " towards all sides of the image" if everywhere else _in_the(regions[:1])
    how = f", the board's {lacking[0]} edge nearer to the cameras {TILT}" if lacking else ""
    if used < ENOUGH_PAIRS:
        yield f"take at least {ENOUGH_PAIRS - used} more pairs: tilted views{where}{how}"
    elif regions or lacking:
        yield f"add tilted views{where}{how}"
    if everywhere:
        yield "the boards hardly left the middle of the image"
    elif len(regions) > 1:
        yield f"few or no boards{_in_the(regions[1:])} either"
    if len(lacking) > 1:
        yield f"few boards with the {' or the '.join(lacking[1:])} edge nearer either"
    if stood.one_distance:
        yield (
            f"add views from farther away: all boards are about {np.median(stood.distances):.2g} m "
            "from the cameras"
        )


def _in_the(regions: Sequence[str]) -> str:
    return f" in the {', '.join(regions)}" if regions else ""


def _poor_regions(case: Case) -> list[str]:
    """Regions of the image that few boards covered, in the two images together."""
    left, right = case.judgement.coverage
    shares = {name: 0.5 * (left.regions[name] + right.regions[name]) for name in left.regions}
    return [name for name in sorted(shares, key=shares.__getitem__) if shares[name] < POOR]


def _about_doubt(case: Case) -> Iterator[str]:
    depth = case.judgement.depth
    at = int(np.searchsorted(depth.distances, depth.usable_range, side="right")) - 1
    if depth.from_calibration[max(at, 0)] > depth.from_matching[max(at, 0)]:
        yield (
            "take more pairs, the board larger in the image and more tilted: the doubt of the "
            "calibration is the larger part of the error of depth"
        )
