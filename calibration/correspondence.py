"""The same corner must have the same number in both images of a pair."""

from __future__ import annotations

import numpy as np

from calibration.board import Board
from calibration.sighting import PairSighting, Sighting


def pair_sightings(left: Sighting, right: Sighting, board: Board) -> tuple[PairSighting, bool]:
    """One view of the board, the right corners numbered as the left, and whether that changed them.

    A board that looks alike from two sides may be numbered from either end in each image. The
    cameras of a pair stand nearly the same way up, so the board has nearly the same shape and
    attitude in both images: of the numberings that the board allows, the right one is that
    whose corners, apart from a shift, lie closest to the left's.
    """
    views = [PairSighting(left, _renumbered(right, turned)) for turned in symmetries(board)]
    best = int(np.argmin([_misfit(view) for view in views]))
    return views[best], best != 0


def symmetries(board: Board) -> list[np.ndarray]:
    """The numberings that the look of the board allows, the board's own first.

    Each is (m,) ids: the point whose number is i is also point `ids[i]` of the board turned by a
    quarter, a half or three quarters. Markers tell a board's sides apart.
    """
    own = np.arange(len(board.points))
    if board.coded:
        return [own]
    plane = board.points[:, :2] - (board.points.min(axis=0) + board.points.max(axis=0))[:2] / 2
    numberings = [own]
    for quarter in (np.array([[0, -1], [1, 0]]), -np.eye(2), np.array([[0, 1], [-1, 0]])):
        apart = np.linalg.norm((plane @ quarter.T)[:, None] - plane, axis=2)
        if np.all(apart.min(axis=1) < 1e-3 * board.square):
            numberings.append(apart.argmin(axis=1))
    return numberings


def _renumbered(sighting: Sighting, ids: np.ndarray) -> Sighting:
    turned = ids[sighting.ids]
    order = np.argsort(turned)
    return Sighting(turned[order], sighting.corners[order])


def _misfit(view: PairSighting) -> float:
    _, left, right = view.common()
    if not len(left):
        return np.inf
    return float(np.mean(((right - right.mean(axis=0)) - (left - left.mean(axis=0))) ** 2))
