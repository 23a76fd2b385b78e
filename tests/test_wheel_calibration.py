"""Wheels, camera place and time offset found from simulated drives, tape and squares."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.wheel_calibration import OFFSET_S, doubt, errors, simulated
from odometry.errors import OdometryError
from odometry.settings import OdometrySettings
from odometry.time_offset import time_offset
from odometry.umbmark import square_end, umbmark
from odometry.wheel_calibration import Stretches, calibrate_wheels, closed_form
from simulation.wheels import WheelNoise

CAREFUL = WheelNoise(0.002, math.radians(0.1), 0.2, 0.0)
# 99.7 % of a normal variable, and a little for doing it several times.
SIGMAS = 3.5


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_wheels_wrong_by_per_cents_are_found_within_their_doubt(seed):
    found = simulated(10.0, seed, CAREFUL)
    error, sigma = errors(found), doubt(found)
    assert np.abs(error[:2]).max() < 0.002
    assert abs(error[2]) < 0.005
    assert np.abs(error[3:5]).max() < 0.006
    assert (np.abs(error) < SIGMAS * sigma).all()
    assert found.offset is not None
    assert found.offset.clear
    assert found.parameters.time_offset == pytest.approx(OFFSET_S, abs=0.004)
    assert found.parameters.track == found.found.values[2]
    assert found.position is not None
    assert found.yaw is not None


def test_a_short_drive_keeps_what_it_does_not_tell():
    found = simulated(1.0, 1, WheelNoise(0.05, math.radians(2.0), 0.2, 0.0))
    assert found.parameters.left_radius == 0.075
    assert any("the radii stay" in note for note in found.notes)
    assert (np.abs(errors(found)[:3]) < SIGMAS * doubt(found)[:3]).all()


def stretches(seed: int = 1, k: int = 60) -> Stretches:
    """Exact ones of a robot with the nominal wheels and a sensor at (0.2, -0.1, 0.3)."""
    rng = np.random.default_rng(seed)
    travel, turn = rng.uniform(0.3, 1.0, k), rng.uniform(-1.5, 1.5, k)
    wheels = np.stack([travel - 0.15 * turn, travel + 0.15 * turn], axis=1)[:, None] / 4
    place = np.array([0.2, -0.1, 0.3])
    from odometry.motion import compose, inverse

    chord = travel * np.sinc(turn / (2 * math.pi))
    robot = np.stack([chord * np.cos(turn / 2), chord * np.sin(turn / 2), turn], axis=1)
    sensor = compose(inverse(place), compose(robot, place))
    return Stretches(
        np.repeat(wheels, 4, axis=1), sensor, np.tile(np.diag([1e-6, 1e-6, 1e-6]), (k, 1, 1))
    )


def test_the_closed_form_is_exact_without_noise():
    found = closed_form(stretches(), 0.3)
    assert found == pytest.approx([1.0, 1.0, 0.3, 0.2, -0.1, 0.3], abs=1e-5)


def test_slipping_stretches_are_left_out():
    exact = stretches()
    sensor = exact.sensor.copy()
    sensor[::10] += [0.3, -0.2, 0.4]
    found = calibrate_wheels(replace(exact, sensor=sensor), 0.3, OdometrySettings())
    assert found.values == pytest.approx([1.0, 1.0, 0.3, 0.2, -0.1, 0.3], abs=1e-3)
    assert found.used == 54


def test_too_little_turning_is_an_error():
    exact = stretches()
    straight = exact.sensor * [1.0, 1.0, 0.0]
    with pytest.raises(OdometryError, match="60 stretches with 0 deg of turning"):
        calibrate_wheels(replace(exact, sensor=straight), 0.3, OdometrySettings())


def test_the_offset_needs_turns_that_change():
    stamps = np.arange(0, 60_000_000_000, 20_000_000)
    rng = np.random.default_rng(3)
    spans = np.stack([np.arange(2, 50), np.arange(2, 50) + 1], axis=1) * 1_000_000_000
    for rate, clear in ((np.sin(stamps / 1.1e9), True), (np.full(len(stamps), 0.4), False)):
        heading = np.cumsum(rate) * 0.02
        turns = np.diff(np.interp(spans - 0.12e9, stamps, heading), axis=1)[:, 0]
        found = time_offset(stamps, heading, spans, turns + 0.002 * rng.standard_normal(48))
        assert found is not None
        assert found.clear is clear
        if clear:
            assert found.seconds == pytest.approx(0.12, abs=max(4 * found.sigma, 0.002))
    assert time_offset(stamps, heading, spans[:5], turns[:5]) is None


@pytest.mark.parametrize(("E_d", "E_b"), [(1.004, 1.02), (0.98, 0.95), (1.02, 1.05)])
def test_umbmark_finds_large_errors_that_first_order_formulas_miss(E_d, E_b):
    rng = np.random.default_rng(4)
    cw, ccw = (
        square_end(E_d, E_b, 4.0, 0.3, way)[:2] + rng.normal(0.0, 0.01, (5, 2)) for way in (-1, 1)
    )
    found = umbmark(cw, ccw, 4.0, 0.3)
    assert abs(found.E_d - E_d) < 4 * found.sigma[0]
    assert abs(found.E_b - E_b) < 4 * found.sigma[1]
    assert found.rest < 0.03 < found.worst
    assert found.left + found.right == pytest.approx(2.0)
    assert found.right / found.left == pytest.approx(found.E_d)


def test_umbmark_of_nonsense():
    with pytest.raises(OdometryError, match="1 runs clockwise and 0 counter-clockwise"):
        umbmark(np.zeros((1, 2)), np.zeros((0, 2)), 4.0, 0.3)
