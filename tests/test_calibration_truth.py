"""The stated standard deviations are true: errors against known rigs, over many of them."""

import cv2
import numpy as np
import pytest

from calibration.solve import solve_stereo
from tests.calibration_views import (
    BOARD,
    Photograph,
    fisheye_rig,
    normalised_errors,
    photographed,
    poses_in_view,
    random_rig,
    sightings,
)


@pytest.fixture(autouse=True)
def one_opencv_thread():
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(threads)


def check(rigs, solutions, deviations: tuple[float, float]) -> None:
    errors = np.array([normalised_errors(r, s) for r, s in zip(rigs, solutions, strict=True)])
    assert np.mean(np.abs(errors) < 3) >= 0.97
    assert deviations[0] < errors.std() < deviations[1]
    for rig, solution in zip(rigs, solutions, strict=True):
        assert solution.rig.baseline == pytest.approx(rig.baseline, rel=0.002)
        assert solution.outlier_views == ()


def test_sigmas_are_honest_for_noisy_corners():
    rigs, solutions = [], []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        rig = random_rig(seed)
        poses = poses_in_view(rig, int(rng.integers(10, 20)), seed)
        views = sightings(rig, poses, rng.uniform(0.05, 0.3), seed)
        rigs.append(rig)
        solutions.append(solve_stereo(views, BOARD.points, rig.image_size))
    # 352 errors, not all independent.
    check(rigs, solutions, (0.85, 1.15))


def test_sigmas_are_honest_for_rendered_images():
    # `python -m benchmarks.calibration` does it for twenty rigs.
    rigs, solutions = [], []
    for seed, how in ((1, Photograph(1.0, 8.0, 1)), (13, Photograph(0.6, 3.0, 2))):
        rig = random_rig(seed)
        views = photographed(rig, poses_in_view(rig, 11, seed), how)
        rigs.append(rig)
        solutions.append(solve_stereo(views, BOARD.points, rig.image_size))
    check(rigs, solutions, (0.5, 1.5))


def test_sigmas_are_honest_for_fisheye_lenses():
    rigs, solutions = [], []
    for seed, degrees in enumerate((100, 120, 140, 160, 180)):
        rig = fisheye_rig(degrees, seed)
        views = sightings(rig, poses_in_view(rig, 14, seed), 0.15, seed)
        rigs.append(rig)
        solutions.append(solve_stereo(views, BOARD.points, rig.image_size, "fisheye"))
    check(rigs, solutions, (0.7, 1.3))
