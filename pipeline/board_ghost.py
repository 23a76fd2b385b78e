"""Ghost: where to hold the board next, drawn as it would look from the left camera.

Of some places, tilts and distances it is that which covers most of what is missing, is new, and
lies within both images. The lens is guessed, and so is how much farther left the board stands in
the right image: by the views taken so far.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibration.attitudes import FAR_TO_NEAR, SIDES
from calibration.board import Board
from calibration.board_drawing import draw_board
from calibration.coverage import REGIONS, covered_by, region_shares
from calibration.rotation import turn_matrix
from calibration.sighting import Sighting
from pipeline.board_capture import alike
from pipeline.board_views import DISTANCE, FIRST, BoardViews, Wish, guessed_lens

SIZES = (0.6, 0.48, 0.38, 0.3, 0.22)  # of the image's width that the board is wide
FIRST_SIZE = 0.38
TILT = np.radians(32.0)
MARGIN = 0.02  # of the image's width that stays free at its edges
LEAST_GAIN = 0.03  # of a wanted region that makes it worth going there
LARGER = 0.1  # share of both images that is given up for a board wider by the image's width
PLAINLY = 1.1  # times the ratio of distances that is asked for
SETTLE = 4  # steps to bring a board to a place: its perspective changes on the way
PLACES = {
    name: np.array([column + 0.5, row + 0.5]) / 3
    for row, names in enumerate(REGIONS)
    for column, name in enumerate(names)
}
# Which edge is nearer -> the board's turn about the image's axes.
TURNS = {
    "": np.eye(3),
    "upper": turn_matrix(np.array([TILT, 0, 0])),
    "lower": turn_matrix(np.array([-TILT, 0, 0])),
    "left": turn_matrix(np.array([0, -TILT, 0])),
    "right": turn_matrix(np.array([0, TILT, 0])),
}

Pose = tuple[np.ndarray, np.ndarray]  # R (3, 3) and t (3,) m: from the board to the left camera


@dataclass(frozen=True, eq=False)
class Ghost:
    """A board as it should be held.

    wish: what it fulfils; seen: its corners in the left image; outline: (4, 2) px of what is
    printed, clockwise from the upper left; lines: (n, 2, 2) px, ends of lines across it.
    """

    wish: Wish
    seen: Sighting
    outline: np.ndarray
    lines: np.ndarray


def find_ghost(views: BoardViews) -> Ghost | None:
    """Where to hold the board next; None: nowhere, or the size of the images is not known."""
    if views.size is None or not views.wishes:
        return None
    search = _Search(views, views.size)
    if views.wishes[0].words == FIRST:
        return search.first(views.wishes[0])
    found = (search.best(wish) for wish in (*views.wishes, Wish()))
    return next((ghost for ghost in found if ghost is not None), None)


class _Search:
    """What candidates are held against."""

    def __init__(self, views: BoardViews, size: tuple[int, int]) -> None:
        self._views = views
        self._size = np.array(size)
        self._lens = guessed_lens(size)
        self._printed, self._ends = printed(views.board)
        self._disparity, self._down = self._to_right()
        self._blank = [~c.covered for c in views.covered]

    def first(self, wish: Wish) -> Ghost | None:
        """In the middle, upright."""
        pose = self._held("middle", "", FIRST_SIZE, by_right=False)
        return None if pose is None else self._ghost(wish, pose)

    def best(self, wish: Wish) -> Ghost | None:
        """The view that fulfils a wish best."""
        best, most = None, LEAST_GAIN if wish.place else 0.0
        poor = [wish.place in c.poor for c in self._views.covered]
        by_right = poor == [False, True]
        places = (wish.place,) if wish.place else PLACES
        edges = (wish.edge,) if wish.edge or wish.words == DISTANCE else SIDES
        for place, edge, size in itertools.product(places, edges, SIZES):
            pose = self._held(place, edge, size, by_right)
            if pose is None:
                continue
            words = self._distance(pose) if wish.words == DISTANCE else ""
            if wish.words == DISTANCE and not words:
                continue
            corners = self._in_both(pose, self._points)
            gain = self._gain(corners, wish.place, poor) + (0.0 if wish.place else LARGER * size)
            if gain >= most and not self._known(corners[0]):
                best, most = self._ghost(Wish(place, edge, words), pose), gain
        return best

    @property
    def _points(self) -> np.ndarray:
        return self._views.board.points

    def _to_right(self) -> tuple[float, float]:
        """How far a board at 1 m stands from the left to the right image [px m], and down [px]."""
        shifts = []
        for view, pose in zip(self._views.kept, self._views.poses, strict=True):
            ids, left, right = view.common()
            if len(ids) and np.isfinite(pose).all():
                held = turn_matrix(pose[:3]), pose[3:]
                depth = _placed(held, self._points[ids])[:, 2]
                shift = right - left
                shifts.append([np.mean(shift[:, 0] * depth), np.mean(shift[:, 1])])
        disparity, down = np.median(shifts, axis=0) if shifts else (0.0, 0.0)
        return float(disparity), float(down)

    def _held(self, place: str, edge: str, size: float, by_right: bool) -> Pose | None:
        """Pose of the board as near as it can be to a place, whole within both images; None:
        it is too large. by_right: the place is meant in the right image."""
        wide, high = np.ptp(self._printed[:, :2], axis=0)
        far = self._lens[0, 0] * max(wide / self._size[0], high / self._size[1]) / size
        R = TURNS[edge]
        t = np.array([0.0, 0.0, far]) - R @ self._points.mean(axis=0)
        margin = MARGIN * self._size[0]
        for _ in range(SETTLE):
            both = self._in_both((R, t), self._printed)
            low = margin - np.min(both, axis=(0, 1))
            high = self._size - margin - np.max(both, axis=(0, 1))
            if (low > high).any():
                return None
            meant = both[by_right]
            middle = (meant.min(axis=0) + meant.max(axis=0)) / 2
            step = np.clip(PLACES[place] * self._size - middle, low, high)
            t[:2] += step * far / self._lens[0, 0]
        return R, t

    def _in_both(self, pose: Pose, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, 2) px in the left and in the right image of points (n, 3) on the board."""
        placed = _placed(pose, points)
        left = self._project(placed)
        shift = np.stack([self._disparity / placed[:, 2], np.full(len(left), self._down)], axis=1)
        return left, left + shift

    def _project(self, placed: np.ndarray) -> np.ndarray:
        """(n, 2) px in the left image of points (n, 3) before its camera."""
        return placed[:, :2] / placed[:, 2:] * self._lens[0, 0] + self._lens[:2, 2]

    def _gain(self, corners: tuple[np.ndarray, np.ndarray], place: str, poor: list[bool]) -> float:
        """What would be covered anew: of a region, in the images where it is poor, or of both
        images; as a share of it."""
        size = (int(self._size[0]), int(self._size[1]))
        gain = 0.0
        for blank, seen, needs in zip(self._blank, corners, poor, strict=True):
            new = covered_by(size, seen) & blank
            if not place:
                gain += float(new.mean())
            elif needs:
                gain += region_shares(new)[place]
        return gain

    def _known(self, corners: np.ndarray) -> bool:
        """Whether a kept view is alike: such a one is not taken again."""
        seen = Sighting(np.arange(len(corners)), corners)
        width = int(self._size[0])
        return any(alike(kept.left, seen, width) for kept in self._views.kept)

    def _distance(self, pose: Pose) -> str:
        """In which way its distance differs from those of all views."""
        turns = self._views.attitudes
        far = _placed(pose, self._points.mean(axis=0))[2]
        ratio = PLAINLY * FAR_TO_NEAR
        if turns is None or far * ratio < turns.distances.max():
            return "nearer"
        return "farther away" if far > ratio * turns.distances.min() else ""

    def _ghost(self, wish: Wish, pose: Pose) -> Ghost:
        seen, outline, ends = (
            self._project(_placed(pose, points))
            for points in (self._points, self._printed, self._ends.reshape(-1, 3))
        )
        return Ghost(wish, Sighting(np.arange(len(seen)), seen), outline, ends.reshape(-1, 2, 2))


def _placed(pose: Pose, points: np.ndarray) -> np.ndarray:
    """Points (..., 3) of the board before the left camera [m]."""
    R, t = pose
    return points @ R.T + t


@lru_cache(maxsize=4)
def printed(board: Board) -> tuple[np.ndarray, np.ndarray]:
    """Corners (4, 3) of what is printed, clockwise from the upper left, and the ends (n, 2, 3) of
    lines across it, about a square apart [m]."""
    left, top, right, bottom = draw_board(board).extent
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    columns, rows = round((right - left) / board.square), round((bottom - top) / board.square)
    down = [[[x, top], [x, bottom]] for x in np.linspace(left, right, columns + 1)[1:-1]]
    across = [[[left, y], [right, y]] for y in np.linspace(top, bottom, rows + 1)[1:-1]]
    lines = np.array(down + across)
    return _flat(corners), _flat(lines)


def _flat(plane: np.ndarray) -> np.ndarray:
    return np.concatenate([plane, np.zeros((*plane.shape[:-1], 1))], axis=-1)
