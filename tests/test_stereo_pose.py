"""The pose from points in space and their pixels: recovered within its covariance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from calibration.rig import Mount
from odometry.motion import compose
from stereo.pose import TOGETHER, Offset, Pose, View, find_pose
from stereo.pose_kernels import (
    FIT_ROUNDS,
    LEAST_TRIPLES,
    SURE,
    hypotheses,
    misfits,
    normal_equations,
    relinearised,
    stepped,
)

NOISE = 0.25  # px
LENS = (492.8, 319.5, 239.5, 0.12)
CALIBRATED = Offset(0.0, 1e-8)
STILL = (np.eye(3), np.zeros(3))
LEVEL = Mount(0.3, 0.0, 0.0, 0.0, 0.10, 0.06)
TILTED = Mount(0.5, math.radians(20.0), math.radians(4.0), math.radians(10.0), 0.15, -0.05)


def view(mount: Mount = LEVEL) -> View:
    return View(mount.rotation, mount.position, LENS)


def scene(rng: np.random.Generator, camera: View, n: int = 150) -> np.ndarray:
    """Pixels (n, 3) at the key frame of points 1 to 8 m away, without noise."""
    depth = rng.uniform(1.0, 8.0, n)
    u, v = rng.uniform(20, 620, n), rng.uniform(20, 460, n)
    return np.column_stack([u, v, u - LENS[0] * LENS[3] / depth])


def solid(motion: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """R, t of a motion x m, y m, theta rad in the robot's plane."""
    x, y, theta = motion
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, 0.0])


def trial(
    seed: int,
    motion: tuple[float, float, float],
    mount: Mount = LEVEL,
    noise: float = NOISE,
    outliers: float = 0.0,
    pixels: np.ndarray | None = None,
    offset: float = 0.0,
) -> Pose | None:
    """The pose found from noisy pixels at the key frame and now, from a guess of no motion.

    pixels: (n, 3) at the key frame, without noise; offset: of all disparities [px], unknown.
    """
    rng = np.random.default_rng(seed)
    camera = view(mount)
    true = scene(rng, camera) if pixels is None else pixels
    true = true - (0.0, 0.0, offset)
    now = camera.predict(true, *solid(motion), offset)[:, :3]
    now += noise * rng.standard_normal(true.shape)
    wrong = rng.random(len(true)) < outliers
    now[wrong] = scene(rng, camera, len(true))[wrong]
    true = true + noise * rng.standard_normal(true.shape)
    inside = (now[:, :2] > 0).all(axis=1) & (now[:, 0] < 640) & (now[:, 1] < 480)
    unknown = rng.random(len(true)) < 0.2
    now[unknown, 2] = np.nan
    keys, now, sigma = true[inside], now[inside], np.full(int(inside.sum()), NOISE)
    known = Offset() if offset else CALIBRATED
    return find_pose(keys, now, sigma, camera, STILL, (seed,), offset=known)


def nees(pose: Pose, motion: tuple[float, float, float]) -> float:
    error = pose.planar - motion
    return float(error @ np.linalg.solve(pose.covariance, error))


@pytest.mark.parametrize(
    "motion", [(0.12, 0.01, 0.05), (0.0, 0.0, 0.15), (0.0, 0.0, 0.0)], ids=["arc", "turn", "still"]
)
@pytest.mark.parametrize("outliers", [0.0, 0.4])
def test_motion_is_found_within_its_covariance(motion, outliers):
    found = [trial(seed, motion, outliers=outliers) for seed in range(60)]
    poses = [pose for pose in found if pose is not None]
    assert len(poses) == 60
    # Errors here are independent from point to point: the covariance allows for more than that.
    mean = TOGETHER * np.mean([nees(pose, motion) for pose in poses])
    assert 2.0 < mean < 4.5
    assert np.mean([pose.noise for pose in poses]) == pytest.approx(NOISE, rel=0.25)
    errors = np.array([pose.planar - motion for pose in poses])
    assert np.abs(errors.mean(axis=0)).max() < 1e-3


def far_points(rng: np.random.Generator, n: int = 200) -> np.ndarray:
    """Pixels (n, 3) at the key frame, without noise, of points 12 to 120 m away."""
    u, v, d = rng.uniform(20, 620, n), rng.uniform(20, 460, n), rng.uniform(0.5, 5.0, n)
    return np.column_stack([u, v, u - d])


