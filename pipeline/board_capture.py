"""BoardCapture: which of the pairs that come in are worth keeping for a calibration.

A pair is kept when both images show the board, sharp and held still, somewhere new: another place
in the image, another tilt, another distance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.board import Board
from calibration.correspondence import pair_sightings
from calibration.detection import Detection, detect
from calibration.sighting import PairSighting, Sighting
from pipeline.board_views import BoardViews
from stereo.pair import StereoPair

STILL = 0.004  # of the image's width that the corners may have moved since the pair before
SHARP = 1.7  # px: standard deviation of the blur of edges
# A view is new when it differs from every kept one by this much of the width, in its middle, or
# this much in shape.
NEW_PLACE, NEW_SHAPE = 0.08, 0.05

KEPT, MISSING = "kept", "no board"


@dataclass(frozen=True, eq=False)
class Look:
    """What became of one pair: kept, or why not (`no board in the left image`, `moving`, ...).

    seen: the board in the left and in the right image; blur: of its edges [px]; moved: how far it
    did since the pair before [px]. None: not known.
    """

    kept: bool
    why: str
    seen: tuple[Sighting | None, Sighting | None]
    blur: float | None = None
    moved: float | None = None


class BoardCapture:
    """Judges pairs one after the other.

    views: what was kept so far; exchanged whole, so that others may look at it meanwhile.
    """

    def __init__(self, board: Board) -> None:
        self.views = BoardViews(board)
        self.damaged = 0  # pairs that could not be decoded
        self._before: Sighting | None = None

    @property
    def kept(self) -> tuple[PairSighting, ...]:
        """The pairs that were kept, as both cameras see their board."""
        return self.views.kept

    def look(self, pair: StereoPair) -> Look:
        """Judge one pair; a kept one is in `kept`."""
        left, right = (_grey(image) for image in (pair.left, pair.right))
        size = left.shape[1], left.shape[0]
        if size != self.views.size:
            self.views = replace(self.views, size=size)
        found = detect(left, self.views.board), detect(right, self.views.board)
        seen = found[0].sighting, found[1].sighting
        gone = [side for side, one in zip(("left", "right"), seen, strict=True) if one is None]
        if gone:
            self._before = None
            return Look(False, f"{MISSING} in the {' and the '.join(gone)} image", seen)
        return self._judge(found, size[0])

    def _judge(self, found: tuple[Detection, Detection], width: int) -> Look:
        left, right = found[0].sighting, found[1].sighting
        assert left is not None
        assert right is not None
        blur = max(d.blur or 0.0 for d in found)
        before, self._before = self._before, left
        moved = None if before is None else _moved(before, left)
        if moved is None or moved > STILL * width:
            why = "hold it still"
        elif blur > SHARP:
            why = f"blurred ({blur:.1f} px)"
        elif any(alike(left, kept.left, width) for kept in self.kept):
            why = "seen already"
        else:
            view, _ = pair_sightings(left, right, self.views.board)
            self.views = replace(self.views, kept=(*self.kept, view))
            why = KEPT
        return Look(why == KEPT, why, (left, right), blur, moved)

    def wanted(self) -> list[str]:
        """What is still missing, the most useful first; empty: it is enough."""
        return [str(wish) for wish in self.views.wishes]

    def bars(self) -> dict[str, float]:
        """Share of what is wanted that is there, by name; 1 is enough."""
        return self.views.bars


def alike(a: Sighting, b: Sighting, width: int) -> bool:
    """Whether the board stands in about the same place, and in the same way, in two images of
    `width` px."""
    one, other = _common(a, b)
    if 2 * len(one) < len(a.ids):
        return False
    moved = float(np.linalg.norm(one.mean(axis=0) - other.mean(axis=0)))
    shape = float(np.abs((one - one.mean(axis=0)) - (other - other.mean(axis=0))).max())
    return moved < NEW_PLACE * width and shape < NEW_SHAPE * width


def _common(a: Sighting, b: Sighting) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 2) of those that both show."""
    _, in_a, in_b = np.intersect1d(a.ids, b.ids, assume_unique=True, return_indices=True)
    return a.corners[in_a], b.corners[in_b]


def _moved(a: Sighting, b: Sighting) -> float:
    """How far the corners moved from one image to the next [px]."""
    before, after = _common(a, b)
    if 2 * len(before) < len(a.ids):
        return np.inf
    return float(np.abs(after - before).max())


def _grey(image: np.ndarray) -> np.ndarray:
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
