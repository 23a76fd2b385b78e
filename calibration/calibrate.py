"""A new camera pair, from images of a board to a `StereoRig`: look, pair, solve, judge, advise."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from calibration.advice import Case, advise, faults
from calibration.board import Board
from calibration.corners import BoardImage, look_at_all
from calibration.correspondence import pair_sightings
from calibration.errors import CalibrationError
from calibration.heldout import HeldOut, held_out
from calibration.imagepairs import ImagePair
from calibration.judgement import Judgement, judge
from calibration.lens_choice import LensTrial, choose_lens
from calibration.no_board import explain_no_board
from calibration.rig import StereoRig
from calibration.sighting import PairSighting
from calibration.solution import StereoSolution
from calibration.solve import solve_stereo

FEWEST_PAIRS = 3  # fewer views leave the lens undetermined
AUTO = "auto"
BASELINE_LIMITS = (1e-3, 10.0)  # m, as a rig file has them

BLURRED = 1.6  # times the median blur of an image's own camera, ...
LEAST_BLUR = 1.5  # ... from this standard deviation on [px]
SMALL_BOARD = 0.04  # share of the image
STRAY = 0.25  # of the images show a board that is not there


@dataclass(frozen=True, eq=False)
class View:
    """What one image pair gave.

    name: a word that tells the pair from the others, as "02".
    sighting: the corners of both images in one numbering; None when an image shows no board.
    renumbered: the right image's corners were found in another order and put right.
    number: of the view in the solution; None without a sighting.
    fault: what is wrong with the pair, to follow "drop pair 02: "; None when nothing is.
    """

    name: str
    left: BoardImage
    right: BoardImage
    sighting: PairSighting | None = None
    renumbered: bool = False
    number: int | None = None
    fault: str | None = None

    @property
    def reason(self) -> str | None:
        """Why the pair could not be used, or None."""
        return "; ".join(filter(None, (self.left.reason, self.right.reason))) or None


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """The rig and what speaks for it and against it.

    rig: with its `calibration` section.
    views: one per pair given, in the order given; the solution holds those with a sighting.
    trials: what each lens that was tried gave; one, when it was chosen by hand.
    advice: what to do next, the most useful first.
    """

    rig: StereoRig
    board: Board
    views: list[View]
    solution: StereoSolution
    heldout: HeldOut
    trials: list[LensTrial]
    judgement: Judgement
    advice: list[str]

    @property
    def pairs_used(self) -> int:
        """Pairs that the rig was solved from."""
        return len(self.solution.used_views)

    def used(self, view: View) -> bool:
        """Whether the rig was solved from a view."""
        return view.number in self.solution.used_views


def calibrate_cameras(
    pairs: Sequence[ImagePair],
    board: Board,
    lens: str = AUTO,
    ruler: float | None = None,
    cache: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> CalibrationResult:
    """Calibrate a camera pair from images of a board.

    Args:
        lens: a name in `calibration.lens.LENSES`, or "auto": the simplest that no richer one
            clearly beats on pairs left out.
        ruler: distance between the lenses as a person measured it [m], to check the board's size.
        cache: folder that keeps what was found in an image.
        progress: called as progress(images done, images).

    Raises:
        CalibrationError: images of different size, no board found (the message suggests the
            board that was meant), fewer than 3 usable pairs, views that do not determine the
            cameras, left and right swapped.
    """
    views = _look(pairs, board, cache, progress)
    image_size = _common_size([image for view in views for image in (view.left, view.right)])
    seen = [view for view in views if view.sighting is not None]
    if len(seen) < FEWEST_PAIRS:
        raise _too_few(len(seen), views, board)
    sightings = [view.sighting for view in seen if view.sighting is not None]

    if lens == AUTO:
        solution, heldout, trials = choose_lens(sightings, board.points, image_size)
    else:
        solution = solve_stereo(sightings, board.points, image_size, lens)
        heldout = held_out(solution)
        trials = [LensTrial(lens, solution.rms, heldout.row_rms, True, "chosen by --lens")]
    _check_baseline(solution.rig.baseline, board)

    judgement = judge(solution, heldout, board, [_stamp(view) for view in seen], ruler)
    case = Case(solution, heldout, judgement, [view.name for view in seen])
    found = iter(faults(case))
    views = [replace(v, fault=next(found)) if v.sighting is not None else v for v in views]
    summary = _summary(board, views, solution, heldout, judgement)
    rig = replace(solution.rig, sections={"calibration": summary})
    return CalibrationResult(rig, board, views, solution, heldout, trials, judgement, advise(case))


def _look(
    pairs: Sequence[ImagePair],
    board: Board,
    cache: Path | None,
    progress: Callable[[int, int], None] | None,
) -> list[View]:
    """Find the board in all images and number each pair's corners alike."""
    sources = [source for pair in pairs for source in (pair.left, pair.right)]
    images = look_at_all(sources, board, cache, progress)
    views, number = [], 0
    for name, left, right in zip(_names(pairs), images[::2], images[1::2], strict=True):
        if left.sighting is None or right.sighting is None:
            views.append(View(name, left, right))
            continue
        sighting, renumbered = pair_sightings(left.sighting, right.sighting, board)
        views.append(View(name, left, right, sighting, renumbered, number))
        number += 1
    return views


