"""The pose that weighted particles give: the mean of their heaviest mode."""

import math

import numpy as np

from mapping.pose_estimate import estimate_pose


def around(centre, sigma, count, seed):
    return np.asarray(centre) + sigma * np.random.default_rng(seed).standard_normal((count, 3))


def test_the_mean_is_far_better_than_a_particle_and_its_covariance_that_of_the_particles():
    sigma = np.array([0.05, 0.02, 0.01])
    true = np.array([3.0, -2.0, math.pi - 0.001])  # headings wrap within the cloud
    particles = around(true, sigma, 400, 1)
    particles[:, 2] = (particles[:, 2] + math.pi) % (2 * math.pi) - math.pi
    pose = estimate_pose(particles, np.zeros(400), stamp=7)
    off = pose.increment - true
    off[2] = (off[2] + math.pi) % (2 * math.pi) - math.pi
    assert np.all(np.abs(off) < 4 * sigma / 20)
    np.testing.assert_allclose(np.sqrt(np.diag(pose.covariance)), sigma, rtol=0.15)
    assert pose.last == 7


def test_two_hypotheses_are_not_averaged():
    light, heavy = around([0, 0, 0], 0.02, 200, 1), around([3.0, 0, 0], 0.02, 100, 2)
    log_weights = np.concatenate([np.zeros(200), np.full(100, 2.0)])
    pose = estimate_pose(np.concatenate([light, heavy]), log_weights, 0)
    np.testing.assert_allclose(pose.increment, [3.0, 0, 0], atol=0.01)
    assert np.sqrt(pose.covariance[0, 0]) < 0.03


def test_headings_apart_are_modes_too():
    there, back = around([1.0, 1.0, 0.0], 0.01, 150, 3), around([1.0, 1.0, math.pi], 0.01, 100, 4)
    pose = estimate_pose(np.concatenate([there, back]), np.zeros(250), 0)
    np.testing.assert_allclose(pose.increment, [1.0, 1.0, 0.0], atol=0.01)
