"""A known rig is found again from noisy corners."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.epipolar import row_differences
from calibration.errors import CalibrationError
from calibration.solve import solve_stereo
from tests.calibration_views import BOARD, board_poses, distorted_rig, project


def noisy_views(count: int, noise: float, seed: int = 5):
    rng = np.random.default_rng(seed)
    views = [project(distorted_rig(), pose) for pose in board_poses(count, seed)]
    left, right = zip(*views, strict=True)
    return tuple([c + rng.normal(0, noise, c.shape) for c in side] for side in (left, right))


def test_the_rig_is_recovered_within_its_noise():
    truth = distorted_rig()
    left, right = noisy_views(20, 0.1)
    solution = solve_stereo(left, right, BOARD, truth.image_size)
    rig = solution.rig
    assert rig.baseline == pytest.approx(truth.baseline, rel=0.002)
    for found, true in ((rig.left, truth.left), (rig.right, truth.right)):
        assert found.fx == pytest.approx(true.fx, rel=0.004)
        assert found.fy == pytest.approx(true.fy, rel=0.004)
        assert found.cx == pytest.approx(true.cx, abs=2.5)
        assert found.cy == pytest.approx(true.cy, abs=2.5)
        assert found.distortion_model == "radtan"
        assert found.distortion[0] == pytest.approx(true.distortion[0], abs=0.03)
    turn = cv2.Rodrigues(rig.R @ truth.R.T)[0]
    assert np.degrees(np.linalg.norm(turn)) < 0.15
    # 0.1 px in each of two coordinates.
    assert solution.rms == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    assert solution.view_rms.shape == (20, 2)
    assert solution.rms == pytest.approx(np.sqrt(np.mean(solution.view_rms**2)))


def test_perfect_corners_give_the_rig_itself():
    truth = distorted_rig()
    left, right = noisy_views(12, 0.0)
    rig = solve_stereo(left, right, BOARD, truth.image_size).rig
    np.testing.assert_allclose(rig.T, truth.T, atol=2e-6)
    np.testing.assert_allclose(rig.left.K, truth.left.K, atol=0.01)
    np.testing.assert_allclose(rig.right.D, truth.right.D, atol=1e-3)


def test_the_same_corners_give_the_same_bytes_whatever_the_threads():
    left, right = noisy_views(8, 0.1)
    threads = cv2.getNumThreads()
    results = []
    try:
        for count in (1, 2, 4):
            cv2.setNumThreads(count)
            rig = solve_stereo(left, right, BOARD, (640, 480)).rig
            assert cv2.getNumThreads() == count
            results.append((rig.left, rig.right, rig.R.tobytes(), rig.T.tobytes()))
    finally:
        cv2.setNumThreads(threads)
    assert results[0] == results[1] == results[2]


def test_swapped_cameras_are_recognised():
    left, right = noisy_views(8, 0.1)
    with pytest.raises(CalibrationError, match=r"(119|120)\.[0-9] mm to the left .* swapped"):
        solve_stereo(right, left, BOARD, (640, 480))


def test_views_of_mixed_up_pairs_are_refused():
    left, right = noisy_views(8, 0.1)
    with pytest.raises(CalibrationError, match="fit no pair of cameras"):
        solve_stereo(left, right[1:] + right[:1], BOARD, (640, 480))


def test_row_differences_vanish_for_the_true_rig_and_show_a_tilted_one():
    rig = distorted_rig()
    left, right = project(rig, board_poses(1, 2)[0])
    assert np.abs(row_differences(rig, left, right)).max() < 1e-3
    # A camera nodding by 2 mrad shifts its rows by 2e-3 f, about 1 px.
    nodded = replace(rig, R=cv2.Rodrigues(np.array([0.002, 0.0, 0.0]))[0] @ rig.R)
    shift = row_differences(nodded, left, right)
    assert np.abs(shift).mean() == pytest.approx(1.0, abs=0.3)
