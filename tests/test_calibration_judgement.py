"""What is said of a calibration: true where the truth is known, and the wrong image named."""

from __future__ import annotations

import re
from functools import cache

import cv2
import numpy as np
import pytest

from calibration.advice import NOTHING, Case, advise, faults
from calibration.attitudes import attitudes
from calibration.board import Board
from calibration.coverage import coverage
from calibration.heldout import held_out
from calibration.judgement import judge
from calibration.misfits import find_misfits
from calibration.sighting import PairSighting, Sighting
from calibration.solve import solve_stereo
from calibration.verdict import verdict
from tests.calibration_views import (
    BOARD,
    board_poses,
    distorted_rig,
    poses_in_view,
    shifted,
    sightings,
)


@cache
def good_views() -> tuple[PairSighting, ...]:
    """Twelve pairs with 0.1 px of noise."""
    return tuple(sightings(distorted_rig(), poses_in_view(distorted_rig(), 12, 4), 0.1, 4))


def case_of(views, board: Board = BOARD, ruler=None, stamps=None) -> Case:
    solution = solve_stereo(views, board.points, (640, 480))
    heldout = held_out(solution)
    judgement = judge(solution, heldout, board, stamps or [None] * len(views), ruler)
    return Case(solution, heldout, judgement, [f"{number:02}" for number in range(len(views))])


def in_right(view: PairSighting, shift, share=1.0) -> PairSighting:
    """The view with its right image's corners shifted."""
    swapped = shifted(PairSighting(view.right, view.left), shift, share)
    return PairSighting(swapped.right, swapped.left)


def with_view(views, index: int, view: PairSighting) -> list[PairSighting]:
    return [view if i == index else v for i, v in enumerate(views)]


# --- the verdict


@pytest.mark.parametrize(
    ("rows", "word"),
    [
        (0.0, "excellent"),
        (0.1499, "excellent"),
        (0.15, "good"),
        (0.2999, "good"),
        (0.3, "usable"),
        (0.4999, "usable"),
        (0.5, "redo"),
        (9.0, "redo"),
        (float("nan"), "redo"),
    ],
)
def test_the_verdict_goes_by_the_held_out_rows(rows, word):
    assert verdict(rows) == word


# --- which image is wrong


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("index", [0, 7])
def test_an_image_with_half_its_corners_shifted_is_named_with_its_side(index, side):
    shift = shifted if side == "left" else in_right
    views = with_view(good_views(), index, shift(good_views()[index], (3, 2), 0.5))
    case = case_of(views)
    first = advise(case)[0]
    assert first.startswith(f"drop pair {index:02}: its corners are wrong in the {side} image")
    assert [bool(fault) for fault in faults(case)] == [i == index for i in range(12)]


def test_both_images_with_wrong_corners_are_named():
    wrong = in_right(shifted(good_views()[3], (3, 2), 0.5), (-2, 3), 0.5)
    first = advise(case_of(with_view(good_views(), 3, wrong)))[0]
    assert first.startswith("drop pair 03: its corners are wrong in both images")


@pytest.mark.parametrize("shift", [(3, 2), (0, 2), (4, 0), (-3, 3)])
def test_an_image_shifted_as_a_whole_is_named(shift):
    # Its corners are right among themselves: which of the two images is wrong cannot be told.
    case = case_of(with_view(good_views(), 5, shifted(good_views()[5], shift)))
    first = advise(case)[0]
    assert first.startswith("drop pair 05: its images miss each other by")
    assert case.judgement.verdict == "excellent"
    assert "solved without it" in first


def test_one_wrong_detection_among_thirty_is_named():
    views = sightings(distorted_rig(), board_poses(30, 8), 0.2, 8)
    case = case_of(with_view(views, 21, in_right(views[21], (4, -3), 0.4)))
    assert advise(case)[0].startswith("drop pair 21: its corners are wrong in the right image")
    assert len(case.solution.used_views) == 29


def test_nothing_is_wrong_with_good_pairs():
    case = case_of(good_views())
    assert faults(case) == [None] * 12
    assert not case.judgement.timing.unsynchronised
    misfits = find_misfits(case.solution)
    # An image of its own fits to its noise, 0.1 px in two coordinates less six for the pose.
    assert np.median(misfits.bent) == pytest.approx(0.1 * np.sqrt(2), rel=0.25)
    assert misfits.distance.max() < 0.2


