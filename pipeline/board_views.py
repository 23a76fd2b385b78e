"""BoardViews: what the views of a board taken so far cover, and what is still missing.

It is enough when every part of both images was covered, the board was tilted to all four sides
and stood near and far.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from calibration.attitudes import SIDES, Attitudes, attitudes
from calibration.board import Board
from calibration.coverage import Coverage, coverage
from calibration.sighting import PairSighting, Sighting

ENOUGH_PAIRS = 12
ENOUGH_COVERAGE = 0.6  # share of each image
# A lens of about 65 deg: good enough to tell which edge of the board is nearer.
GUESSED_FOCAL = 0.78  # widths

FIRST = "show the board to both cameras"
DISTANCE = "nearer, or farther away"
ANY = "any other place and tilt"
EDGES = "nearer to the image's edges"


@dataclass(frozen=True)
class Wish:
    """A view that is missing: the board in a part of the image, one of its edges nearer, or as
    the words say. Empty: whatever it is."""

    place: str = ""
    edge: str = ""
    words: str = ""

    def __str__(self) -> str:
        tilt = f"{self.edge} edge nearer" if self.edge else ""
        return ", ".join(filter(None, (self.place, tilt, self.words)))


@dataclass(frozen=True, eq=False)
class BoardViews:
    """kept: the views, as both cameras see their board; size: of the images (width, height) [px],
    None before the first."""

    board: Board
    size: tuple[int, int] | None = None
    kept: tuple[PairSighting, ...] = ()

    @cached_property
    def covered(self) -> list[Coverage]:
        """Of the left and the right image; empty before the first view."""
        if not self.kept or self.size is None:
            return []
        return [
            coverage(self.size, [getattr(view, side).corners for view in self.kept])
            for side in ("left", "right")
        ]

    @cached_property
    def poses(self) -> np.ndarray:
        """(n, 6) rotation vectors and translations [m] of the kept boards before the left camera,
        with a guessed lens; NaN where it cannot be told."""
        return np.array([self._pose(view.left) for view in self.kept]).reshape(-1, 6)

    @cached_property
    def attitudes(self) -> Attitudes | None:
        """Tilts and distances, with a guessed lens; None before the first view."""
        told = self.poses[np.isfinite(self.poses).all(axis=1)]
        return attitudes(told, self.board.points) if len(told) else None

    @cached_property
    def wishes(self) -> list[Wish]:
        """What is still missing, the most useful first; empty: it is enough."""
        if not self.kept:
            return [Wish(words=FIRST)]
        wishes = []
        poor = [name for c in self.covered for name in c.poor]
        places = sorted(set(poor), key=lambda name: (-poor.count(name), poor.index(name)))
        turns = self.attitudes
        sides = turns.lacking if turns else []
        for number in range(max(len(places), len(sides))):
            place = places[number] if number < len(places) else ""
            wishes.append(Wish(place, sides[number % len(sides)] if sides else ""))
        if turns is not None and turns.one_distance:
            wishes.append(Wish(words=DISTANCE))
        if len(self.kept) < ENOUGH_PAIRS and not wishes:
            wishes.append(Wish(words=ANY))
        if any(c.share < ENOUGH_COVERAGE for c in self.covered) and not wishes:
            wishes.append(Wish(words=EDGES))
        return wishes

    @property
    def lacking(self) -> list[str]:
        """The edges of the board that were too seldom the nearer one, the rarest first."""
        return list(SIDES) if self.attitudes is None else self.attitudes.lacking

    @cached_property
    def bars(self) -> dict[str, float]:
        """Share of what is wanted that is there, by name; 1 is enough."""
        turns = self.attitudes
        shares = [c.share for c in self.covered] or [0.0, 0.0]
        return {
            "pairs": min(1.0, len(self.kept) / ENOUGH_PAIRS),
            "left": min(1.0, shares[0] / ENOUGH_COVERAGE),
            "right": min(1.0, shares[1] / ENOUGH_COVERAGE),
            "tilt": 1.0 - len(self.lacking) / 4.0,
            "distance": float(turns is not None and not turns.one_distance),
        }

    def _pose(self, seen: Sighting) -> np.ndarray:
        assert self.size is not None
        points, corners = self.board.points[seen.ids], seen.corners.astype(float)
        good, turn, place = cv2.solvePnP(points, corners, guessed_lens(self.size), None)
        return np.concatenate([turn, place]).ravel() if good else np.full(6, np.nan)


def guessed_lens(size: tuple[int, int]) -> np.ndarray:
    """K (3, 3) of a usual lens, for images of (width, height) px."""
    f = GUESSED_FOCAL * size[0]
    return np.array([[f, 0, size[0] / 2], [0, f, size[1] / 2], [0, 0, 1]])
