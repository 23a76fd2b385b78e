"""Where to hold the board next: whoever follows the outline has enough soon."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.board import Board, parse_board
from calibration.coverage import REGIONS
from calibration.rotation import turn_matrix
from calibration.sighting import PairSighting, Sighting
from pipeline.board_ghost import find_ghost
from pipeline.board_views import BoardViews
from tests.board_person import NEAR_RIG, Followed, follow, hold
from tests.calibration_views import BOARD, SMALL_RIG, distorted_rig, project

DISTANCE = 0.42  # m


@pytest.mark.parametrize(
    ("rig", "board", "most"),
    [
        (NEAR_RIG, BOARD, 14),
        # Lenses far apart for so large a board: what the left image shows at its side is beyond
        # the right one.
        (SMALL_RIG, BOARD, 18),
        (distorted_rig(), BOARD, 22),
        (NEAR_RIG, parse_board("charuco:8x6", 0.03), 16),
        (NEAR_RIG, parse_board("acircles:4x11", 0.02), 18),
    ],
    ids=["near", "far apart", "distorted", "charuco", "circles"],
)
def test_who_follows_the_outline_has_enough_soon(rig, board: Board, most):
    done = follow(rig, board)
    views = done.views[-1]
    assert views.wishes == []
    assert len(done.poses) <= most
    assert all(c.share >= 0.6 for c in views.covered)
    assert views.bars == dict.fromkeys(views.bars, 1.0)


@pytest.fixture(scope="module")
def followed() -> Followed:
    return follow(NEAR_RIG, BOARD)


def test_the_outline_is_what_the_words_say(followed):
    """The edge that is named is drawn longer than the one opposite, in the part that is named."""
    edges = ("upper", "right", "lower", "left")
    for ghost in followed.ghosts[1:]:
        lengths = np.linalg.norm(np.roll(ghost.outline, -1, axis=0) - ghost.outline, axis=1)
        nearer = edges.index(ghost.wish.edge)
        assert lengths[nearer] > 1.1 * lengths[(nearer + 2) % 4]
        ((row, column),) = np.argwhere(np.array(REGIONS) == ghost.wish.place)
        # A board is larger than a part: its middle cannot come all the way.
        middle = ghost.outline.mean(axis=0) / NEAR_RIG.image_size
        assert np.abs(middle - (np.array([column, row]) + 0.5) / 3).max() < 0.25
        everything = np.concatenate([ghost.outline, ghost.lines.reshape(-1, 2)])
        assert ((everything > 0) & (everything < NEAR_RIG.image_size)).all()


def test_where_all_boards_stood_equally_far_another_distance_is_wanted():
    ids, kept = np.arange(len(BOARD.points)), []
    places = [(u, v) for v in (-60, 0, 60) for u in (-64, 0, 64, 96)]
    for number, (u, v) in enumerate(places):
        turn = 0.4 * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)][number % 4])
        R = turn_matrix(np.append(turn, 0.0))
        t = DISTANCE * np.array([u / 246.4, v / 246.4, 1.0]) - R @ BOARD.points.mean(axis=0)
        left, right = (Sighting(ids, seen) for seen in project(NEAR_RIG, (R, t)))
        kept.append(PairSighting(left, right))
    views = BoardViews(BOARD, NEAR_RIG.image_size, tuple(kept))
    assert [str(wish) for wish in views.wishes] == ["nearer, or farther away"]
    ghost = find_ghost(views)
    assert ghost is not None
    _, t = hold(NEAR_RIG, BOARD, ghost)
    if ghost.wish.words == "nearer":
        assert t[2] < DISTANCE / 1.3
    else:
        assert ghost.wish.words == "farther away"
        assert t[2] > 1.3 * DISTANCE


def test_at_first_the_board_is_wanted_in_the_middle(followed):
    assert find_ghost(BoardViews(BOARD)) is None  # nobody knows the size of the images
    ghost = find_ghost(BoardViews(BOARD, (640, 480)))
    assert ghost is not None
    assert ghost.outline.mean(axis=0) == pytest.approx((320, 240), abs=1)
    assert str(ghost.wish) == "show the board to both cameras"
    assert find_ghost(followed.views[-1]) is None