def _names(pairs: Sequence[ImagePair]) -> list[str]:
    """The last number in the file names that is another in every pair and alike in both images;
    without one, the names of the left images."""
    lefts, rights = (
        [re.findall(r"[0-9]+", source.path.stem) for source in side]
        for side in zip(*((pair.left, pair.right) for pair in pairs), strict=True)
    )
    for back in range(1, min(len(numbers) for numbers in (*lefts, *rights)) + 1):
        names = [numbers[-back] for numbers in lefts]
        if names == [numbers[-back] for numbers in rights] and len(set(names)) == len(names):
            return names
    return [pair.left.path.stem for pair in pairs]


def remarks(result: CalibrationResult, view: View) -> list[str]:
    """What the table of pairs says of a view, in a few words each."""
    if view.sighting is None:
        return [f"not used: {view.reason}"]
    said = []
    if view.fault:
        said.append(view.fault if result.used(view) else f"not used: {view.fault}")
    for side in ("left", "right"):
        image: BoardImage = getattr(view, side)
        usual = [b for v in result.views if (b := getattr(v, side).blur) is not None]
        if image.blur and image.blur > max(LEAST_BLUR, BLURRED * float(np.median(usual))):
            said.append(f"{side} image blurred ({image.blur:.1f} px)")
        if image.sighting and _board_share(image, result.rig.image_size) < SMALL_BOARD:
            said.append(f"board small in the {side} image")
    if view.renumbered:
        said.append("corner order put right")
    return said


def _board_share(image: BoardImage, size: tuple[int, int]) -> float:
    """Part of the image that the box around a board's corners takes."""
    assert image.sighting is not None
    width, height = np.ptp(image.sighting.corners, axis=0)
    return float(width * height / (size[0] * size[1]))


def _summary(
    board: Board,
    views: Sequence[View],
    solution: StereoSolution,
    heldout: HeldOut,
    judgement: Judgement,
) -> dict:
    """The `calibration` section of rig.yaml.

    date: the day (UTC) of the newest image, so that the same images give the same file.
    """
    images = [image for v in views for image in (v.left, v.right) if image.size is not None]
    newest = max(image.path.stat().st_mtime for image in images)
    return {
        "date": datetime.fromtimestamp(newest, UTC).date().isoformat(),
        "verdict": judgement.verdict,
        "stereo_rms_px": solution.rms,
        "heldout_row_rms_px": heldout.row_rms,
        "pairs_used": len(solution.used_views),
        "pairs_given": len(views),
        "corners_rejected": solution.rejected,
        "lens": solution.lens,
        "board": board.name,
        "square_m": board.square,
        "sigma": solution.sigma,
    }


def _stamp(view: View) -> int | None:
    """The time [ns] in the name of a recording's image."""
    stem = view.left.path.stem
    return int(stem) if re.fullmatch(r"[0-9]{16,19}", stem) else None


def _common_size(images: Sequence[BoardImage]) -> tuple[int, int]:
    """(width, height) of all images that can be read."""
    counts = Counter(image.size for image in images if image.size)
    if not counts:
        raise CalibrationError(
            f"none of the {len(images)} images can be read: are they whole and really images?"
        )
    size = counts.most_common(1)[0][0]
    for image in images:
        if image.size and image.size != size:
            raise CalibrationError(
                f"{image.path}: {image.size[0]}x{image.size[1]} pixels, unlike the "
                f"{size[0]}x{size[1]} of {counts[size]} others: all images must have one size"
            )
    return size


def _check_baseline(baseline: float, board: Board) -> None:
    low, high = BASELINE_LIMITS
    if not low <= baseline <= high:
        raise CalibrationError(
            f"--square: with {board.square * 1e3:g} mm the cameras stand {baseline:.4g} m apart, "
            "which no camera pair does: check the unit"
        )


def _too_few(usable: int, views: Sequence[View], board: Board) -> CalibrationError:
    readable = [i for view in views for i in (view.left, view.right) if i.size is not None]
    # A board of another size is found in a stray image now and then.
    found = sum(image.sighting is not None for image in readable)
    if usable == 0 and found <= STRAY * len(readable):
        return CalibrationError(explain_no_board(readable, board))
    reasons = [view.reason for view in views if view.reason]
    why = f" (as for {reasons[0]})" if reasons else ""
    return CalibrationError(
        f"only {usable} of {len(views)} pairs show the board in both images{why}: at least "
        f"{FEWEST_PAIRS} are needed, 10 or more with the board tilted to all sides are good"
    )
