"""The row error of pairs left out, and the lens that it chooses."""

import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.board import parse_board
from calibration.corners import look_at_all
from calibration.correspondence import pair_sightings
from calibration.epipolar import row_differences
from calibration.heldout import held_out
from calibration.imagepairs import find_pairs
from calibration.lens_choice import choose_lens
from calibration.rig import CameraModel
from calibration.solve import solve_stereo
from tests.calibration_views import (
    BOARD,
    board_poses,
    distorted_rig,
    fisheye_rig,
    normalised_errors,
    poses_in_view,
    project,
    shifted,
    sightings,
    undistorted,
)

SIZE = (640, 480)


def views_of(rig, count: int, noise: float = 0.15, seed: int = 3):
    return sightings(rig, poses_in_view(rig, count, seed), noise, seed)


def test_row_differences_vanish_for_the_true_rig_and_show_a_tilted_one():
    rig = distorted_rig()
    left, right = project(rig, board_poses(1, 2)[0])
    assert np.abs(row_differences(rig, left, right)).max() < 1e-9
    # A camera nodding by 2 mrad shifts its rows by 2e-3 f, about 1 px.
    nodded = replace(rig, R=cv2.Rodrigues(np.array([0.002, 0.0, 0.0]))[0] @ rig.R)
    shift = row_differences(nodded, left, right)
    assert np.abs(shift).mean() == pytest.approx(1.0, abs=0.3)
    on_a_sphere = row_differences(nodded, left, right, spherical=True)
    np.testing.assert_allclose(on_a_sphere, shift, rtol=0.5)


def test_rows_are_those_of_opencvs_rectification():
    rig = distorted_rig()
    left, right = project(rig, board_poses(1, 2)[0])
    left = left + np.random.default_rng(0).normal(0, 0.5, left.shape)
    K1, D1, K2, D2 = rig.left.K, rig.left.D, rig.right.K, rig.right.D
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        K1, D1, K2, D2, rig.image_size, rig.R, rig.T.reshape(3, 1)
    )
    rows_left = undistorted(left, K1, D1, R1, P1)[:, 1]
    rows_right = undistorted(right, K2, D2, R2, P2)[:, 1]
    np.testing.assert_allclose(row_differences(rig, left, right), rows_right - rows_left, atol=1e-6)


def test_rows_of_fisheye_images_are_level_all_around():
    rig = fisheye_rig(180)
    for pose in poses_in_view(rig, 10, 1):
        left, right = project(rig, pose)
        assert np.abs(row_differences(rig, left, right)).max() < 1e-9
        shift = row_differences(rig, left, right + np.array([0.0, 0.5]))
        assert 0.05 < np.abs(shift).max() < 0.8


def test_each_pair_is_left_out_of_its_own_rig():
    views = views_of(distorted_rig(), 8)
    solution = solve_stereo(views, BOARD.points, SIZE)
    held = held_out(solution)
    assert held.groups.tolist() == list(range(8))
    # From scratch without pair 2: the same.
    alone = solve_stereo(views[:2] + views[3:], BOARD.points, SIZE)
    _, left, right = views[2].common()
    expected = row_differences(alone.rig, left, right)
    np.testing.assert_allclose(held.rows[2], expected, atol=1e-3)
    # Two rows with 0.15 px of noise each, and the rig's own doubt on top.
    inside = np.concatenate([row_differences(solution.rig, *v.common()[1:]) for v in views])
    assert held.row_rms > np.sqrt(np.mean(inside**2))
    assert 0.15 < held.row_rms < 0.3
    assert held.row_rms == pytest.approx(np.sqrt(np.mean(held.view_rms**2)))


def test_many_pairs_are_left_out_in_ten_groups():
    solution = solve_stereo(views_of(distorted_rig(), 21), BOARD.points, SIZE)
    groups = held_out(solution).groups
    assert sorted(np.bincount(groups).tolist()) == [2] * 9 + [3]


