"""A known rig is found again from noisy corners, and from corners of which some are wrong."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.rig import CameraModel, StereoRig
from calibration.sighting import PairSighting, Sighting
from calibration.solve import solve_stereo
from tests.calibration_views import (
    BOARD,
    distorted_rig,
    normalised_errors,
    poses_in_view,
    random_rig,
    shifted,
    sightings,
)

SIZE = (640, 480)


def noisy_views(count: int, noise: float, seed: int = 5) -> list[PairSighting]:
    rig = distorted_rig()
    return sightings(rig, poses_in_view(rig, count, seed), noise, seed)


def solve(views, lens: str = "radtan4", start=None):
    return solve_stereo(views, BOARD.points, SIZE, lens, start)


def test_the_rig_is_recovered_within_its_noise():
    truth = distorted_rig()
    solution = solve(noisy_views(20, 0.1))
    rig = solution.rig
    assert rig.baseline == pytest.approx(truth.baseline, rel=0.002)
    for found, true in ((rig.left, truth.left), (rig.right, truth.right)):
        assert found.fx == pytest.approx(true.fx, rel=0.003)
        assert found.fy == pytest.approx(true.fy, rel=0.003)
        assert found.cx == pytest.approx(true.cx, abs=1.5)
        assert found.cy == pytest.approx(true.cy, abs=1.5)
        assert found.distortion_model == "radtan"
        assert found.distortion[0] == pytest.approx(true.distortion[0], abs=0.02)
    assert np.abs(normalised_errors(truth, solution)).max() < 3.5
    # 0.1 px in each of two coordinates.
    assert solution.rms == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    assert solution.view_rms.shape == (20, 2)
    assert solution.rms == pytest.approx(np.sqrt(np.mean(solution.view_rms**2)))
    assert solution.corners == 20 * 2 * 54
    assert solution.outlier_views == ()


def test_perfect_corners_give_the_rig_itself():
    truth = distorted_rig()
    rig = solve(noisy_views(12, 0.0)).rig
    np.testing.assert_allclose(rig.T, truth.T, atol=1e-8)
    np.testing.assert_allclose(rig.R, truth.R, atol=1e-7)
    np.testing.assert_allclose(rig.left.K, truth.left.K, atol=1e-4)
    np.testing.assert_allclose(rig.right.D, truth.right.D, atol=1e-5)


def test_the_poses_carry_the_board_to_the_left_camera():
    poses = poses_in_view(distorted_rig(), 6, 5)
    solution = solve(noisy_views(6, 0.0))
    for found, (R, t) in zip(solution.poses, poses, strict=True):
        np.testing.assert_allclose(cv2.Rodrigues(found[:3])[0], R, atol=1e-5)
        np.testing.assert_allclose(found[3:], t, atol=1e-6)


def test_four_pairs_of_strongly_distorted_images_are_enough():
    lens = (-0.42, 0.2, 0.0005, -0.0005)
    left, right = (CameraModel(f, 1.002 * f, 322, 236, "radtan", lens) for f in (330.0, 333.0))
    rig = StereoRig(SIZE, left, right, distorted_rig().R, np.array([-0.1, 0.001, 0.001]))
    for seed in range(4):
        solution = solve(sightings(rig, poses_in_view(rig, 4, seed), 0.15, seed))
        assert solution.rig.left.fx == pytest.approx(330, rel=0.01)
        assert solution.rig.baseline == pytest.approx(rig.baseline, rel=0.005)
        assert np.abs(normalised_errors(rig, solution)).max() < 4


def test_images_that_show_different_parts_of_the_board_are_used():
    def part(sighting: Sighting, chosen: np.ndarray) -> Sighting:
        return Sighting(sighting.ids[chosen], sighting.corners[chosen])

    rng = np.random.default_rng(1)
    views = [
        PairSighting(
            part(v.left, np.sort(rng.choice(54, rng.integers(12, 50), replace=False))),
            part(v.right, np.sort(rng.choice(54, rng.integers(12, 50), replace=False))),
        )
        for v in noisy_views(14, 0.1)
    ]
    solution = solve(views)
    assert np.abs(normalised_errors(distorted_rig(), solution)).max() < 3.5
    for view, residuals, kept in zip(views, solution.residuals, solution.kept, strict=True):
        assert residuals[0].shape == view.left.corners.shape
        assert kept[1].shape == view.right.ids.shape


def test_single_wrong_corners_are_rejected_and_counted():
    views = noisy_views(12, 0.1)
    corners = views[3].right.corners.copy()
    corners[[7, 30]] += (4.0, -3.0)
    views[3] = PairSighting(views[3].left, Sighting(views[3].right.ids, corners))
    solution = solve(views)
    assert not solution.kept[3][1][[7, 30]].any()
    assert 2 <= solution.rejected <= 4
    assert not solution.rejection_capped
    assert solution.rms > 0.2 > solution.rms_kept
    assert np.abs(normalised_errors(distorted_rig(), solution)).max() < 3.5


def test_more_wrong_corners_than_may_be_rejected_are_said_to_be():
    views = noisy_views(12, 0.1)
    rng = np.random.default_rng(3)
    for i, view in enumerate(views):
        corners = view.left.corners.copy()
        corners[rng.choice(54, 4, replace=False)] += 3.0
        views[i] = PairSighting(Sighting(view.left.ids, corners), view.right)
    solution = solve(views)
    assert solution.rejection_capped
    assert solution.rejected == int(0.02 * solution.corners)


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_shifted_image_is_left_out_and_named(share):
    views = noisy_views(13, 0.15)
    views[4] = shifted(views[4], (3.0, 2.0), share)
    solution = solve(views)
    assert solution.outlier_views == (4,)
    assert np.argmax(solution.view_rms.max(axis=1)) == 4
    assert not solution.kept[4][0].any()
    assert solution.corners == 12 * 2 * 54
    assert solution.rms < 0.25
    assert np.abs(normalised_errors(distorted_rig(), solution)).max() < 3.5


def test_one_wrong_detection_among_thirty_moves_nothing():
    views = noisy_views(30, 0.1)
    flipped = Sighting(views[7].right.ids, views[7].right.corners[::-1].copy())
    views[7] = PairSighting(views[7].left, flipped)
    views[20] = PairSighting(views[3].left, views[20].right)
    solution = solve(views)
    assert solution.outlier_views == (7, 20)
    assert np.abs(normalised_errors(distorted_rig(), solution)).max() < 3.5


def test_a_start_saves_the_search_and_changes_nothing():
    views = noisy_views(10, 0.1)
    first = solve(views)
    again = solve(views[2:] + noisy_views(2, 0.1, seed=9), start=first)
    alone = solve(views[2:] + noisy_views(2, 0.1, seed=9))
    np.testing.assert_allclose(again.rig.T, alone.rig.T, atol=1e-7)
    richer = solve(views, "radtan5", start=first)
    assert len(richer.rig.left.distortion) == 5
    assert richer.rms <= first.rms
    # A start of another kind is passed over.
    assert solve(views, "radtan4", start=richer).rms == pytest.approx(first.rms, rel=1e-6)


def test_swapped_cameras_are_recognised():
    swapped = [PairSighting(view.right, view.left) for view in noisy_views(8, 0.1)]
    with pytest.raises(CalibrationError, match=r"(119|120)\.[0-9] mm to the left .* swapped"):
        solve(swapped)


def test_views_of_mixed_up_pairs_are_refused():
    views = noisy_views(8, 0.1)
    mixed = [PairSighting(views[i].left, views[i - 1].right) for i in range(8)]
    with pytest.raises(CalibrationError, match="fit no pair of cameras"):
        solve(mixed)


@pytest.mark.parametrize("noise", [0.0, 0.2])
@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_parallel_boards_are_refused_at_any_noise(tilt, noise):
    rng = np.random.default_rng(1)
    facing = cv2.Rodrigues(np.array([tilt, tilt / 2, 0]))[0]
    poses = []
    for _ in range(10):
        R = facing @ cv2.Rodrigues(np.array([0, 0, rng.uniform(-0.5, 0.5)]))[0]
        poses.append(
            (R, np.array([*rng.uniform((-0.15, -0.12), (0.1, 0.02)), rng.uniform(0.4, 1)]))
        )
    views = sightings(distorted_rig(), poses, noise)
    with pytest.raises(CalibrationError, match="all boards stand parallel"):
        solve(views)


def test_boards_that_barely_tilt_leave_the_focal_length_open():
    rig = replace(random_rig(3, (30, 31)), R=np.eye(3))
    rng = np.random.default_rng(2)
    poses = [
        (cv2.Rodrigues(rng.uniform(-0.08, 0.08, 3))[0], np.array([*rng.uniform(-0.1, -0.05, 2), 1]))
        for _ in range(5)
    ]
    with pytest.raises(CalibrationError, match="do not determine the cameras"):
        solve(sightings(rig, poses, 0.2))


def test_too_little_is_refused():
    views = noisy_views(4, 0.1)
    with pytest.raises(CalibrationError, match="2 usable pairs are too few"):
        solve(views[:2])
    sparse = PairSighting(views[1].left, Sighting(np.arange(3), views[1].right.corners[:3]))
    with pytest.raises(CalibrationError, match="pair 2 of 4 shows 3 corners"):
        solve([views[0], sparse, *views[2:]])