def test_far_points_do_not_lengthen_the_way():
    """Depth is not linear in disparity, yet the mean of many draws is the true length."""
    lengths = []
    for seed in range(80):
        pixels = far_points(np.random.default_rng(1000 + seed))
        pose = trial(seed, (1.0, 0.0, 0.02), noise=0.4, pixels=pixels)
        assert pose is not None
        lengths.append(pose.planar[0])
    uncertainty = np.std(lengths) / np.sqrt(len(lengths))
    assert uncertainty < 0.002
    assert abs(np.mean(lengths) - 1.0) < 2.5 * uncertainty


def test_the_offset_of_all_disparities_is_found():
    """One that a calibration leaves makes the way longer or shorter, unless it is estimated."""
    poses = [
        trial(seed, (1.0, 0.0, 0.02), pixels=far_points(np.random.default_rng(seed)), offset=-0.2)
        for seed in range(40)
    ]
    assert all(pose is not None for pose in poses)
    offsets = [pose.offset.value for pose in poses if pose]
    # The prior pulls a single one towards zero.
    assert -0.25 < np.mean(offsets) < -0.17
    assert np.mean([pose.planar[0] for pose in poses if pose]) == pytest.approx(1.0, abs=0.01)
    assert all(pose.offset.variance < 0.5 * Offset().variance for pose in poses if pose)


def test_false_matches_are_left_out():
    pose = trial(7, (0.1, 0.0, 0.1), outliers=0.4)
    assert pose is not None
    assert 0.4 < pose.inliers.mean() < 0.75


@pytest.mark.parametrize("mount", [LEVEL, TILTED], ids=["level", "tilted"])
def test_a_tilted_camera_tells_the_robots_own_motion(mount):
    motion = (0.15, 0.0, 0.12)
    pose = trial(3, motion, mount, noise=0.0)
    assert pose is not None
    assert pose.planar == pytest.approx(motion, abs=1e-6)
    assert pose.t[2] == pytest.approx(0.0, abs=1e-6)


def test_more_noise_is_more_doubt():
    calm, noisy = (trial(5, (0.1, 0.0, 0.0), noise=noise) for noise in (0.1, 0.6))
    assert calm is not None
    assert noisy is not None
    assert np.trace(noisy.covariance) > 4.0 * np.trace(calm.covariance)
    for pose in (calm, noisy):
        rest = np.linalg.eigvalsh(pose.covariance - pose.of_pixels)
        assert rest.min() > -1e-12


@pytest.mark.parametrize("count", [0, 3, 5])
def test_too_few_points_are_no_pose(count):
    camera = view()
    pixels = scene(np.random.default_rng(1), camera, count)
    assert find_pose(pixels, pixels, np.ones(count), camera, STILL, (1,)) is None


def test_points_that_agree_on_nothing_are_no_certain_pose():
    rng = np.random.default_rng(2)
    camera = view()
    keys, now = scene(rng, camera), scene(rng, camera)
    pose = find_pose(keys, now, np.full(len(keys), NOISE), camera, STILL, (1,))
    assert pose is None or pose.inliers.mean() < 0.2


def test_residuals_and_their_derivatives_are_those_of_the_projection():
    """The kernels against plain numpy: projection, and differences of it."""
    rng = np.random.default_rng(4)
    camera = view(TILTED)
    keys = scene(rng, camera, 12)
    keys[5, 2] = keys[5, 0]  # at infinity
    at = keys + 0.3 * rng.standard_normal(keys.shape)
    R, t = stepped(*solid((0.1, 0.02, 0.2)), np.array([0.0, 0.0, 0.01, 0.02, -0.01, 0.0]))
    now = camera.predict(keys, R, t)[:, :3] + rng.standard_normal((12, 3))
    now[::3, 2] = np.nan
    place = (camera.rotation, camera.position, (*LENS, 0.1))

    def predicted(k: np.ndarray, step: np.ndarray) -> np.ndarray:
        seen = camera.predict(k, *stepped(R, t, step[:6]), 0.1 + step[6])[:, :3]
        return np.where(np.isnan(now), 0.0, seen)

    def slopes(of, axes: np.ndarray) -> np.ndarray:
        h = 1e-5
        return np.stack([(of(h * e) - of(-h * e)) / (2 * h) for e in axes], axis=-1)

    J = slopes(lambda step: predicted(at, step), np.eye(7))
    D = slopes(lambda shift: predicted(at + shift, np.zeros(7)), np.eye(3))
    r = predicted(at, np.zeros(7)) - np.nan_to_num(now) + np.einsum("nij,nj->ni", D, keys - at)
    S = np.linalg.inv(np.eye(3) + D @ D.transpose(0, 2, 1))
    arguments = (keys, at, now)
    squared = np.einsum("ni,nij,nj->n", r, S, r)
    assert np.allclose(misfits(*arguments, R, t, *place), squared, rtol=1e-5)
    agree = np.arange(12) != 3
    best = keys - agree[:, None] * np.einsum("nji,njk,nk->ni", D, S, r)
    assert np.allclose(relinearised(*arguments, agree, R, t, *place), best, atol=1e-5)
    sigma, weights = rng.uniform(0.1, 0.5, 12), rng.uniform(0.1, 1.0, 12)
    H, b, H2 = normal_equations(*arguments, sigma, weights, R, t, *place)
    w = weights / sigma**2
    assert np.allclose(H, np.einsum("n,nik,nij,njl->kl", w, J, S, J), rtol=1e-4, atol=1e-3)
    assert np.allclose(b, np.einsum("n,nik,nij,nj->k", w, J, S, r), rtol=1e-4, atol=1e-3)
    assert np.allclose(
        H2, np.einsum("n,nik,nij,njl->kl", w * weights, J, S @ S, J), rtol=1e-4, atol=1e-3
    )


