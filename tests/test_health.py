"""The lines after a run: what they say of good and bad filters, and of a spoiled odometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.mapper import HierarchicalMapper
from mapping.particle_filter import FilterHealth
from mapping.settings import MappingSettings
from odometry.motion import compose, inverse
from pipeline.frontend import UNREADABLE
from pipeline.health import (
    OdometryErrors,
    agreement_lines,
    answers_line,
    complaints,
    health_lines,
    image_lines,
    matching_line,
    odometry_errors,
    odometry_lines,
    particles_line,
)
from stereo.pair_check import BLACK


def step(
    n_eff: float = 60.0, resampled: bool = False, matched: float = 0.9, **other
) -> FilterHealth:
    fields = {
        "stamp": 0, "observations": 10, "recovered": False, "overlap": 500, "judged": 100,
        "answered": 0.9, "tiles": 9,
    }  # fmt: skip
    return FilterHealth(n_eff=n_eff, resampled=resampled, matched=matched, **{**fields, **other})


# The filter


def test_a_healthy_filter_is_said_to_be_so():
    steps = [step(60)] * 8 + [step(3, True)] * 2  # dips where a loop closes are no illness
    assert particles_line(steps, 100) == (
        "N_eff 60% of 100 particles (least 3%), resampled in 2 of 10 steps: healthy"
    )


def test_a_starved_filter_is_told_what_it_needs():
    line = particles_line([step(60)] * 6 + [step(3, True)] * 4, 100)
    assert "resampled in 4 of 10 steps: too few particles agree" in line
    assert "mapping.particles" in line
    assert "odometry.along" in line


def test_matching_is_judged_where_enough_was_in_view():
    line = matching_line([step(matched=0.9), step(matched=0.7), step(matched=0.0, judged=0)])
    assert line == (
        "2 of 3 steps saw enough of the map to be judged; they matched 80% of its obstacles in "
        "view: good"
    )
    assert "the path is odometry's own" in matching_line([step(matched=0.0, judged=0)] * 3)


def test_a_map_that_disagrees_with_itself_is_told():
    once = [step(matched=0.9)] * 99 + [step(matched=0.2)]
    assert matching_line(once).endswith(": good")
    line = matching_line([*once, *[step(matched=0.3)] * 4])
    assert "matched 90% of its obstacles in view, 5 of them less than half" in line
    assert "double walls" in line


def test_missing_answers_are_weighed_by_observations():
    steps = [step(answered=1.0, observations=10), step(answered=0.4, observations=2)]
    assert answers_line(steps, "columns") == "10% of the columns had no answer"
    dark = [step(answered=0.3)]
    assert "more light or texture" in answers_line(dark, "columns")
    assert "70% of the beams had no answer: where maximum" in answers_line(dark, "beams")


# Odometry against the path


def drives(seed: int, distance: float, rotation: float, drift: float, noise: float):
    """Odometry (n, 3) and path (n, 3) of 150 m with bends and turns on the spot."""
    rng = np.random.default_rng(seed)
    n = 900
    bend = np.radians(6.0) * np.sin(np.arange(n) / 15.0) + np.radians(2.0)
    true = np.stack([np.full(n, 0.17), np.zeros(n), bend], axis=1)
    true[::30] = (0.0, 0.0, 0.5)
    travel = true[:, 0]
    told = true * (1.0 + distance, 1.0, 1.0 + rotation)
    told[:, 2] += drift * travel
    told += rng.normal(0.0, noise, (n, 3)) * (1.0, 0.3, 0.3)
    poses = []
    for steps in (told, true):
        at = np.zeros(3)
        line = [at]
        for move in steps:
            at = compose(at, move)
            line.append(at)
        poses.append(np.array(line))
    return poses


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    "spoiled",
    [(0.03, 0.0, 0.0), (0.0, -0.04, 0.0), (0.0, 0.0, math.radians(-0.5)), (-0.02, 0.05, 0.01)],
)
def test_errors_of_odometry_are_recovered_within_their_uncertainty(seed, spoiled):
    errors = odometry_errors(*drives(seed, *spoiled, noise=0.01))
    assert errors is not None
    assert (np.abs(errors.value - spoiled) < 4.0 * errors.error).all()
    assert (errors.error < (0.005, 0.005, math.radians(0.1))).all()
    assert errors.significant.tolist() == [value != 0.0 for value in spoiled]


def test_good_odometry_is_not_blamed():
    for seed in range(20):
        errors = odometry_errors(*drives(100 + seed, 0.0, 0.0, 0.0, noise=0.02))
        assert errors is not None
        assert odometry_lines(errors, encoders=True) == []


def test_a_few_slips_do_not_spoil_the_estimate():
    odometry, path = drives(1, 0.03, 0.0, 0.0, noise=0.005)
    for at in range(100, 900, 200):  # half a metre that the wheels did not see
        slip = compose(path[at], np.array([0.5, 0.0, 0.3]))
        path[at:] = compose(slip, compose(inverse(path[at]), path[at:]))
    errors = odometry_errors(odometry, path)
    assert errors is not None
    assert errors.value[0] == pytest.approx(0.03, abs=0.004)


def test_short_runs_and_robots_at_rest_tell_nothing():
    odometry, path = drives(1, 0.1, 0.1, 0.0, noise=0.0)
    assert odometry_errors(odometry[:100], path[:100]) is None
    assert odometry_errors(np.zeros((500, 3)), np.zeros((500, 3))) is None
    assert odometry_errors(np.zeros((0, 3)), np.zeros((0, 3))) is None
    straight = np.zeros((500, 3))
    straight[:, 0] = np.arange(500)
    assert odometry_errors(straight, straight) is None


def test_what_is_wrong_comes_with_its_remedy():
    errors = OdometryErrors(
        np.array([0.02, -0.03, math.radians(0.4)]), np.array([0.001, 0.004, math.radians(0.05)])
    )
    distance, rotation, drift = odometry_lines(errors, encoders=True)
    assert distance == (
        "odometry overestimates distance by 2.0 ± 0.1 %: multiply left_radius and right_radius of "
        "the encoders by 0.980"
    )
    # Smaller radii turn the robot less: the track makes up for that, too.
    assert rotation == (
        "odometry underestimates rotation by 3.0 ± 0.4 %: multiply the track of the encoders by "
        "0.951"
    )
    assert "turns to the left by 0.40 ± 0.05 deg a metre where the robot does not" in drift
    assert "right_radius of the encoders is too large" in drift
    *others, last = odometry_lines(errors, encoders=False)
    assert not any("encoders" in line for line in (*others, last))
    assert "calibrate the cameras" in odometry_lines(errors, encoders=False, images=True)[-1]
    assert "calibrate the robot's odometry" in last


def test_the_remedy_mends_a_differential_drive():
    """Radii and track as the lines say give back the true distance and rotation."""
    radius, track = 0.075, 0.30  # what the robot believes
    true_radius, true_track = 0.073, 0.32
    left, right = 10.0, 12.0  # wheel turns [rad]
    told = np.array([radius * (left + right) / 2, radius * (right - left) / track])
    true = np.array([true_radius * (left + right) / 2, true_radius * (right - left) / true_track])
    value = np.array([*(told / true - 1.0), 0.0])
    lines = odometry_lines(OdometryErrors(value, np.full(3, 1e-4)), encoders=True)
    factors = [float(line.rpartition(" ")[2]) for line in lines]
    assert radius * factors[0] == pytest.approx(true_radius, rel=1e-3)
    assert track * factors[1] == pytest.approx(true_track, rel=1e-3)


def test_nothing_significant_is_not_told():
    errors = OdometryErrors(np.array([0.05, 0.005, 0.0]), np.array([0.03, 0.0001, 0.0]))
    assert errors.significant.tolist() == [False, False, False]
    assert odometry_lines(errors, encoders=True) == []
    assert odometry_lines(None, encoders=True) == []


def test_a_run_that_saw_nothing_says_so():
    (line,) = health_lines(HierarchicalMapper(MappingSettings(particles=2)), "beams", False)
    assert "nothing was mapped" in line


def test_how_far_odometry_and_path_part_is_told_in_the_median():
    travel = np.arange(0.0, 10.0, 0.1)
    path = np.stack([travel, 0.0 * travel, 0.0 * travel], axis=1)
    odometry = path * [1.03, 1.0, 1.0]
    (line,) = agreement_lines(odometry, path)
    assert line.startswith("odometry and matched path part by 3")
    assert " mm and 0.0 deg in 1 m (median of 10 stretches)" in line
    assert agreement_lines(odometry[:40], path[:40]) == []


def test_what_asks_for_something_is_told_from_what_does_not():
    well = [
        particles_line([step()], 100),
        matching_line([step()]),
        answers_line([step()], "columns"),
        "odometry and matched path part by 3 mm and 0.0 deg in 1 m (median of 10 stretches)",
    ]
    ill = [
        particles_line([step(1)], 100),
        matching_line([step(matched=0.1)]),
        matching_line([step(judged=0)]),
        answers_line([step(answered=0.1)], "beams"),
        *odometry_lines(OdometryErrors(np.array([0.05, 0.0, 0.0]), np.full(3, 1e-4)), True),
        *image_lines({BLACK: ["1.png"], UNREADABLE: ["2.png", "3.png"]}, [2.0]),
    ]
    assert len(ill) == 8
    assert complaints([*well, *ill]) == ill
