"""BoardCapture: which of the pairs that come in are worth keeping for a calibration.

A pair is kept when both images show the board, sharp and held still, somewhere new: another place
in the image, another tilt, another distance. It is enough when every part of both images was
covered, the board was tilted to all four sides and stood near and far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from calibration.attitudes import Attitudes, attitudes
from calibration.board import Board
from calibration.correspondence import pair_sightings
from calibration.coverage import Coverage, coverage
from calibration.detection import Detection, detect
from calibration.sighting import PairSighting, Sighting
from stereo.pair import StereoPair

STILL = 0.004  # of the image's width that the corners may have moved since the pair before
SHARP = 1.7  # px: standard deviation of the blur of edges
# A view is new when it differs from every kept one by this much of the width, in its middle, or
# this much in shape.
NEW_PLACE, NEW_SHAPE = 0.08, 0.05
ENOUGH_PAIRS = 12
ENOUGH_COVERAGE = 0.6  # share of each image
# A lens of about 65 deg: good enough to tell which edge of the board is nearer.
GUESSED_FOCAL = 0.78  # widths

MISSING = "no board"


@dataclass(frozen=True)
class Look:
    """What became of one pair: kept, or why not (`no board in the left image`, `moving`, ...)."""

    kept: bool
    why: str
    blur: float | None = None


@dataclass
class BoardCapture:
    """Judges pairs one after the other.

    kept: the pairs that were kept, as both cameras see their board.
    """

    board: Board
    size: tuple[int, int] | None = None
    kept: list[PairSighting] = field(default_factory=list)
    _before: Sighting | None = None

    def look(self, pair: StereoPair) -> Look:
        """Judge one pair; a kept one is in `kept`."""
        left, right = (_grey(image) for image in (pair.left, pair.right))
        self.size = (left.shape[1], left.shape[0])
        found = [detect(image, self.board) for image in (left, right)]
        gone = [side for side, d in zip(("left", "right"), found, strict=True) if not d.sighting]
        if gone:
            self._before = None
            return Look(False, f"{MISSING} in the {' and the '.join(gone)} image")
        return self._judge(found)

    def _judge(self, found: Sequence[Detection]) -> Look:
        left, right = found[0].sighting, found[1].sighting
        assert left is not None
        assert right is not None
        view, _ = pair_sightings(left, right, self.board)
        width = self.size[0] if self.size else 1
        blur = max(d.blur or 0.0 for d in found)
        before, self._before = self._before, left
        if before is None or _moved(before, left) > STILL * width:
            return Look(False, "hold it still", blur)
        if blur > SHARP:
            return Look(False, f"blurred ({blur:.1f} px)", blur)
        if any(_alike(left, kept.left, width) for kept in self.kept):
            return Look(False, "seen already", blur)
        self.kept.append(view)
        return Look(True, "kept", blur)

    @property
    def covered(self) -> list[Coverage]:
        """Of the left and the right image; empty before the first view."""
        if not self.kept or self.size is None:
            return []
        return [
            coverage(self.size, [getattr(view, side).corners for view in self.kept])
            for side in ("left", "right")
        ]

    @property
    def attitudes(self) -> Attitudes | None:
        """Tilts and distances, with a guessed lens; None before the first view."""
        poses = [pose for view in self.kept if (pose := self._pose(view)) is not None]
        return attitudes(np.array(poses), self.board.points) if poses else None

    def _pose(self, view: PairSighting) -> np.ndarray | None:
        assert self.size is not None
        f = GUESSED_FOCAL * self.size[0]
        K = np.array([[f, 0, self.size[0] / 2], [0, f, self.size[1] / 2], [0, 0, 1]])
        points = self.board.points[view.left.ids]
        good, turn, place = cv2.solvePnP(points, view.left.corners.astype(float), K, None)
        return np.concatenate([turn.ravel(), place.ravel()]) if good else None

    def wanted(self) -> list[str]:
        """What is still missing, the most useful first; empty: it is enough."""
        if not self.kept:
            return ["show the board to both cameras"]
        wanted = []
        poor = [name for c in self.covered for name in c.poor]
        places = sorted(set(poor), key=lambda name: (-poor.count(name), poor.index(name)))
        turns = self.attitudes
        sides = turns.lacking if turns else []
        for number in range(max(len(places), len(sides))):
            place = places[number] if number < len(places) else ""
            tilt = f"{sides[number % len(sides)]} edge nearer" if sides else ""
            wanted.append(", ".join(filter(None, (place, tilt))))
        if turns is not None and turns.one_distance:
            wanted.append("nearer, or farther away")
        if len(self.kept) < ENOUGH_PAIRS and not wanted:
            wanted.append("any other place and tilt")
        if any(c.share < ENOUGH_COVERAGE for c in self.covered) and not wanted:
            wanted.append("nearer to the image's edges")
        return wanted

    def bars(self) -> dict[str, float]:
        """Share of what is wanted that is there, by name; 1 is enough."""
        turns = self.attitudes
        lacking = len(turns.lacking) if turns else 4
        shares = [c.share for c in self.covered] or [0.0, 0.0]
        return {
            "pairs": min(1.0, len(self.kept) / ENOUGH_PAIRS),
            "left": min(1.0, shares[0] / ENOUGH_COVERAGE),
            "right": min(1.0, shares[1] / ENOUGH_COVERAGE),
            "tilt": 1.0 - lacking / 4.0,
            "distance": float(turns is not None and not turns.one_distance),
        }


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


def _alike(a: Sighting, b: Sighting, width: int) -> bool:
    """Whether the board stands in about the same place, and in the same way."""
    one, other = _common(a, b)
    if 2 * len(one) < len(a.ids):
        return False
    moved = float(np.linalg.norm(one.mean(axis=0) - other.mean(axis=0)))
    shape = float(np.abs((one - one.mean(axis=0)) - (other - other.mean(axis=0))).max())
    return moved < NEW_PLACE * width and shape < NEW_SHAPE * width


def _grey(image: np.ndarray) -> np.ndarray:
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