def test_a_single_wrong_corner_does_not_condemn_its_pair():
    views = with_view(good_views(), 2, shifted(good_views()[2], (6, 0), 1 / 54))
    case = case_of(views)
    assert case.solution.rejected == 1
    assert faults(case) == [None] * 12


def a_few(sighting: Sighting, board: Board, around: int, count: int) -> Sighting:
    """The corners nearest to one of them."""
    apart = np.linalg.norm(board.points - board.points[around], axis=1)
    ids = np.sort(np.argsort(apart, kind="stable")[:count])
    return Sighting(ids, sighting.corners[ids])


def test_boards_seen_in_part_are_not_blamed_for_what_they_cannot_tell():
    board = Board(11, 8, 0.02)
    rng = np.random.default_rng(2)
    views = sightings(distorted_rig(), poses_in_view(distorted_rig(), 24, 5, board), 0.3, 5, board)
    for index in range(1, 24, 2):
        # Some pairs have no corner in common.
        left, right = (int(n) for n in rng.integers(0, 88, 2))
        right = right if index % 4 == 1 else left
        view = views[index]
        views[index] = PairSighting(
            a_few(view.left, board, left, 6), a_few(view.right, board, right, 8)
        )
    case = case_of(views, board)
    assert np.isnan(case.heldout.view_rms).any()
    assert faults(case) == [None] * 24
    # Carried by six corners, some boards are off by more than still boards ever are.
    assert case.judgement.misfits.distance.max() > 0.7
    assert not case.judgement.timing.unsynchronised


# --- exposures that differ


def hand_held(delay: float, count: int = 24) -> tuple[list[PairSighting], list[int]]:
    """A board waved in front of cameras of 20 Hz, the right one exposing `delay` s later."""

    def pose(t: float):
        R = cv2.Rodrigues(np.array([0.4 * np.sin(3 * t), 0.5 * np.sin(2 * t + 1), 0.2]))[0]
        x, y, z = 0.05 * np.sin(5 * t), 0.04 * np.sin(6.6 * t + 2), 0.45 + 0.1 * np.sin(2 * t)
        return R, np.array([0.06 + x, y, z]) - R @ BOARD.points.mean(axis=0)

    times = np.arange(count) * 0.05
    early = sightings(distorted_rig(), [pose(t) for t in times], 0.1, 1)
    late = sightings(distorted_rig(), [pose(t + delay) for t in times], 0.1, 2)
    views = [PairSighting(a.left, b.right) for a, b in zip(early, late, strict=True)]
    return views, [10**18 + round(t * 1e9) for t in times]


@pytest.mark.parametrize(("delay", "late"), [(0.008, "right"), (-0.008, "left")])
def test_a_delay_between_the_cameras_is_told_from_stamps(delay, late):
    views, stamps = hand_held(delay)
    case = case_of(views, stamps=stamps)
    found = case.judgement.timing.delay
    assert found is not None
    # The rig takes a part of the shift upon itself.
    assert 0.5 < found / delay < 1.2
    first = advise(case)[0]
    assert first.startswith("synchronise the cameras")
    assert f"the {late} camera exposes about" in first


def test_no_delay_is_told_where_there_is_none():
    views, stamps = hand_held(0.0)
    timing = case_of(views, stamps=stamps).judgement.timing
    assert timing.delay == pytest.approx(0.0, abs=5e-4)
    assert not timing.unsynchronised


def test_a_board_that_moves_in_many_pairs_is_the_cameras_fault():
    rng = np.random.default_rng(3)
    views = [in_right(view, rng.normal(0, 1.5, 2)) for view in good_views()]
    case = case_of(views)
    assert case.judgement.timing.delay is None
    advice = advise(case)
    assert advice[0].startswith("synchronise the cameras")
    assert "of most pairs" in advice[0]
    assert not [line for line in advice if line.startswith("drop pair")]


# --- where and how the boards stood


