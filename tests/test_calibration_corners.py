"""Corners of drawn boards, and their numbering in the two images of a pair."""

import cv2
import numpy as np
import pytest

from calibration.board import Board
from calibration.corners import find_corners, look
from calibration.correspondence import same_order
from tests.calibration_views import BOARD, SMALL_RIG, board_poses, project, render

SYMMETRIC = Board(6, 4, 0.03)
SQUARE = Board(5, 5, 0.03)


@pytest.mark.parametrize("seed", range(4))
def test_corners_of_a_drawn_board_are_found_to_a_tenth_of_a_pixel(seed):
    (pose,) = board_poses(1, seed, distance=(0.45, 0.6))
    truth, _ = project(SMALL_RIG, pose)
    image, _ = render(SMALL_RIG, pose)
    found = find_corners(image, BOARD)
    assert found is not None
    error = np.linalg.norm(found - truth, axis=1)
    # OpenCV may number this board from its other end.
    turned = np.linalg.norm(found[::-1] - truth, axis=1)
    assert min(np.sqrt(np.mean(error**2)), np.sqrt(np.mean(turned**2))) < 0.1


def test_a_badly_blurred_board_is_still_found():
    (pose,) = board_poses(1, 1, distance=(0.45, 0.5))
    image, _ = render(SMALL_RIG, pose)
    blurred = cv2.GaussianBlur(image, (0, 0), 3.5)
    quads_only = cv2.findChessboardCorners(blurred, (BOARD.columns, BOARD.rows))[0]
    assert not quads_only
    assert find_corners(blurred, BOARD) is not None


def test_a_cut_board_gives_none():
    (pose,) = board_poses(1, 1)
    image, _ = render(SMALL_RIG, pose)
    image[:, 160:] = 110
    assert find_corners(image, BOARD) is None


def test_an_image_of_no_use_says_why(tmp_path):
    (tmp_path / "torn.png").write_bytes(b"\x89PNG\r\n\x1a\n torn")
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((240, 320), 90, np.uint8))
    assert look(tmp_path / "torn.png", BOARD).reason == "torn.png cannot be read"
    seen = look(tmp_path / "wall.png", BOARD)
    assert (seen.size, seen.reason) == ((320, 240), "no whole board in wall.png")


@pytest.mark.parametrize("seed", range(5))
def test_a_board_numbered_from_the_other_end_is_put_right(seed):
    (pose,) = board_poses(1, seed, SYMMETRIC)
    left, right = project(SMALL_RIG, pose, SYMMETRIC)
    numbered, changed = same_order(left, right[::-1], SYMMETRIC)
    assert changed
    np.testing.assert_array_equal(numbered, right)


@pytest.mark.parametrize("turns", range(4))
def test_a_square_board_may_be_numbered_from_any_corner(turns):
    (pose,) = board_poses(1, 3, SQUARE)
    left, right = project(SMALL_RIG, pose, SQUARE)
    turned = np.rot90(right.reshape(5, 5, 2), turns).reshape(-1, 2)
    numbered, changed = same_order(left, turned, SQUARE)
    assert changed == (turns != 0)
    np.testing.assert_array_equal(numbered, right)
