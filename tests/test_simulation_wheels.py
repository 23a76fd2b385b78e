"""Wheel ticks: exact without noise, wrapping, and as wrong as asked with it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from odometry.differential_drive import chord
from odometry.encoders import EncoderParameters, unwrap_counts
from odometry.motion import compose, inverse
from simulation.drive import TICK_PERIOD, drive
from simulation.route import Route
from simulation.scene import load_scene
from simulation.wheels import MINIBEE_ENCODERS, WheelNoise, wheel_ticks

PERFECT = WheelNoise(along=0.0, turn=0.0, right_error=0.0)


def dead_reckoning(ticks: np.ndarray, encoders: EncoderParameters) -> np.ndarray:
    """Poses (n, 3) from the first reading on by the nominal constants, exact arcs."""
    counts = np.stack([unwrap_counts(side, encoders.counter_bits) for side in ticks.T], axis=1)
    left, right = (np.diff(counts, axis=0) * encoders.metres_per_tick).T
    turn = (right - left) / encoders.track
    heading = np.concatenate([[0.0], np.cumsum(turn)])
    middle = heading[:-1] + 0.5 * turn
    steps = chord(0.5 * (left + right), turn)[:, None] * np.stack(
        [np.cos(middle), np.sin(middle)], axis=1
    )
    return np.column_stack([np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), heading])


def ate(estimate: np.ndarray, truth: np.ndarray) -> float:
    """RMSE of positions (n, 2) after the best rotation and shift (Umeyama 1991, no scale)."""
    a, b = estimate - estimate.mean(axis=0), truth - truth.mean(axis=0)
    angle = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    c, s = math.cos(angle), math.sin(angle)
    return float(np.sqrt(((a @ np.array([[c, s], [-s, c]]) - b) ** 2).sum(axis=1).mean()))


def office_poses() -> np.ndarray:
    route = load_scene("office").route
    return route.poses(np.arange(0.0, route.duration, TICK_PERIOD / 1e9))


def test_perfect_wheels_integrate_to_the_truth():
    poses = office_poses()
    ticks = wheel_ticks(poses, MINIBEE_ENCODERS, PERFECT, seed=1)
    relative = compose(inverse(poses[0]), poses)
    np.testing.assert_allclose(
        dead_reckoning(ticks, MINIBEE_ENCODERS)[:, :2], relative[:, :2], atol=0.01
    )


def test_counters_wrap():
    ticks = wheel_ticks(office_poses(), MINIBEE_ENCODERS, PERFECT, seed=1)
    assert ticks.min() >= 0
    assert ticks.max() < 1 << 16
    assert (np.diff(ticks, axis=0) < -60000).sum(axis=0).min() >= 3
    wide = wheel_ticks(office_poses(), replace(MINIBEE_ENCODERS, counter_bits=32), PERFECT, seed=1)
    assert (wide % (1 << 16) == ticks).all()


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
def test_dead_reckoning_of_the_office_is_off_by_40_cm(seed):
    poses = office_poses()
    ticks = wheel_ticks(poses, MINIBEE_ENCODERS, WheelNoise(), seed)
    assert ate(dead_reckoning(ticks, MINIBEE_ENCODERS)[:, :2], poses[:, :2]) >= 0.4


def test_noise_has_the_size_asked_for():
    noise = WheelNoise(along=0.010, turn=math.radians(0.3), step=0.2, right_error=0.0)
    poses = np.zeros((21, 3))
    poses[:, 0] = np.linspace(0.0, 0.2, 21)
    fine = replace(MINIBEE_ENCODERS, ticks_per_revolution=1e6, counter_bits=32)
    ends = np.array(
        [dead_reckoning(wheel_ticks(poses, fine, noise, seed), fine)[-1] for seed in range(400)]
    )
    assert ends[:, 0].mean() == pytest.approx(0.2, abs=0.002)
    assert ends[:, 0].std() == pytest.approx(0.010, rel=0.15)
    assert ends[:, 2].std() == pytest.approx(math.radians(0.3), rel=0.15)


def test_a_larger_right_wheel_makes_a_straight_line_bend_to_the_right():
    poses = np.zeros((101, 3))
    poses[:, 0] = np.linspace(0.0, 10.0, 101)
    noise = WheelNoise(along=0.0, turn=0.0, right_error=0.002)
    end = dead_reckoning(wheel_ticks(poses, MINIBEE_ENCODERS, noise, 1), MINIBEE_ENCODERS)[-1]
    assert end[2] == pytest.approx(-0.002 * 10.0 / 0.30, rel=0.02)


def test_same_seed_same_ticks():
    poses = office_poses()[:400]
    first, again, other = (
        wheel_ticks(poses, MINIBEE_ENCODERS, WheelNoise(), seed) for seed in (1, 1, 2)
    )
    assert (first == again).all()
    assert (first != other).any()


def test_a_shorter_drive_is_the_beginning_of_a_longer_one():
    poses = office_poses()
    whole = wheel_ticks(poses, MINIBEE_ENCODERS, WheelNoise(), 1)
    assert (wheel_ticks(poses[:500], MINIBEE_ENCODERS, WheelNoise(), 1) == whole[:500]).all()


def test_a_drives_ticks_span_its_pairs_and_its_truth_begins_at_the_origin():
    route = Route.through(np.array([[1.0, 2.0], [1.0, 9.0]]), 0.5, 0.34, 0.5)
    trip = drive(route, MINIBEE_ENCODERS, WheelNoise(), 1, duration=10.0)
    assert len(trip.stamps) == 21
    assert trip.distance == pytest.approx(3.4, abs=0.01)
    assert trip.tick_stamps[0] < trip.stamps[0]
    assert trip.tick_stamps[-1] > trip.stamps[-1]
    assert not np.isin(trip.stamps, trip.tick_stamps).any()
    np.testing.assert_allclose(trip.truth[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(trip.velocities[5], (0.34, 0.0), atol=1e-6)
