"""The bundle adjustment: its equations are those of plain least squares."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from calibration.bundle import Geometry, adjust, linearise, normal_equations, reduced
from calibration.covariance import camera_covariance
from calibration.lens import LENSES
from calibration.outliers import LEAST_WRONG, noise_scale, select
from calibration.sighting import PairSighting, Sighting
from calibration.solve import observe
from calibration.start import start_camera, start_poses
from tests.calibration_views import BOARD, distorted_rig, poses_in_view, sightings

LENS = LENSES["radtan4"]


def truth(count: int) -> Geometry:
    rig, poses = distorted_rig(), poses_in_view(distorted_rig(), count, 1)
    return Geometry(
        np.stack([LENS.intrinsics(rig.left), LENS.intrinsics(rig.right)]),
        np.stack([np.eye(3), rig.R]),
        np.stack([np.zeros(3), rig.T]),
        np.stack([R for R, _ in poses]),
        np.stack([t for _, t in poses]),
    )


def noisy(count: int, noise: float):
    rig = distorted_rig()
    return observe(sightings(rig, poses_in_view(rig, count, 1), noise), BOARD.points)


def dense(geometry: Geometry, seen, weights) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian and residuals of the whole problem, by finite differences, weighted."""
    views = len(geometry.board_rotation)
    size = 22 + 6 * views
    root = np.sqrt(weights)[..., None]

    def residuals(step: np.ndarray) -> np.ndarray:
        moved = geometry.moved(step[:22], step[22:].reshape(views, 6))
        return (root * linearise(LENS, seen, moved)[0]).ravel()

    steps = 1e-6 * np.eye(size)
    J = np.stack([(residuals(-s) - residuals(s)) / 2e-6 for s in steps], axis=1)
    return J, residuals(np.zeros(size))


def test_the_step_is_that_of_plain_least_squares():
    seen, geometry = noisy(3, 0.5), truth(3)
    weights = seen.seen * np.random.default_rng(2).uniform(0.1, 1, seen.seen.shape)
    J, residuals = dense(geometry, seen, weights)
    expected = np.linalg.lstsq(J, residuals, rcond=None)[0]
    found, derivatives = linearise(LENS, seen, geometry)
    H, right = reduced(normal_equations(derivatives, found, weights))
    np.testing.assert_allclose(np.linalg.solve(H, right), expected[:22], rtol=2e-3, atol=1e-7)


def test_the_covariance_is_that_of_the_whole_problem():
    seen = noisy(4, 0.2)
    geometry, residuals = adjust(LENS, seen, truth(4), seen.seen.astype(float))
    covariance = camera_covariance(LENS, seen, geometry, seen.seen)
    J, _ = dense(geometry, seen, seen.seen.astype(float))
    freedom = residuals.size - J.shape[1]
    expected = np.linalg.inv(J.T @ J)[:22, :22] * np.sum(residuals**2) / freedom
    sigma, wanted = np.sqrt(np.diag(covariance.matrix)), np.sqrt(np.diag(expected))
    np.testing.assert_allclose(sigma, wanted, rtol=1e-3)
    assert covariance.names[0] == "left.fx"
    assert covariance.names[12] == "right.k1"
    assert covariance.names[-1] == "translation.z"


def test_corners_seen_by_one_camera_only_count_too():
    rig, poses = distorted_rig(), poses_in_view(distorted_rig(), 8, 1)
    views = [
        PairSighting(
            Sighting(v.left.ids[i:40], v.left.corners[i:40]),
            Sighting(v.right.ids[i + 8 :], v.right.corners[i + 8 :]),
        )
        for i, v in enumerate(sightings(rig, poses))
    ]
    seen = observe(views, BOARD.points)
    start = truth(8).moved(np.full(22, 1e-3), np.full((8, 6), 1e-3))
    geometry, residuals = adjust(LENS, seen, start, seen.seen.astype(float))
    assert np.abs(residuals).max() < 1e-5
    np.testing.assert_allclose(geometry.t[1], rig.T, atol=1e-7)


def test_poses_from_rays_are_the_boards():
    # The rays of the true lens: exact poses, from a part of the board as well.
    seen, geometry = noisy(6, 0.0), truth(6)
    seen.seen[:, 2, 20:] = False
    R, t = start_poses(LENS, geometry.intrinsics[0], seen)
    np.testing.assert_allclose(R, geometry.board_rotation, atol=1e-6)
    np.testing.assert_allclose(t, geometry.board_position, atol=1e-6)


def test_one_camera_is_found_from_nothing():
    seen = noisy(8, 0.05)
    found = start_camera(LENS, seen, 1, (640, 480))
    assert found.intrinsics[0, 0] == pytest.approx(distorted_rig().right.fx, rel=0.01)


def test_selection_is_by_the_noise_capped_and_spares_what_is_merely_noisy():
    rng = np.random.default_rng(0)
    seen = np.ones((2, 10, 54), bool)
    clean = rng.normal(0, 0.1, (2, 10, 54, 2))
    assert noise_scale(clean, seen) == pytest.approx(0.1, rel=0.05)
    assert np.count_nonzero(~select(clean, seen).kept) <= 1

    few = clean.copy()
    few[0, 3, :5] += 2.0
    chosen = select(few, seen)
    assert not chosen.kept[0, 3, :5].any()
    assert not chosen.capped
    assert not chosen.outlier_views.any()

    # 6 % of the corners, no image with more than a quarter: the worst 2 % go.
    many = clean.copy()
    many[:, :, :3] += np.linspace(2, 4, 10)[None, :, None, None]
    chosen = select(many, seen)
    assert chosen.capped
    assert np.count_nonzero(~chosen.kept) == int(0.02 * seen.sum())
    assert not chosen.kept[0, 9, :3].any()

    # A whole image: its view goes, and counts in no share.
    wrong = clean.copy()
    wrong[1, 4] += (1.0, 0.5)
    chosen = select(wrong, seen)
    assert np.flatnonzero(chosen.outlier_views).tolist() == [4]
    assert not chosen.kept[:, 4].any()
    assert not chosen.capped

    # Five times as noisy as the others, yet good to a tenth of a pixel.
    blurred = 0.1 * clean
    blurred[0, 4] *= 5
    assert np.abs(blurred).max() < LEAST_WRONG
    assert select(blurred, seen).kept.all()


def test_half_the_views_cannot_all_be_wrong():
    seen = np.ones((2, 6, 54), bool)
    residuals = np.random.default_rng(0).normal(0, 0.1, (2, 6, 54, 2))
    residuals[0, :3] += 3.0
    assert not select(residuals, seen).outlier_views.any()


SOLVE = """
import sys
from calibration.board import Board
from calibration.heldout import held_out
from calibration.solve import solve_stereo
from tests.calibration_views import distorted_rig, poses_in_view, sightings
board, rig = Board(20, 15, 0.01), distorted_rig()
views = sightings(rig, poses_in_view(rig, 6, 4, board), 0.1, 4, board)
solution = solve_stereo(views, board.points, rig.image_size)
rows = held_out(solution).rows
sys.stdout.buffer.write(solution.covariance.tobytes() + b"".join(r.tobytes() for r in rows))
"""


def test_the_same_bytes_whatever_the_threads():
    digests = set()
    for threads in ("1", "3"):
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads}
        root = Path(__file__).parent.parent
        command = [sys.executable, "-c", SOLVE]
        run = subprocess.run(command, env=environment, cwd=root, capture_output=True, check=True)
        assert len(run.stdout) > 22 * 22 * 8
        digests.add(hashlib.sha256(run.stdout).hexdigest())
    assert len(digests) == 1
