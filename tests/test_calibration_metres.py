"""What a calibration means in metres: the size of the squares, the doubt of depth, and the geometry
beneath them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.board import Board
from calibration.depth_doubt import calibration_sigma, common_pixels, depth_doubt, moved
from calibration.resection import resect
from calibration.scale_check import check_ruler, doubtful_size, reconstructed_squares
from calibration.sighting import Sighting
from calibration.solve import solve_stereo
from calibration.triangulate import triangulate
from tests.calibration_views import (
    BOARD,
    board_poses,
    distorted_rig,
    fisheye_rig,
    pixels_of,
    poses_in_view,
    project,
    sightings,
)


@cache
def good_views():
    """Twelve pairs with 0.1 px of noise."""
    return tuple(sightings(distorted_rig(), poses_in_view(distorted_rig(), 12, 4), 0.1, 4))


@cache
def good_solution():
    return solve_stereo(good_views(), BOARD.points, (640, 480))


# --- sizes


def test_squares_come_back_at_their_size():
    squares = reconstructed_squares(good_solution(), BOARD)
    assert squares.ratio == pytest.approx(1.0, abs=1e-3)
    assert 0 < squares.scatter < 0.02


def test_a_ruler_that_disagrees_tells_the_squares_true_size():
    # The printer made squares of 24.4 mm, and we were told 25.
    printed = Board(9, 6, 0.0244)
    views = sightings(distorted_rig(), board_poses(12, 4, printed), 0.05, 4, printed)
    solution = solve_stereo(views, BOARD.points, (640, 480))
    check = check_ruler(solution, 0.025, 0.120)
    assert check.square == pytest.approx(0.0244, rel=0.002)
    assert check.excess == pytest.approx(25 / 24.4 - 1, abs=0.003)
    # 2.9 mm are more than a ruler's mistake, just not thrice.
    assert check.agrees
    check = check_ruler(solution, 0.025, 0.115)
    doubt = doubtful_size(BOARD, check)
    assert doubt is not None
    assert "the squares are probably 23.38 mm, not 25: measure the board again" in doubt


def test_a_ruler_that_agrees_raises_no_doubt():
    check = check_ruler(good_solution(), 0.025, 0.1205)
    assert check.agrees
    assert doubtful_size(BOARD, check) is None
    # A millimetre of the ruler; the boards' own doubt adds little.
    assert 1e-3 <= check.sigma < 1.1e-3


@pytest.mark.parametrize(("square", "told"), [(0.25, "larger than any sheet"), (0.0025, "a stamp")])
def test_wrong_units_are_recognised_by_the_size_of_the_board(square, told):
    doubt = doubtful_size(Board(9, 6, square), None)
    assert doubt is not None
    assert doubt.startswith("check the unit of --square")
    assert told in doubt


def test_wrong_units_are_recognised_by_the_ruler():
    tenfold = Board(9, 6, 0.25)
    solution = solve_stereo(good_views(), tenfold.points, (640, 480))
    doubt = doubtful_size(tenfold, check_ruler(solution, tenfold.square, 0.12))
    assert doubt is not None
    assert "check the unit of --square: 250 mm may well be 25 mm" in doubt


# --- what it means for depth


def test_the_doubt_of_depth_is_that_of_rigs_drawn_from_the_covariance():
    solution = good_solution()
    distances = np.array([0.5, 2.0, 5.0])
    left, right, index = common_pixels(solution.rig, distances)
    np.testing.assert_allclose(triangulate(solution.rig, left, right)[:, 2], distances[index])
    rng = np.random.default_rng(1)
    drawn = rng.multivariate_normal(np.zeros(len(solution.names)), solution.covariance, 150)
    depths = []
    for change in drawn:
        other = solution
        for name, step in zip(solution.names, change, strict=True):
            other = replace(other, rig=moved(other, name, step))
        depths.append(triangulate(other.rig, left, right)[:, 2])
    variance = np.var(depths, axis=0)
    spread = [np.sqrt(variance[index == at].mean()) for at in range(3)]
    np.testing.assert_allclose(calibration_sigma(solution, distances), spread, rtol=0.15)


def test_the_usable_range_is_where_both_errors_reach_the_tolerance():
    solution = good_solution()
    doubt = depth_doubt(solution)
    assert (np.diff(doubt.total) > 0).all()
    at_range = depth_doubt(solution, [doubt.usable_range])
    assert at_range.total[0] == pytest.approx(doubt.tolerance, rel=0.02)
    # A hundredth of the covariance leaves matching alone.
    certain = depth_doubt(replace(solution, covariance=solution.covariance * 1e-4))
    np.testing.assert_allclose(certain.total, certain.from_matching, rtol=1e-3)
    assert certain.usable_range > doubt.usable_range


# --- geometry


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(st.floats(-0.5, 0.5), st.floats(-0.4, 0.4), st.floats(0.3, 20.0)),
        min_size=1,
        max_size=5,
    ),
    st.sampled_from(["radtan", "fisheye"]),
)
def test_points_are_triangulated_where_they_are(slopes, lens):
    rig = distorted_rig() if lens == "radtan" else fisheye_rig(120)
    points = np.array([(x * z, y * z, z) for x, y, z in slopes])
    left, right = pixels_of(rig.left, points), pixels_of(rig.right, points @ rig.R.T + rig.T)
    np.testing.assert_allclose(triangulate(rig, left, right), points, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("rig", [distorted_rig(), fisheye_rig(140)])
def test_a_board_is_placed_from_one_image(rig):
    R, t = board_poses(1, 2)[0]
    corners = project(rig, (R, t))[0]
    start = cv2.Rodrigues(np.array([0.05, -0.04, 0.1]))[0] @ R
    seen = Sighting(np.arange(54), corners)
    found_R, found_t, residuals = resect(rig.left, seen, BOARD.points, start, t * 1.1)
    np.testing.assert_allclose(found_R, R, atol=1e-8)
    np.testing.assert_allclose(found_t, t, atol=1e-8)
    assert np.abs(residuals).max() < 1e-6
