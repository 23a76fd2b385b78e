"""A new camera pair, from images of a board to a `StereoRig`: look, number, solve, judge."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.board import Board
from calibration.corners import BoardImage, look
from calibration.correspondence import same_order
from calibration.epipolar import row_differences
from calibration.errors import CalibrationError
from calibration.imagepairs import ImagePair
from calibration.rig import StereoRig
from calibration.solve import solve_stereo

FEWEST_PAIRS = 3  # fewer views leave the lens undetermined


@dataclass(frozen=True)
class View:
    """What one image pair gave.

    corners: the (n, 2) pixels in the left and in the right image, the same numbering; None
        when the pair is not used.
    renumbered: the right image's corners were found in another order and put right.
    rms: reprojection error of the left and the right image [px]; None when not used.
    """

    left: BoardImage
    right: BoardImage
    corners: tuple[np.ndarray, np.ndarray] | None = None
    renumbered: bool = False
    rms: tuple[float, float] | None = None

    @property
    def reason(self) -> str | None:
        """Why the pair is not used, or None."""
        return "; ".join(filter(None, (self.left.reason, self.right.reason))) or None


@dataclass(frozen=True)
class CalibrationResult:
    """The rig and what speaks for it.

    stereo_rms: reprojection error over all corners of both images [px].
    row_rms: rectified row error over the same corners, in-sample [px].
    views: one per pair given, in the order given.
    """

    rig: StereoRig
    board: Board
    stereo_rms: float
    row_rms: float
    views: list[View]

    @property
    def pairs_used(self) -> int:
        """Pairs that the rig was solved from."""
        return sum(view.corners is not None for view in self.views)


def calibrate_cameras(pairs: Iterable[ImagePair], board: Board) -> CalibrationResult:
    """Calibrate a camera pair from images of a board.

    Pairs that cannot be read or do not show the whole board in both images are left out; their
    `View.reason` says why.

    Raises:
        CalibrationError: images of different size, no board found (the message suggests the
            board that was meant if squares were counted), fewer than 3 usable pairs, or views
            that do not determine the cameras.
    """
    views = [_view(look(pair.left, board), look(pair.right, board), board) for pair in pairs]
    image_size = _common_size([image for view in views for image in (view.left, view.right)])
    seen = [view.corners for view in views if view.corners is not None]
    if len(seen) < FEWEST_PAIRS:
        raise _too_few(len(seen), views, board)
    left, right = (list(side) for side in zip(*seen, strict=True))

    solution = solve_stereo(left, right, board, image_size)
    rows = row_differences(solution.rig, np.concatenate(left), np.concatenate(right))
    row_rms = float(np.sqrt(np.mean(rows**2)))
    summary = {
        "stereo_rms_px": solution.rms,
        "row_rms_px": row_rms,
        "pairs_used": len(seen),
        "pairs_given": len(views),
        "board": board.name,
        "square_m": board.square,
    }
    rig = replace(solution.rig, sections={"calibration": summary})
    return CalibrationResult(rig, board, solution.rms, row_rms, _with_rms(views, solution.view_rms))


def _view(left: BoardImage, right: BoardImage, board: Board) -> View:
    if left.corners is None or right.corners is None:
        return View(left, right)
    numbered, changed = same_order(left.corners, right.corners, board)
    return View(left, right, (left.corners, numbered), changed)


def _with_rms(views: Sequence[View], view_rms: np.ndarray) -> list[View]:
    rms = iter(view_rms.tolist())
    return [replace(view, rms=tuple(next(rms))) if view.corners else view for view in views]


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


def _too_few(usable: int, views: Sequence[View], board: Board) -> CalibrationError:
    readable = [i for view in views for i in (view.left, view.right) if i.size is not None]
    if all(image.corners is None for image in readable):
        return CalibrationError(_no_board(readable, board))
    reasons = [view.reason for view in views if view.reason]
    why = f" (as for {reasons[0]})" if reasons else ""
    return CalibrationError(
        f"only {usable} of {len(views)} pairs show the whole board in both images{why}: at least "
        f"{FEWEST_PAIRS} are needed, 10 or more with the board tilted to all sides are good"
    )


def _no_board(images: Sequence[BoardImage], board: Board) -> str:
    message = f"no {board.name} in any of {len(images)} images"
    fewer = board.as_squares()
    if fewer and any(look(image.path, fewer).corners is not None for image in images):
        return (
            f"{message}, but there is a {fewer.name}: --board counts inner corners, not squares: "
            f"give --board {fewer.name}"
        )
    return (
        f"{message}: --board counts inner corners (squares less one each way), and the whole "
        "board must be seen, flat and with a white rim"
    )
