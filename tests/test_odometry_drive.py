"""Differential drive: arcs against fine integration, covariance against Monte Carlo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from odometry.differential_drive import GAP_FACTOR, drive, step_variances
from odometry.motion import Motion, compose
from odometry.settings import OdometrySettings

TRACK = 0.3
NO_TICK = np.zeros(2)
wheel_path = st.floats(-0.5, 0.5)


def integrate_finely(left: float, right: float, pieces: int = 4000) -> np.ndarray:
    """Midpoint rule in tiny straight steps: error of second order in the step."""
    turn = (right - left) / TRACK / pieces
    headings = (np.arange(pieces) + 0.5) * turn
    step = 0.5 * (left + right) / pieces
    return np.array([step * np.cos(headings).sum(), step * np.sin(headings).sum(), turn * pieces])


@given(wheel_path, wheel_path)
def test_an_arc_equals_fine_integration(left, right):
    increment, _ = drive(np.array([[left, right]]), TRACK, NO_TICK, OdometrySettings())
    truth = integrate_finely(left, right)
    assert increment[:2] == pytest.approx(truth[:2], abs=1e-6)
    assert math.cos(increment[2] - truth[2]) == pytest.approx(1.0, abs=1e-12)


@given(st.floats(-1e-9, 1e-9))
def test_nearly_straight_is_straight(difference):
    paths = np.array([[1.0, 1.0 + difference]])
    increment, covariance = drive(paths, TRACK, NO_TICK, OdometrySettings())
    assert increment == pytest.approx([1.0, 0.0, 0.0], abs=1e-8)
    assert np.isfinite(covariance).all()


@given(st.lists(st.tuples(wheel_path, wheel_path), min_size=1, max_size=6))
def test_many_arcs_equal_single_motions_joined(paths):
    settings = OdometrySettings()
    joined = Motion.none(0)
    for pair in paths:
        joined = joined.then(Motion(*drive(np.array([pair]), TRACK, NO_TICK, settings)))
    increment, covariance = drive(np.array(paths), TRACK, NO_TICK, settings)
    assert increment[:2] == pytest.approx(joined.increment[:2], abs=1e-9)
    assert math.cos(increment[2] - joined.increment[2]) == pytest.approx(1.0, abs=1e-12)
    assert covariance == pytest.approx(joined.covariance, abs=1e-12)


def test_covariance_equals_monte_carlo():
    settings = OdometrySettings(along=0.02, across=0.01, heading=1.0, turn=1.0)
    # A left bend, a right bend and some straight driving: 40 arcs, 1.2 m.
    turn_paths = [(0.027, 0.033)] * 15 + [(0.032, 0.028)] * 15 + [(0.03, 0.03)] * 10
    paths = np.array(turn_paths)
    _, covariance = drive(paths, TRACK, NO_TICK, settings)

    rng = np.random.default_rng(3)
    samples = 20_000
    travel, turn = paths.mean(axis=1), (paths[:, 1] - paths[:, 0]) / TRACK
    sigma = np.sqrt(step_variances(travel, turn, settings))
    poses = np.zeros((samples, 3))
    for k in range(len(paths)):
        along, across, heading = (rng.standard_normal((samples, 3)) * sigma[k]).T
        middle = poses[:, 2] + 0.5 * (turn[k] + heading)
        c, s = np.cos(middle), np.sin(middle)
        poses[:, 0] += c * (travel[k] + along) - s * across
        poses[:, 1] += s * (travel[k] + along) + c * across
        poses[:, 2] += turn[k] + heading
    sampled = np.cov(poses.T)
    # Four standard errors of a sampled covariance of Gaussian numbers.
    spread = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)) + sampled**2)
    assert (np.abs(covariance - sampled) < 4.0 * spread / math.sqrt(samples)).all()


def test_settings_are_the_doubt_after_one_metre():
    settings = OdometrySettings(along=0.03, across=0.01, heading=1.0, turn=0.0)
    _, covariance = drive(np.full((50, 2), 0.02), TRACK, NO_TICK, settings)
    assert math.sqrt(covariance[0, 0]) == pytest.approx(0.03)
    assert math.degrees(math.sqrt(covariance[2, 2])) == pytest.approx(1.0)
    # Side slip, and the heading's random walk over 1 m: variance x 1/3.
    expected = 0.01**2 + math.radians(1.0) ** 2 / 3.0
    assert covariance[1, 1] == pytest.approx(expected, rel=1e-3)


def test_turning_on_the_spot_is_doubted_in_all_directions():
    _, covariance = drive(np.array([[-0.1, 0.1]]), TRACK, NO_TICK, OdometrySettings())
    assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_rounding_of_counts_is_charged_once_and_only_to_wheels_that_moved():
    exact = OdometrySettings(along=0.0, across=0.0, heading=0.0, turn=0.0)
    tick = np.array([0.003, 0.003])
    _, one = drive(np.full((1, 2), 0.5), TRACK, tick, exact)
    _, many = drive(np.full((10, 2), 0.05), TRACK, tick, exact)
    assert many == pytest.approx(one)
    assert one[0, 0] == pytest.approx(0.003**2 / 12.0)
    assert one[2, 2] == pytest.approx(2.0 * 0.003**2 / 6.0 / TRACK**2)
    _, resting = drive(np.zeros((3, 2)), TRACK, tick, OdometrySettings())
    assert not resting.any()


def test_a_gap_is_doubted_more():
    paths, settings = np.array([[0.3, 0.4]]), OdometrySettings()
    _, usual = drive(paths, TRACK, NO_TICK, settings, np.array([False]))
    _, gap = drive(paths, TRACK, NO_TICK, settings, np.array([True]))
    assert np.linalg.eigvalsh(gap - GAP_FACTOR**2 * usual).min() > -1e-15
    # Turning first and driving later, or the other way, is covered.
    travel, turn = 0.35, 0.1 / TRACK
    first = compose(np.array([0, 0, turn]), np.array([travel, 0, 0]))
    later = compose(np.array([travel, 0, 0]), np.array([0, 0, turn]))
    difference = (first - later)[:2]
    assert difference @ np.linalg.inv(gap[:2, :2]) @ difference < 2.0**2