def test_coverage_names_the_parts_of_the_image():
    y, x = np.mgrid[0:6, 0:9]
    lower_left = np.column_stack([x.ravel() * 20 + 20, y.ravel() * 25 + 330]).astype(float)
    cover = coverage((640, 480), [lower_left, lower_left])
    assert cover.corners["lower left"] == 108
    assert sum(cover.corners.values()) == 108
    # The hull is 160 x 125 px of a region of 640/3 x 160.
    assert cover.regions["lower left"] == pytest.approx(160 * 125 / (640 / 3 * 160), abs=0.06)
    assert cover.share == pytest.approx(160 * 125 / (640 * 480), abs=0.01)
    assert "lower left" not in cover.poor
    assert len(cover.poor) == 8
    assert cover.boards.shape == (9, 12)
    assert cover.boards.max() == 2
    assert cover.boards[:5].sum() == 0


def test_the_whole_image_can_be_covered():
    corners = np.array([[0, 0], [639, 0], [639, 479], [0, 479]], float)
    cover = coverage((640, 480), [corners])
    assert cover.share == 1.0
    assert cover.poor == []
    assert (cover.boards == 1).all()


@pytest.mark.parametrize(
    ("turn", "edge"),
    [
        ((-0.4, 0, 0), "lower"),
        ((0.4, 0, 0), "upper"),
        ((0, 0.4, 0), "right"),
        ((0, -0.4, 0), "left"),
    ],
)
@pytest.mark.parametrize("numbered_from_behind", [False, True])
def test_tilts_are_told_by_the_edge_that_is_nearer(turn, edge, numbered_from_behind):
    R = cv2.Rodrigues(np.array(turn, float))[0]
    if numbered_from_behind:
        R = R @ cv2.Rodrigues(np.array([np.pi, 0, 0]))[0]
    # Which edge is nearer, by the corners themselves.
    placed = BOARD.points @ R.T
    axis, far_end = {"lower": (1, 1), "upper": (1, -1), "right": (0, 1), "left": (0, -1)}[edge]
    end = placed[np.argmax(far_end * placed[:, axis])]
    assert end[2] < placed[:, 2].mean()
    stood = attitudes(
        np.concatenate([cv2.Rodrigues(R)[0].ravel(), [0, 0, 0.5]])[None], BOARD.points
    )
    assert stood.tilted == {side: int(side == edge) for side in stood.tilted}
    assert np.abs(stood.tilts).max() == pytest.approx(0.4)
    assert edge not in stood.lacking
    assert len(stood.lacking) == 3


def test_views_that_are_missing_are_asked_for():
    def near(R, z=0.45):
        return R, np.array([0.06, 0, z]) - R @ BOARD.points.mean(axis=0)

    # Boards in the middle, at one distance, none with its left or right edge nearer.
    turns = [(a, 0, b) for a in (-0.5, -0.3, 0.3, 0.5) for b in (-0.3, 0, 0.3)]
    poses = [near(cv2.Rodrigues(np.array(turn, float))[0]) for turn in turns]
    advice = advise(case_of(sightings(distorted_rig(), poses, 0.1, 3)))
    assert advice[0].startswith("add tilted views towards all sides of the image, the board's left")
    assert any("right edge nearer either" in line for line in advice)
    assert any("all boards are about 0.4" in line for line in advice)


def test_few_pairs_ask_for_more():
    advice = advise(case_of(good_views()[:5]))
    assert advice[0].startswith("take at least 5 more pairs")


def test_rough_corners_ask_for_sharper_pairs_before_more_of_them():
    views = sightings(distorted_rig(), board_poses(12, 4), 0.5, 4)
    case = case_of(views)
    assert case.judgement.verdict in ("usable", "redo")
    advice = advise(case)
    assert advice[0].startswith("take sharper pairs, in focus")
    told = re.search(r"corners are off by ([0-9.]+) px", advice[0])
    assert told is not None
    assert float(told[1]) == pytest.approx(0.5 * np.sqrt(2), rel=0.1)
    assert any("add tilted views" in line for line in advice[1:])


def test_a_full_set_has_nothing_to_mend():
    rig = distorted_rig()
    advice = advise(case_of(sightings(rig, poses_in_view(rig, 60, 12), 0.1, 12)))
    assert advice == [NOTHING]
