"""Two odometries: weighed by their covariances, and found out when they disagree."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from odometry.fusion import GATE, Agreement, disagreement, fuse, without
from odometry.motion import Motion, compose, wrap_angle

TENTH = 100_000_000  # ns
SIGMA = np.array([0.004, 0.002, 0.004])

poses = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3)).map(np.array)


def covariance(seed: int, size: float = 1.0) -> np.ndarray:
    A = np.random.default_rng(seed).standard_normal((3, 3)) * SIGMA * size
    return A.T @ A


def motion(increment, cov, step: int = 0) -> Motion:
    return Motion(np.asarray(increment, float), cov, step * TENTH, (step + 1) * TENTH)


def test_information_adds_up():
    a = motion([0.10, 0.0, 0.02], covariance(1))
    b = motion([0.12, 0.01, 0.01], covariance(2))
    both = fuse(a, b)
    Wa, Wb = np.linalg.inv(a.covariance), np.linalg.inv(b.covariance)
    assert np.allclose(both.covariance, np.linalg.inv(Wa + Wb))
    mean = both.covariance @ (Wa @ a.increment + Wb @ b.increment)
    assert both.increment == pytest.approx(mean)
    assert (both.first, both.last) == (a.first, a.last)


def test_headings_are_fused_the_shorter_way_round():
    a, b = motion([0, 0, 3.13], covariance(1)), motion([0, 0, -3.13], covariance(1))
    assert abs(fuse(a, b).increment[2]) > 3.1


def test_what_is_known_exactly_stays():
    exact, doubtful = motion([0, 0, 0], np.zeros((3, 3))), motion([0.01, 0, 0], covariance(3))
    for both in (fuse(exact, doubtful), fuse(doubtful, exact)):
        assert both.increment == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
        assert np.allclose(both.covariance, 0.0, atol=1e-15)
    assert fuse(exact, exact) is exact


def test_fused_motion_is_as_doubtful_as_it_errs():
    rng = np.random.default_rng(5)
    Sa, Sb, true = covariance(6), covariance(7, 0.5), np.array([0.1, 0.0, 0.05])
    squared = []
    for _ in range(2000):
        a, b = (motion(rng.multivariate_normal(true, S), S) for S in (Sa, Sb))
        both = fuse(a, b)
        error = both.increment - true
        squared.append(error @ np.linalg.solve(both.covariance, error))
    assert np.mean(squared) == pytest.approx(3.0, abs=0.2)


@given(poses, poses)
def test_the_rest_of_a_motion(begun, rest):
    whole = compose(begun, rest)
    found = without(motion(whole, covariance(1)), Motion(begun, covariance(2), 0, 1))
    assert found.increment[:2] == pytest.approx(rest[:2], abs=1e-9)
    assert wrap_angle(found.increment[2] - rest[2]) == pytest.approx(0.0, abs=1e-9)


def test_the_rest_errs_with_both():
    rng = np.random.default_rng(8)
    begun, rest = np.array([0.5, 0.1, 0.6]), np.array([0.3, -0.2, -0.9])
    whole = compose(begun, rest)
    Sa, Sb = covariance(1), covariance(2)
    found = without(motion(whole, Sa), Motion(begun, Sb, 0, 1))
    samples = [
        without(
            motion(rng.multivariate_normal(whole, Sa), Sa),
            Motion(rng.multivariate_normal(begun, Sb), Sb),
        ).increment
        for _ in range(4000)
    ]
    sigma = np.sqrt(np.diag(found.covariance))
    scaled = (np.cov(np.array(samples).T) - found.covariance) / np.outer(sigma, sigma)
    assert np.abs(scaled).max() < 0.1


def pairs_of(slip: np.ndarray, steps: int = 40, seed: int = 3):
    """Wheels and images over the steps; the wheels report `slip` too much in each from 20 on."""
    rng = np.random.default_rng(seed)
    true = np.array([0.03, 0.0, 0.02])
    wheels, images = np.diag(SIGMA**2), np.diag((0.2 * SIGMA) ** 2)
    for step in range(steps):
        added = slip if step >= 20 else 0.0
        yield (
            motion(rng.multivariate_normal(true, wheels) + added, wheels, step),
            motion(rng.multivariate_normal(true, images), images, step),
        )


def test_noise_alone_is_no_disagreement():
    for seed in range(20):
        agreement = Agreement()
        assert all(agreement.step(a, b) is None for a, b in pairs_of(np.zeros(3), seed=seed))


@pytest.mark.parametrize("slip", [[0.05, 0, 0], [0, 0, 0.05]], ids=["spun", "turned"])
def test_a_slip_is_seen_at_once(slip):
    agreement = Agreement()
    told = [agreement.step(a, b) for a, b in pairs_of(np.array(slip))]
    assert told[:20] == [None] * 20
    assert told[20] is not None
    wheels, images = told[20]
    assert (wheels.first, wheels.last) == (20 * TENTH, 21 * TENTH)
    assert wheels.increment - images.increment == pytest.approx(slip, abs=0.02)


def test_a_slip_too_small_for_one_step_is_seen_within_a_second():
    slip = np.array([0.01, 0.0, 0.0])
    agreement, single = Agreement(), []
    told = []
    for a, b in pairs_of(slip):
        told.append(agreement.step(a, b))
        single.append(disagreement(a, b) < GATE)
    assert told[:20] == [None] * 20
    (wheels, _), *_ = (apart for apart in told[20:30] if apart is not None)
    assert wheels.last - wheels.first > 2 * TENTH
    assert np.mean(single[20:]) > 0.7
