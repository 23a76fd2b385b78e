"""What a run finds of itself: good and bad filters, spoilt odometry, losses; and its verdict."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.mapper import HierarchicalMapper
from mapping.odometry_witness import OdometryErrors
from mapping.particle_filter import FilterHealth
from mapping.settings import MappingSettings
from pipeline.health.filter_findings import (
    FilterFigures,
    answers_finding,
    matching_finding,
    particles_finding,
)
from pipeline.health.finding import Finding, Grade
from pipeline.health.image_findings import image_findings, loss_findings
from pipeline.health.odometry_findings import odometry_findings, parting_findings
from pipeline.health.parting import Parting, parting
from pipeline.health.run_health import RunHealth, Verdict
from pipeline.run import MapRun
from stereo.pair_check import BLACK


def figures(steps, particles: int = 100) -> FilterFigures:
    return FilterFigures.of(steps, particles)


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
    found = particles_finding(figures(steps))
    assert found.line == (
        "N_eff 60% of 100 particles (least 3%), resampled in 2 of 10 steps: healthy"
    )
    assert (found.grade, found.remedy) == (Grade.GOOD, "")


def test_a_starved_filter_is_told_what_it_needs():
    found = particles_finding(figures([step(60)] * 6 + [step(3, True)] * 4))
    assert "resampled in 4 of 10 steps: too few particles agree" in found.line
    assert "mapping.particles" in found.remedy
    assert "odometry.along" in found.remedy
    assert found.command.endswith("--set mapping.particles=200")
    assert found.grade == Grade.DOUBTFUL


@pytest.mark.parametrize("judged", [1, 2])
def test_nothing_judged_on_a_step_or_two_is_good(judged):
    seen = [step(matched=0.9)] * judged + [step(matched=0.0, judged=0)] * (8 - judged)
    assert matching_finding(figures(seen)).grade == Grade.DOUBTFUL


def test_a_map_of_which_less_than_half_is_seen_again_is_not_good():
    assert matching_finding(figures([step(matched=0.09)])).grade != Grade.GOOD
    assert matching_finding(figures([step(matched=0.49)] * 3)).grade != Grade.GOOD


def test_matching_is_judged_where_enough_was_in_view():
    found = matching_finding(
        figures([step(matched=m) for m in (0.9, 0.8, 0.7)] + [step(matched=0.0, judged=0)])
    )
    assert found.line == (
        "3 of 4 steps saw enough of the map to be judged; they matched 80% of its obstacles in "
        "view: good"
    )
    unchecked = matching_finding(figures([step(matched=0.0, judged=0)] * 3))
    assert "the path is odometry's own" in unchecked.remedy
    assert unchecked.grade == Grade.DOUBTFUL
    hardly = matching_finding(figures([step(matched=0.0, judged=0)] * 19 + [step(matched=0.9)]))
    assert "the path is odometry's own" in hardly.remedy
    assert hardly.short.endswith("but that was little")
    assert hardly.grade == Grade.DOUBTFUL


def test_a_map_that_disagrees_with_itself_is_told():
    once = [step(matched=0.9)] * 99 + [step(matched=0.2)]
    assert matching_finding(figures(once)).line.endswith(": good")
    # Of few steps a single one says little.
    assert matching_finding(figures(once[-20:])).grade == Grade.GOOD
    found = matching_finding(figures([*once, *[step(matched=0.3)] * 4]))
    assert "matched 90% of its obstacles in view, 5 of them less than half" in found.text
    assert "double walls" in found.remedy
    assert found.grade == Grade.DOUBTFUL
    broken = matching_finding(figures([*once, *[step(matched=0.3)] * 40]))
    assert broken.grade == Grade.BROKEN
    assert broken.short.startswith("41 of 140 steps saw less than half")


def test_missing_answers_are_weighed_by_observations():
    steps = [step(answered=1.0, observations=10), step(answered=0.4, observations=2)]
    assert answers_finding(figures(steps), "columns").line == "10% of the columns had no answer"
    dark = answers_finding(figures([step(answered=0.3)]), "columns")
    assert "more light or texture" in dark.remedy
    assert dark.grade == Grade.DOUBTFUL
    assert answers_finding(figures([step(answered=0.1)]), "columns").grade == Grade.BROKEN
    beams = answers_finding(figures([step(answered=0.3)]), "beams")
    assert "70% of the beams had no answer: where maximum" in beams.line
    assert beams.grade == Grade.GOOD


# Odometry


def test_what_is_wrong_comes_with_its_remedy():
    errors = OdometryErrors(
        np.array([0.02, -0.03, math.radians(0.4)]), np.array([0.001, 0.004, math.radians(0.05)])
    )
    distance, rotation, drift = [found.line for found in odometry_findings(errors, encoders=True)]
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
    assert "the right wheel is taken for too large (right_radius of the encoders)" in drift
    *others, last = [found.line for found in odometry_findings(errors, encoders=False)]
    assert not any("encoders" in line for line in (*others, last))
    *_, images = odometry_findings(errors, encoders=False, images=True)
    assert "calibrate the cameras" in images.remedy
    assert "calibrate the robot's odometry" in last


def test_the_remedy_mends_a_differential_drive():
    """Radii and track as the lines say give back the true distance and rotation."""
    radius, track = 0.075, 0.30  # what the robot believes
    true_radius, true_track = 0.073, 0.32
    left, right = 10.0, 12.0  # wheel turns [rad]
    told = np.array([radius * (left + right) / 2, radius * (right - left) / track])
    true = np.array([true_radius * (left + right) / 2, true_radius * (right - left) / true_track])
    value = np.array([*(told / true - 1.0), 0.0])
    findings = odometry_findings(OdometryErrors(value, np.full(3, 1e-4)), encoders=True)
    factors = [float(found.line.rpartition(" ")[2]) for found in findings]
    assert radius * factors[0] == pytest.approx(true_radius, rel=1e-3)
    assert track * factors[1] == pytest.approx(true_track, rel=1e-3)


def test_nothing_significant_is_not_told():
    errors = OdometryErrors(np.array([0.05, 0.005, 0.0]), np.array([0.03, 0.0001, 0.0]))
    assert odometry_findings(errors, encoders=True) == []
    assert odometry_findings(None, encoders=True) == []


def test_large_errors_of_odometry_make_the_map_doubtful():
    sure = np.full(3, 1e-4)
    for value in ((0.06, 0.0, 0.0), (0.0, -0.12, 0.0), (0.0, 0.0, math.radians(2.5))):
        (large,) = odometry_findings(OdometryErrors(np.array(value), sure), encoders=True)
        (small,) = odometry_findings(OdometryErrors(np.array(value) / 2, sure), encoders=True)
        assert (small.grade, large.grade) == (Grade.GOOD, Grade.DOUBTFUL)
        assert large.short.startswith(large.text[:20])


def test_what_no_wheel_can_be_off_is_the_cameras():
    errors = OdometryErrors(np.array([1.08, 0.0, 0.0]), np.full(3, 0.01))
    (found,) = odometry_findings(errors, encoders=True)
    assert "multiply" not in found.remedy
    assert "mount" in found.remedy
    assert found.grade == Grade.DOUBTFUL


def test_how_far_odometry_and_path_part_is_told_in_the_median():
    travel = np.arange(0.0, 10.0, 0.1)
    path = np.stack([travel, 0.0 * travel, 0.0 * travel], axis=1)
    odometry = path * [1.03, 1.0, 1.0]
    (found,) = parting_findings(parting(odometry, path))
    assert found.line.startswith("odometry and matched path part by 3")
    assert " mm and 0.0 deg in 1 m (median of 10 stretches)" in found.line
    assert parting(odometry[:40], path[:40]) is None
    assert parting(np.zeros((0, 3)), np.zeros((0, 3))) is None
    assert parting_findings(None) == []
    (far,) = parting_findings(Parting(0.3, 0.01, 50))
    assert far.grade == Grade.DOUBTFUL
    assert "disagree by 300 mm" in far.short


# What was lost


def test_what_was_lost_is_graded_by_its_share():
    assert loss_findings({"pairs used": 40}, {}) == []
    for count, grade in ((2, Grade.GOOD), (10, Grade.DOUBTFUL), (60, Grade.BROKEN)):
        (motion,) = loss_findings({"pairs used": 40, "pairs without motion": count}, {})
        (late,) = loss_findings({"pairs used": 40}, {"pairs_skipped": count})
        names = {BLACK: ["x"] * count}
        (black,) = image_findings(names, [1.0] * 40)
        assert motion.grade == late.grade == black.grade == grade
        assert black.short == f"black images in {count} of {40 + count} pairs"
    (silent,) = loss_findings({}, {"odometry": {"tick_gaps": 1, "longest_tick_gap_s": 2.0}})
    assert silent.text == "the wheels were silent once, up to 2.0 s"


# The verdict


def test_the_worst_finding_decides_and_good_needs_all():
    good, doubtful, broken = (
        Finding(name, grade=grade, short=name)
        for name, grade in (("a", Grade.GOOD), ("b", Grade.DOUBTFUL), ("c", Grade.BROKEN))
    )
    silent = Finding("says nothing")
    assert Verdict.of([good, silent], False, "all there") == Verdict("good", "a; all there")
    assert Verdict.of([good, doubtful, silent], False, "all there") == Verdict("doubtful", "b")
    assert Verdict.of([doubtful, broken, good], False) == Verdict("broken", "c; b")
    assert Verdict.of([good], True) == Verdict(
        "good", "a; interrupted: this is the first part of the recording"
    )


def test_a_run_that_saw_nothing_says_so():
    run = MapRun(HierarchicalMapper(MappingSettings(particles=2)))
    health = RunHealth.of(run, np.zeros((0, 3)), {})
    assert health.verdict == Verdict("broken", "nothing was mapped")
    (line,) = health.lines
    assert "the robot saw nothing, or the run was too short" in line
