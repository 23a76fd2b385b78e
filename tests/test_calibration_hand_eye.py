"""Planar hand-eye: the camera's place on the robot from steps of both."""

from __future__ import annotations

import math

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.hand_eye import HandEye, solve_hand_eye
from odometry.motion import compose, inverse

TRUE = np.array([0.12, -0.05, math.radians(20.0)])
NOISE = (0.006, 0.002)  # of the wheels, along and across [m]
SEEN = (0.002, 0.002, 0.002)  # of the camera [m, m, rad]


def steps(seed: int, count: int = 80, most_turn: float = 0.25, scale: float = 1.0):
    """Increments of wheels and camera, and the covariances of their translations."""
    chance = np.random.default_rng(seed)
    robot = np.zeros((count, 3))
    turns = chance.uniform(-most_turn, most_turn, count)
    robot[:, 2] = turns
    along = chance.uniform(0.05, 0.2, count)
    robot[:, 0], robot[:, 1] = along * np.cos(turns / 2), along * np.sin(turns / 2)
    camera = compose(compose(inverse(TRUE), robot), TRUE)
    wheels = robot.copy()
    wheels[:, :2] = wheels[:, :2] / scale + chance.normal(size=(count, 2)) * NOISE
    camera = camera + chance.normal(size=(count, 3)) * SEEN
    covariance = np.diag(np.square(NOISE) + np.square(SEEN[:2]))
    return wheels, camera, np.repeat(covariance[None], count, axis=0)


def errors(found: HandEye) -> np.ndarray:
    return np.array([found.x, found.y, found.yaw]) - TRUE


def test_the_place_is_recovered_and_its_sigma_is_honest():
    found = [solve_hand_eye(*steps(seed), (0.0, 0.0, 0.0)) for seed in range(60)]
    pulls = np.array([errors(f) / f.sigma for f in found])
    assert (pulls.std(axis=0) > 0.75).all()
    assert (pulls.std(axis=0) < 1.35).all()
    assert (abs(pulls.mean(axis=0)) < 0.5).all()
    assert max(abs(errors(f)[:2]).max() for f in found) < 0.02
    assert math.degrees(max(abs(errors(f)[2]) for f in found)) < 1.0


def test_slips_and_false_motions_are_left_out():
    wheels, camera, covariances = steps(3)
    chance = np.random.default_rng(9)
    wrong = chance.permutation(80)[:12]
    camera[wrong, :2] += chance.uniform(-0.3, 0.3, (12, 2))
    found = solve_hand_eye(wheels, camera, covariances, (0.0, 0.0, 0.0))
    assert (abs(errors(found)) < 4.0 * found.sigma).all()
    assert abs(errors(found)[:2]).max() < 0.015
    assert found.steps <= 72


def test_wrong_wheels_show_in_the_scale_and_not_in_the_place():
    found = solve_hand_eye(*steps(4, scale=1.03), (0.0, 0.0, 0.0))
    assert found.scale == pytest.approx(1.03, abs=4.0 * found.scale_sigma)
    assert found.scale_sigma < 0.01
    assert (abs(errors(found)) < 4.0 * found.sigma).all()


def test_without_turning_yaw_is_told_and_the_place_is_not():
    found = solve_hand_eye(*steps(5, most_turn=1e-4), (0.3, 0.2, 0.0))
    assert abs(errors(found)[2]) < 4.0 * found.sigma[2]
    assert found.sigma[2] < math.radians(1.0)
    assert found.sigma[:2].min() > 0.1


def test_a_camera_that_looks_back_is_no_trouble():
    wheels, camera, covariances = steps(6)
    back = np.array([0.0, 0.0, math.pi])
    reversed_camera = compose(compose(inverse(back), camera), back)
    found = solve_hand_eye(wheels, reversed_camera, covariances, (0.0, 0.0, 0.0))
    assert math.degrees(found.yaw) == pytest.approx(20.0 - 180.0, abs=1.0)


def test_few_steps_are_refused():
    with pytest.raises(CalibrationError, match="only 5 steps"):
        solve_hand_eye(*steps(0, count=5), (0.0, 0.0, 0.0))
