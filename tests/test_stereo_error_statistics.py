"""What ranges are wrong about: planted errors must be found again, and nothing else."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.intervals import of_values, ratio, share
from stereo.error_statistics import (
    Compared,
    at_edge,
    classify,
    disparity_errors,
    find_blocks,
    half_width,
    in_sigmas,
    relative_errors,
)

FACTOR = 59.0  # m px
BEARING = np.radians(np.linspace(-33.0, 33.0, 265))


def compared(truth, measured=None, sigma=0.0, max_range=8.0) -> Compared:
    """Frames (n, b) of the true ranges, measured without error unless told otherwise."""
    truth = np.atleast_2d(truth)
    measured = truth if measured is None else np.atleast_2d(measured)
    sigma = np.where(np.isfinite(measured), sigma, np.nan)
    return Compared(BEARING, measured, sigma, truth, max_range, FACTOR, 0.05)


def wall(frames=1, distance=4.0) -> np.ndarray:
    return np.tile(distance / np.cos(BEARING), (frames, 1))


def test_a_perfect_camera_is_right_everywhere():
    classes = classify(compared(wall()))
    assert classes.right.all()
    assert not classes.false.any()
    assert not classes.false_free.any()


def test_each_kind_of_error_is_its_own_class():
    truth, measured = wall(), wall()
    measured[0, 10:20] = np.nan  # silent
    measured[0, 30:40] = 1.5  # something that is not there
    measured[0, 50:60] = np.inf  # the wall is looked through
    measured[0, 70:80] *= 1.3  # and here it stands too far away
    truth[0, 90:100] = np.nan
    truth[0, 110:120] = measured[0, 110:120] = np.inf
    classes = classify(compared(truth, measured))
    spans = {
        "unanswered": [(10, 20)],
        "false": [(30, 40), (70, 80)],
        "false_free": [(50, 60), (70, 80)],
    }
    for name, expected in spans.items():
        columns = np.concatenate([np.arange(*span) for span in expected])
        assert np.flatnonzero(getattr(classes, name)[0]).tolist() == columns.tolist(), name
    assert np.flatnonzero(~classes.known[0]).tolist() == list(range(90, 100))


def test_an_obstacle_beyond_the_reach_is_none_that_could_be_missed():
    measured = np.full_like(wall(), np.inf)
    assert not classify(compared(wall(distance=6.0), measured, max_range=5.0)).false_free.any()
    assert classify(compared(wall(distance=4.0), measured, max_range=5.0)).false_free.any()


@given(off=st.floats(-0.5, 0.5), sigma=st.floats(0.0, 0.5), distance=st.floats(0.5, 7.0))
def test_tolerance_is_a_tenth_three_sigma_or_two_cells(off, sigma, distance):
    truth = np.full((1, BEARING.size), distance)
    tolerance = max(0.1 * distance, 3.0 * sigma, 0.1)
    if math.isclose(abs(off), tolerance, rel_tol=1e-6):
        return
    classes = classify(compared(truth, truth + off, sigma))
    assert classes.false.all() == (abs(off) > tolerance)
    assert classes.right.all() == (abs(off) < tolerance)


def test_blocks_are_found_with_their_width_and_range():
    truth, measured = wall(3), wall(3)
    measured[0, 40:61] = 2.0
    measured[0, 48:51] = np.nan  # silence does not end a block
    measured[2, 100:105] = 1.0
    measured[2, 106:110] = 1.0  # a right column does
    c = compared(truth, measured)
    blocks = find_blocks(c, classify(c))
    assert blocks.frame.tolist() == [0, 2, 2]
    assert np.degrees(blocks.width) == pytest.approx([21 * 0.25, 5 * 0.25, 4 * 0.25])
    assert blocks.range.tolist() == [2.0, 1.0, 1.0]


def test_no_block_where_nothing_is_false():
    c = compared(wall())
    assert find_blocks(c, classify(c)).frame.size == 0


def test_false_columns_beside_a_step_are_told_from_those_out_of_nothing():
    truth = np.where(np.arange(BEARING.size) < 130, 2.0, 5.0)[None]
    measured = truth.copy()
    measured[0, 130:133] = 2.0  # the near surface grown by three columns
    measured[0, 200:203] = 2.0  # nothing of that range is near
    c = compared(truth, measured)
    assert np.flatnonzero(at_edge(c, classify(c))[0]).tolist() == [130, 131, 132]


def test_the_noise_put_in_comes_out():
    chance = np.random.default_rng(3)
    truth = wall(100, 3.0)
    disparity = FACTOR / (truth * np.cos(BEARING))
    noisy = disparity + 0.05 + 0.3 * chance.standard_normal(truth.shape)
    measured = FACTOR / (noisy * np.cos(BEARING))
    sigma = measured**2 * 0.3 * np.cos(BEARING) / FACTOR
    c = replace(compared(truth, measured), sigma=sigma)
    errors = disparity_errors(c, classify(c))
    noise = of_values(errors, half_width)
    assert noise.low < 0.3 < noise.high
    assert noise.value == pytest.approx(0.3, abs=0.005)
    assert np.median(np.concatenate(errors)) == pytest.approx(0.05, abs=0.01)
    assert half_width(np.concatenate(relative_errors(c, classify(c)))) == pytest.approx(
        0.3 * 3.0 / FACTOR, rel=0.05
    )
    within = np.mean(np.concatenate(in_sigmas(c)) < 1.0)
    assert within == pytest.approx(0.683, abs=0.015)


def test_frames_that_are_wrong_as_a_whole_make_a_wide_interval():
    """A thousand columns of a frame that all fail together are one observation."""
    chance = np.random.default_rng(5)
    bad = chance.random(40) < 0.2
    together = share(1000 * bad, np.full(40, 1000))
    apart = share(np.full(40, 200), np.full(40, 1000))
    assert together.high - together.low > 0.15
    assert apart.high - apart.low < 0.01


def test_the_interval_holds_the_truth_as_often_as_it_says():
    chance = np.random.default_rng(7)
    held = 0
    for trial in range(100):
        counts = chance.binomial(50, chance.beta(2.0, 8.0, size=60))
        found = share(counts, np.full(60, 50), seed=trial)
        held += found.low <= 0.2 <= found.high
    assert held >= 88


def test_never_seen_is_not_never():
    none = share(np.zeros(20, int), np.full(20, 600))
    assert none.value == 0.0
    assert 0.1 < none.high < 0.2  # 20 frames, not 12000 columns
    assert share(np.full(20, 600), np.full(20, 600)).low == pytest.approx(1.0 - none.high)
    nothing = share(np.zeros(3, int), np.zeros(3, int))
    assert math.isnan(nothing.value)
    assert math.isnan(of_values([np.empty(0)], half_width).value)
    assert ratio(np.array([1, 3]), np.ones(2)).value == 2.0