def test_an_outlier_view_has_its_error_told_but_not_counted():
    views = views_of(distorted_rig(), 10)
    clean = held_out(solve_stereo(views, BOARD.points, SIZE)).row_rms
    views[6] = shifted(views[6], (3.0, 2.0))
    solution = solve_stereo(views, BOARD.points, SIZE)
    held = held_out(solution)
    assert solution.outlier_views == (6,)
    assert held.groups[6] == -1
    assert held.view_rms[6] > 1.0
    assert held.row_rms == pytest.approx(clean, rel=0.15)


def test_the_simple_lens_is_kept_where_it_is_true():
    solution, held, trials = choose_lens(views_of(distorted_rig(), 12), BOARD.points, SIZE)
    assert solution.lens == "radtan4"
    assert [t.lens for t in trials] == ["radtan4", "radtan5", "rational"]
    assert [t.chosen for t in trials] == [True, False, False]
    assert trials[0].row_rms == held.row_rms
    # More parameters always fit better, and that is not what counts.
    assert trials[2].rms is not None
    assert trials[2].rms < solution.rms


def test_a_richer_lens_is_chosen_where_it_is_needed():
    rig = distorted_rig()
    lens = (-0.3, 0.12, 0.0004, -0.0003, 0.22)
    cameras = [CameraModel(330, 331, 322, 238, "radtan", lens) for _ in "lr"]
    rig = replace(rig, left=cameras[0], right=cameras[1])
    solution, _, trials = choose_lens(views_of(rig, 14, 0.1), BOARD.points, SIZE)
    assert solution.lens == "radtan5"
    assert trials[1].remark.startswith("clearly better")
    assert np.abs(normalised_errors(rig, solution)).max() < 3.5


def test_a_fisheye_lens_is_recognised():
    rig = fisheye_rig(150)
    solution, held, _ = choose_lens(views_of(rig, 14), BOARD.points, SIZE)
    assert solution.lens == "fisheye"
    assert np.abs(normalised_errors(rig, solution)).max() < 3.5
    assert 0.15 < held.row_rms < 0.3


def real_views(name: str, board_name: str, square: float):
    root = os.environ.get("BEEMAP_REAL_DATA")
    if not root:
        pytest.skip("BEEMAP_REAL_DATA is not set")
    folder, board = Path(root) / "calibration" / name, parse_board(board_name, square)
    pairs = find_pairs(f"{folder}/left[0-9]*.jpg", f"{folder}/right[0-9]*.jpg").pairs
    images = look_at_all([path for pair in pairs for path in (pair.left, pair.right)], board)
    seen = [image.sighting for image in images if image.sighting is not None]
    assert len(seen) == 2 * len(pairs)
    views = [
        pair_sightings(left, right, board)[0]
        for left, right in zip(seen[::2], seen[1::2], strict=True)
    ]
    return views, board.points


def test_opencvs_sample_is_solved_with_all_its_pairs():
    views, points = real_views("opencv-sample", "chessboard:9x6", 0.025)
    solution, held, trials = choose_lens(views, points, SIZE)
    assert solution.used_views == tuple(range(13))
    assert solution.lens == "radtan4"
    assert solution.rms <= 0.196
    assert held.row_rms <= 0.142
    assert solution.rig.baseline == pytest.approx(0.0834, abs=0.0005)
    rational = trials[2]
    assert rational.rms is not None
    assert rational.rms < solution.rms
    assert rational.remark.startswith("over-fitting")


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_shifted_image_of_opencvs_sample_is_found(share):
    views, points = real_views("opencv-sample", "chessboard:9x6", 0.025)
    for wrong in (0, 5, 7):
        spoilt = list(views)
        spoilt[wrong] = shifted(views[wrong], (3.0, 2.0), share)
        solution = solve_stereo(spoilt, points, SIZE)
        assert solution.outlier_views == (wrong,)
        assert solution.rig.baseline == pytest.approx(0.0834, abs=0.0005)


def test_bumblebees_chessboard_gives_its_makers_baseline():
    views, points = real_views("bumblebee2-chess", "chessboard:4x6", 0.030)
    solution = solve_stereo(views, points, SIZE)
    assert solution.rms <= 0.09
    assert held_out(solution).row_rms <= 0.07
    assert solution.rig.baseline == pytest.approx(0.12005, abs=0.0004)