def best_of(keys, pixels, triples, R, t, place, prior, gate, head_start):
    """`hypotheses` in plain numpy, over the kernels tested above."""

    def scored(R1, t1):
        squared = misfits(keys, keys, pixels, R1, t1, *place)
        return np.maximum(gate - squared, 0.0).sum(), np.mean(squared < gate)

    best, best_pose, needed = head_start * scored(R, t)[0], (R, t), len(triples)
    for k, three in enumerate(triples):
        if k >= needed:
            break
        if len(set(three.tolist())) < 3:
            continue
        R1, t1 = R, t
        for _ in range(FIT_ROUNDS):
            points = (keys[three], keys[three], pixels[three])
            H, b, _ = normal_equations(*points, np.ones(3), np.ones(3), R1, t1, *place)
            H, b = H[:6, :6], b[:6]
            b += prior * (0.0, 0.0, t1[2], R1[2, 1], -R1[2, 0], 0.0)
            step = -np.linalg.solve(H + np.diag(prior + 1e-9), b)
            R1, t1 = stepped(R1, t1, step)
            if np.linalg.norm(step) < 1e-3:
                break
        score, share = scored(R1, t1)
        if score > best:
            best, best_pose = score, (R1, t1)
            if share < 1.0:
                needed = min(needed, LEAST_TRIPLES + int(np.log(SURE) / np.log(1 - share**3)))
    return best_pose


@pytest.mark.parametrize("head_start", [1.0, 20.0])
def test_the_best_of_many_hypotheses_is_found(head_start):
    rng = np.random.default_rng(6)
    camera = view(TILTED)
    true = scene(rng, camera)
    motion = solid((0.1, 0.02, 0.1))
    pixels = camera.predict(true, *motion)[:, :3] + 0.2 * rng.standard_normal(true.shape)
    pixels[:60] = scene(rng, camera)[:60]
    triples = rng.integers(len(true), size=(40, 3))
    place = (camera.rotation, camera.position, (*camera.lens, 0.0))
    prior = np.array([0.0, 0.0, 9.0, 30.0, 30.0, 0.0])
    guess = solid((0.1, 0.018, 0.099))
    arguments = (true, pixels, triples, *guess)
    R, t = hypotheses(*arguments, *place, prior, 9.0, head_start)
    R2, t2 = best_of(*arguments, place, prior, 9.0, head_start)
    assert np.allclose(R, R2, atol=1e-9)
    assert np.allclose(t, t2, atol=1e-9)
    assert (head_start > 1.0) == np.array_equal(R, guess[0])


def test_steps_turn_from_the_right():
    R, t = solid((1.0, 2.0, 0.3))
    R2, t2 = stepped(R, t, np.array([0.1, 0.2, 0.0, 0.0, 0.0, 0.4]))
    turned = compose(np.array([0.0, 0.0, 0.3]), np.array([0.0, 0.0, 0.4]))
    assert math.atan2(R2[1, 0], R2[0, 0]) == pytest.approx(turned[2])
    assert t2 == pytest.approx([1.1, 2.2, 0.0])
